"""The latency of the sensors, by Newton steps where the data ask for one.

Contacts and normals are taken as of the instant of the finger positions, or as late as
the scene or an earlier estimate says.  Where a Newton step on the latency, which needs
no solve (information/consider_parameters.py), promises to lower the objective, fingers
are put where they were earlier, and the page is solved again from the solution, a step
at a time.  A latency is kept where it gains more than its Laplace evidence loses, the
logarithm of its prior over its posterior deviation, and the spread of the likelihood.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from ..data.sensor_noise import LATENCY
from ..information.consider_parameters import Doubt, late_touches
from ..information.error_budget import Linearisation
from ..information.measurement_noise import Sensed
from ..nlp.kkt import kkt_system_of
from ..search.local_solve import Solved, best_first, warm_started
from ..search.margins import BETTER_OPTIMUM, DECISIVE, UNCHANGED
from .ground_tilt import on_ground
from .nested_models import misfit_of, needed_gain

log = logging.getLogger("tactilenlp")
MAX_FAILED = 3  # steps in a row that gain nothing
LONGEST_LAG = 2 * LATENCY  # [s] a Newton step has no end where curvature is low


def with_latency(job, solved) -> tuple:
    """Return job and solves, best first, with the latency that the touches tell of.

    Solves that are not close to the best are left out where it is another one.
    """
    prompt = solved[0]
    if not (may_be_late(job) and prompt.solution.success):
        return job, solved
    late, doubt = _by_steps(prompt)
    needed = UNCHANGED
    if job.precision.latency == 0:
        occam = np.log(LATENCY * np.sqrt(doubt.information))
        needed = needed_gain(misfit_of(job, prompt).spread, occam)
    if late.cost > prompt.cost - needed:
        return job, solved
    told = replace(late.job.precision, latency_error=float(np.sqrt(doubt.squared)))
    log.info("sensors are late by %.1f ms: the objective falls by %.1f nats",
             1e3 * told.latency, prompt.cost - late.cost)  # fmt: skip
    best = replace(late, job=replace(late.job, precision=told))
    close = [s for s in solved[1:] if s.solution.success]
    close = [s for s in close if s.cost < prompt.cost + DECISIVE]
    others = [warm_started(s.job.as_late_as(told), s) for s in close]
    return best.job, best_first([best, *others])


def as_found(job, other):
    """Return a job on the ground, and with the latency, of another one."""
    return on_ground(job, other.scene.ground).as_late_as(other.precision)


def newly_late(job, other) -> bool:
    """Tell whether another job has a latency that a search of this one has not known.

    A job with a path is not searched.
    """
    return other.precision.latency > job.precision.latency == 0 and job.path is None


def may_be_late(job) -> bool:
    """Tell whether the latency is not told, and a page be solved with another one."""
    return job.scene.latency is None and "prompt" in job.contract.freed


def _by_steps(best: Solved) -> tuple[Solved, Doubt]:
    """Return a solve with the latency that Newton steps lead to, and the doubt left.

    A step that gained more than expected is doubled next, one that gained nothing is
    halved: contacts that begin or end make the curvature too large, or too small.
    """
    doubt, factor, failed = _doubt_at(best), 1.0, 0
    while failed < MAX_FAILED:
        if factor <= 1 and factor * doubt.gain < UNCHANGED:
            break
        if best.job.deadline.passed("a latency"):
            break
        step = np.clip(factor * doubt.mean, -LONGEST_LAG, LONGEST_LAG)
        told = best.job.precision
        told = replace(told, latency=max(0.0, float(told.latency + step)))
        late = best.job.as_late_as(told)
        again = warm_started(late, best)
        gained = best.cost - again.cost
        if not again.solution.success or gained < BETTER_OPTIMUM:
            factor, failed = factor / 2, failed + 1
            continue
        more = gained > doubt.gain
        best, doubt, failed = again, _doubt_at(again), 0
        ahead = 2 * step / doubt.mean if doubt.mean else 0.0
        factor = max(1.0, ahead) if more else 1.0
    return best, doubt


def _doubt_at(solved: Solved) -> Doubt:
    """Return what is known of the latency at a solve."""
    job, kkt = solved.job, kkt_system_of(solved.problem, solved.solution)
    sensed = Sensed(job.data, job.precision, job.build, job.scene)
    return late_touches(Linearisation(kkt, sensed, solved.window, job.shape))
