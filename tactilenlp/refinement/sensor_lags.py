"""Estimate the lags of contacts and normals by Newton steps (consider parameters).

Contacts and normals are first taken as of their instant, or as late as the scene or an
earlier estimate says, and normals as no later than contacts.  Where a Newton step on
such a lag, which needs no solve (information/consider_parameters.py), promises to lower
the objective, finger paths or normals are shifted in time (data/sensor_noise.py) and
the page is solved again from the solution, a step at a time.  A lag must gain more than
its Laplace evidence loses, the logarithm of prior over posterior deviation, and the
spread of the likelihood.  Late normals bias sizes where fingers slide over edges.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from formulations.names import TOUCH_TERM

from ..data.sensor_noise import LATENCY, NORMAL_LAG
from ..information.consider_parameters import (
    ConsiderParameter,
    late_normals,
    late_touches,
)
from ..local.local_solve import warm_started
from ..local.margins import BETTER_OPTIMUM, UNCHANGED
from ..local.solved import Solved, best_first, close_to_best
from .nested_models import misfit_of, needed_gain

log = logging.getLogger("tactilenlp")
MAX_FAILED = 3  # steps on a lag in a row that gain nothing
LARGEST_LAG_STEP = 2.0  # [prior deviations] a Newton step has no end at a low curvature


class Lag(NamedTuple):
    """One lag of the sensors: its field, its prior, its consider parameter.

    field: of Precision; deviation: of its prior [s]; consider(linearisation): the
    consider parameter of a further lag.
    """

    field: str
    deviation: float
    consider: Callable

    def of(self, solved: Solved) -> float:
        """Return the lag that a solve was made with [s]."""
        return getattr(solved.job.precision, self.field)


LAGS = {  # in the order in which they are estimated
    "sensors": Lag("latency", LATENCY, late_touches),
    "normals": Lag("normal_lag", NORMAL_LAG, late_normals),
}


def estimate_lags(solves) -> list[Solved]:
    """Return solves, best first, with the lags of sensors that evidence favours.

    If a lag changes, solves far from the best are dropped.  A page without touches
    tells none.
    """
    for name, lag in LAGS.items():
        best = solves[0]
        told = best.job.fixes("prompt") and TOUCH_TERM in best.problem.costs
        if told and best.solution.success:
            solves = _estimate_lag(name, lag, solves)
    return solves


def _estimate_lag(name: str, lag: Lag, solves) -> list[Solved]:
    """Return solves with one lag, if evidence favours it."""
    prompt, known = solves[0], lag.consider(solves[0].linearised)
    needed = _needed_for_lag(lag, prompt, known)
    if max(misfit_of(prompt).excess, known.gain) < needed:
        return solves
    late, known = _lag_by_steps(lag, prompt, known)
    if late.cost > prompt.cost - _needed_for_lag(lag, prompt, known):
        return solves
    log.info("%s are late by %.1f ms: the objective falls by %.1f nats",
             name, 1e3 * lag.of(late), prompt.cost - late.cost)  # fmt: skip
    error = {f"{lag.field}_error": float(np.sqrt(known.squared[0, 0]))}
    precision = replace(late.job.precision, **error)
    best = replace(late, job=replace(late.job, precision=precision))
    others = [
        warm_started(s.job.as_late_as(precision), s) for s in close_to_best(solves)
    ]
    return best_first([best, *others])


def lost_by_latency(job, best: Solved) -> bool:
    """Tell whether a search of the job may have lost the body for want of a latency.

    A solve found a latency that the search did not assume, and its fit is not good.  A
    job with a hypothesis is not searched.
    """
    new = best.job.precision.latency > job.precision.latency == 0
    fits = best.fit is not None and best.fit.verdict == "good"
    return new and not fits and job.search.hypothesis is None


def _needed_for_lag(lag: Lag, prompt: Solved, known: ConsiderParameter) -> float:
    """Return by how many nats a lag must lower the objective to be believed.

    known: what is known of it; where an earlier solve found one, a change of it is due.
    """
    if lag.of(prompt) > 0:
        return UNCHANGED
    occam = np.log(lag.deviation * np.sqrt(known.information[0, 0]))
    return needed_gain(misfit_of(prompt).spread, occam)


def _lag_by_steps(
    lag: Lag, best: Solved, known: ConsiderParameter
) -> tuple[Solved, ConsiderParameter]:
    """Return a solve with the lag that Newton steps lead to, and what it tells of it.

    known: at the given solve.  A step that gained more than expected is doubled next,
    one that gained nothing is halved: contacts that begin or end make the curvature too
    large, or too small.
    """
    factor, failed, longest = 1.0, 0, LARGEST_LAG_STEP * lag.deviation
    while failed < MAX_FAILED:
        if factor <= 1 and factor * known.gain < UNCHANGED:
            break
        if best.job.deadline.passed(lag.field.replace("_", " ")):
            break
        mean = np.clip(known.mean[0], -longest, longest)
        step = np.clip(factor * mean, -longest, longest)
        then = max(0.0, float(lag.of(best) + step))
        precision = replace(best.job.precision, **{lag.field: then})
        late = best.job.as_late_as(precision)
        again = warm_started(late, best)
        gained = best.cost - again.cost
        if not again.solution.success or gained < BETTER_OPTIMUM:
            factor, failed = factor / 2, failed + 1
            continue
        more = gained > known.gain
        best, known, failed = again, lag.consider(again.linearised), 0
        ahead = 2 * step / known.mean[0] if known.mean[0] else 0.0
        factor = max(1.0, ahead) if more else 1.0
    return best, known
