"""Choose by evidence: the most probable of several optima, the likeliest class.

Classes of shapes are not nested: the one of the largest evidence is the estimate.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from formulations.shape import Shape

from ..common.deadline import Deadline
from ..common.validation import check_types
from ..errors import Interrupted, OptionError, PageError, StartError, TactileError
from ..information.error_budget import PRIORS
from ..information.error_budget_terms import ANY_ROTATION, REACHED
from ..information.mixture import (
    distinct_modes,
    laplace_mixture,
    occam_factor,
    occam_of_vertices,
    odds_of,
    relabellings,
)
from ..information.tangent_space import widest_deviations
from ..interface.result import Estimate
from ..interface.session import Guess
from ..local.margins import DECISIVE, LEAST_MOTION_BEHIND
from ..local.solved import Solved, comparable
from ..problem.job import prior_cost_of
from ..problem.pages import shape_of

AUTO = (  # the classes of shape="auto"
    *("cuboid", "cylinder", "ellipsoid"),
    *("prism of 3 sides", "prism of 6 sides", "polytope"),
)
MIN_CLASS_TIME = 1.0  # [s] of a class
log = logging.getLogger("tactilenlp")


def most_probable(solves) -> Solved:
    """Return the solve of the largest evidence, not of the least objective.

    A narrow optimum that is lower by a fraction of a nat is not what is believed.
    solves: best first, which is returned if there is no time.
    """
    best, several = solves[0], comparable(solves[0], solves)
    shape = best.job.shape
    if shape.of_vertices or len(several) < 2:
        return best
    if best.job.deadline.passed("evidence of other optima"):
        return best
    optima = distinct_modes(shape, [s.optimum for s in several])
    weights = laplace_mixture(shape, optima).weights
    likeliest = optima[int(np.argmax(weights))]
    return next(s for s in several if s.optimum is likeliest)


def classes_of(shape) -> list[Shape]:
    """Return the Shapes that are to be compared; none for one shape alone."""
    if isinstance(shape, str) and shape == "auto":
        return [shape_of(one) for one in AUTO]
    if isinstance(shape, (str, Shape)) or not isinstance(shape, Sequence):
        return []
    if not shape:
        expected = "shapes to compare, or one"
        raise OptionError("no class", where="shape", got=shape, expected=expected)
    classes = [shape_of(one) for one in shape]
    if any(one in classes[:i] for i, one in enumerate(classes)):
        names = [one.name for one in classes]
        raise OptionError(
            "a class twice", where="shape", got=names, expected="each class once"
        )
    return classes


def likeliest_class(classes, solver, start, options) -> Estimate:
    """Return the estimate of the class with the largest evidence, and its table.

    classes: Shapes; solver: an estimation.solver.ClassSolver, whose estimates may raise
    TactileError; the time limit is shared by the classes that are left, of which none
    begins without MIN_CLASS_TIME; start: of the classes that it fits, StartError if of
    none.  Raises the error of the first class if none has an estimate, and a PageError,
    which is a fault of the page.  The poses of the likeliest class are a second start
    of the others.
    """
    check_types(start=(start, (Estimate, Guess, type(None))))
    if start is not None and not any(_starts_from(start, shape) for shape in classes):
        raise StartError(
            "no class can start from it", where="start", got=type(start).__name__,
            expected=f"an Estimate or a Guess of {[shape.name for shape in classes]}",
            next="leave it out, or add its class to the list",
        )  # fmt: skip
    began, deadline = time.process_time(), Deadline.within(options.time_limit)
    estimates, errors, to_beat = {}, {}, np.inf
    with _best_at_ctrl_c(estimates):
        for i, shape in enumerate(classes):
            if i and deadline.passed(f"the class {shape.name}", MIN_CLASS_TIME):
                errors[i] = _no_time_for(shape, options)
                continue
            share = deadline.left / (len(classes) - i)
            left = replace(options, time_limit=max(MIN_CLASS_TIME, share))
            try:
                own_start = start if _starts_from(start, shape) else None
                estimate = solver.of_class(shape, left, own_start, to_beat)
                to_beat = min(to_beat, _good_objective(estimate))
                estimates[i] = evidence_of(estimate, shape), estimate
            except PageError:
                raise
            except TactileError as error:
                errors[i] = error
        if not estimates:
            raise next(iter(errors.values()))
        estimates |= _likelier_from_best(classes, solver, options, deadline, estimates)
    failed = {classes[i].name: e for i, e in errors.items() if i not in estimates}
    best = _best_of(estimates)
    seconds = best.seconds | {"total": time.process_time() - began}
    odds, status = odds_of(estimates.values(), failed), deadline.marked(best.status)
    return replace(best, seconds=seconds, status=status, classes=odds)


def _no_time_for(shape, options) -> OptionError:
    """Return why a class was not tried."""
    return OptionError(
        "no time was left for it", where="options.time_limit",
        got=f"{options.time_limit:g} s for all classes",
        expected=f"at least {MIN_CLASS_TIME:g} s for a {shape.name}",
        next="allow more time, or compare fewer classes",
    )  # fmt: skip


@contextmanager
def _best_at_ctrl_c(estimates: dict):
    """Give an Interrupted without an estimate the best of the classes that ended."""
    try:
        yield
    except Interrupted as stop:
        if not estimates or stop.estimate is not None:
            raise
        words = f"stopped by Ctrl-C: {len(estimates)} classes were compared"
        raise Interrupted(words, _best_of(estimates)) from stop


def _best_of(estimates: dict) -> Estimate:
    """Return the estimate of the largest evidence, of equal ones the lowest cost."""
    best = max(estimates.values(), key=lambda one: (one[0], -one[1].objective))
    return best[1]


def _good_objective(estimate) -> float:
    """Return the objective [nats] of an estimate whose fit is good; inf of others."""
    good = estimate.success and estimate.fit and estimate.fit.verdict == "good"
    return estimate.objective if good else np.inf


def _starts_from(start, shape) -> bool:
    """Tell whether a class that is compared starts from an Estimate or a Guess.

    From one of its own class alone, so that evidence is of independent searches.
    """
    if isinstance(start, Guess):
        return not shape.of_vertices and len(start.side_lengths) == shape.theta
    return getattr(start, "shape", None) == shape.name


def _likelier_from_best(classes, solver, options, deadline, estimates) -> dict:
    """Return what is likelier if solved from the poses of the likeliest class.

    Of classes that explain the data worse.  estimates, and what is returned: evidence
    and Estimate by number of the class.
    """
    highest, best = max(estimates.values(), key=lambda one: one[0])
    likelier = {}
    for i, shape in enumerate(classes):
        own, estimate = estimates.get(i, (-np.inf, None))
        cost = np.inf if estimate is None else estimate.objective
        if not np.isfinite(highest) or cost <= best.objective + DECISIVE:
            continue
        if deadline.passed(f"a {shape.name} from the poses of a {best.shape}"):
            break
        left = replace(options, time_limit=max(MIN_CLASS_TIME, deadline.left))
        most = min(cost, best.objective + LEAST_MOTION_BEHIND)
        try:
            again = solver.from_poses(shape, left, best, most)
        except TactileError as error:
            log.info("%s from the poses of a %s: %s", shape.name, best.shape, error)
            continue
        if again is not None and (evidence := evidence_of(again, shape)) > own:
            likelier[i] = evidence, again
    return likelier


def evidence_of(estimate, shape) -> float:
    """Return the log evidence of an estimate; -inf where its solve failed.

    The prior: the deviations of the sizes, a position within REACHED, any rotation.  As
    many optima are alike as there are relabellings of the body's axes.  Of vertices as
    a search compares their numbers (`occam_of_vertices`).
    """
    if not estimate.success:
        return -np.inf
    information, k = estimate.information, len(estimate.information.names)
    covariance = information.of_hessian().covariance_matrix
    cost = estimate.objective + prior_cost_of(estimate.scene, estimate.sensors)
    if shape.of_vertices:
        roles = {*information.roles.values()}.intersection(PRIORS)
        held = sum(information.part(role) for role in sorted(roles))
        return -cost - occam_of_vertices(covariance, held)
    alike = len(relabellings(shape, upright=k < shape.theta + 6))
    sigma = widest_deviations(shape, k, REACHED, ANY_ROTATION)
    evidence = -cost - occam_factor(covariance, np.diag(1 / sigma**2))[0]
    return evidence + np.log(alike)
