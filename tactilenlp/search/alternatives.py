"""Alternative trajectories and sizes that compete with a solved hypothesis.

The search runs forward in time: when later touches resolve what the first ones left
open, the path is already chosen.  So the path is filtered once more backward from where
it is well known (`smoothed_backward`), or over its longest jump from either side
(`without_longest_jump`), and the page solved from there.  How far a body turned while
it was pushed is not measured, so that several turning rates are tried.

Pushes and friction make optima of an untouched size that look sharp: a thin body and a
thick one can explain the same data within a few nats.  Where only physics determines
such a size, the page is solved again from other sizes (`alternative_sizes`), the
touched face kept in place.  What is found competes with the estimate and enters its
mixture of optima.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from ..data.sensor_noise import precise
from ..geometry.transforms import is_planar
from ..information.information import reduced_covariance
from ..information.measurement_noise import KNOWN_FACE
from ..information.tangent_space import final_unknowns
from ..problem.reductions import ARM
from .kalman_filter import filtered_paths
from .local_solve import best_first, continued, freed_levels
from .margins import EXPLAINED, UNCHANGED
from .multistart import multistart
from .proposals import spherical

UNOBSERVED_SHARE = 0.5  # [prior deviations] a size with more sigma is not observed
SAME_OPTIMUM = 6e-3  # [m] sizes this close to the best one's lead to the same optimum
SIZE_TRIED = 3e-3  # [m] sizes this close to another hypothesis's were tried
MIN_ACTIONS = 3  # of a path that is filtered backward from its second half
MAX_JUMPS = 3  # removed from a path, the longest first
MIN_JUMP = 1e-3  # [m] of a jump between actions that is removed
JUMP_NOISE = 3.0  # [position noise] a jump beyond this is not measurement noise
TURN_SCALES = (1.0, 0.3, 0.1)  # [-] of the filter's process noise in yaw
SIZE_HELD = 1e-4  # [m] deviation of sizes where a path is filtered backward
SIZE_FREE = 10e-3  # [m] and where wrong sizes may be the cause of a jump
POSE_HELD = np.r_[3e-4, 3e-4, 5e-3]  # [m, m, rad] deviation of the pose it starts from


def with_alternatives(job, page, solved, options, start=None) -> list:
    """Return the solved hypotheses and alternatives to the best one, best first.

    start: the estimate that this one continues, if alternatives to it were solved; the
    good ones of those are among the hypotheses, so that others are tried only where
    `_needs_alternatives`.
    """
    if not job.reductions.planar:
        return solved
    levels = freed_levels(page.LEVELS, final=True)

    def competing(solved, propose) -> list:
        if job.deadline.passed("all alternatives"):
            return solved
        starts = propose(job, solved)
        found = multistart(job, page, starts, options, levels, known=solved)
        return best_first([*solved, *found])

    new = start is None or _needs_alternatives(job, solved[0], start)
    since = 0 if new else start.measurements.actions
    for _ in range(MAX_JUMPS):
        best = solved[0]
        solved = competing(solved, partial(without_longest_jump, since=since))
        if solved[0] is best:
            break
    if new:
        if not _explains_precise_data(job, solved[0]):
            solved = competing(solved, smoothed_backward)
        solved = competing(solved, alternative_sizes)
        if (again := continued(job, page, solved[0], options)) is not None:
            solved = best_first([*solved, again])
    good = [s for s in solved if s.solution.success]
    return good or solved


def _explains_precise_data(job, best) -> bool:
    """Tell whether a path explains precise measurements: alternatives rarely do better.

    Noise costs about a nat a touch, so that with noisy measurements an objective does
    not tell a right path from a wrong one.
    """
    enough = EXPLAINED * job.data.actions
    good = best.solution.success and best.solution.objective < enough
    return good and precise(job.data, job.precision)


def still_explained(best, start) -> bool:
    """Tell whether the path of an earlier estimate explains the new data as well.

    More data never cost less: where the objective has not risen nothing can be gained.
    """
    risen = best.solution.objective > start.objective + UNCHANGED
    return best.solution.success and not risen


def _needs_alternatives(job, best, start) -> bool:
    """Tell whether the data since an estimate need alternatives to its path.

    Noise alone raises the objective; with noisy measurements alternatives are tried
    only where the first half of the actions has changed.
    """
    moved = first_half(job.data.actions) != first_half(start.measurements.actions)
    asked = moved or precise(job.data, job.precision)
    return asked and not still_explained(best, start)


def first_half(actions: int) -> int:
    """Return the number of actions in the first half, rounded up."""
    return (actions + 1) // 2


def smoothed_backward(job, solved) -> list:
    """Return the best hypothesis with its first half filtered backward from the second.

    Size and pose are known at the first sample of the second half, so that every
    earlier touch moves the path as little as possible; one for each of TURN_SCALES.
    """
    at, action = solved[0].at, job.data.action
    actions = np.unique(action)
    if len(actions) < MIN_ACTIONS:
        return []
    start = int(np.argmax(action == actions[first_half(len(actions))]))
    return _filtered_again(
        job, at, start, True, [SIZE_HELD] * len(TURN_SCALES), TURN_SCALES
    )


def without_longest_jump(job, solved, since=0) -> list:
    """Return the best hypothesis without its longest jump between actions, if any.

    Nothing moves an object while no finger is near: at a jump, the path is wrong either
    before or after it, so that it is filtered from each side over the other.
    since: the jumps between the first so many actions are left out.
    """
    at, first = solved[0].at, max(since - 1, 0)
    found = jumps(job.data, at.x)[first:]
    if found.max(initial=0.0) < jump_threshold(job.precision):
        return []
    start = int(action_starts(job.data)[first + np.argmax(found)])
    sizes = [SIZE_HELD, SIZE_FREE]
    return [h for b in (True, False) for h in _filtered_again(job, at, start, b, sizes)]


def jumps(data, x) -> np.ndarray:
    """Return the jumps (actions - 1,) [m] of a body at poses x between actions.

    Along the ground; in planar motion a radian of turn counts as ARM.
    """
    first = action_starts(data)
    jump = x[:, first] - x[:, first - 1]
    turn = ARM * jump[2] if is_planar(x) else 0.0
    return np.hypot(np.linalg.norm(jump[:2], axis=0), turn)


def jump_threshold(precision) -> float:
    """Return the longest jump [m] that measurement noise may explain."""
    return max(MIN_JUMP, JUMP_NOISE * precision.position)


def action_starts(data) -> np.ndarray:
    """Return the first sample (actions - 1,) of every action but the first one."""
    return 1 + np.nonzero(np.diff(data.action))[0]


def _filtered_again(job, at, start: int, backward: bool, sizes, turning=None) -> list:
    """Return the hypothesis filtered backward from `start`, or forward over it.

    One for each of `sizes` [m], deviations of the sizes, and of `turning` [-], scales
    of the process noise in yaw.
    """
    data, window = spherical(job)
    n, here = len(at.theta), start - (not backward)
    z = np.tile(np.r_[at.theta, at.x[:, here]], (len(sizes), 1))
    deviations = [np.r_[np.full(n, size), POSE_HELD] for size in sizes]
    spread = np.array([np.diag(d**2) for d in deviations])
    turning = np.ones(len(sizes)) if turning is None else np.array(turning)
    samples = np.arange(at.x.shape[1])
    order = samples[:start][::-1] if backward else samples[start:]
    given = at.seen(data), window, job.shape
    ends, paths = filtered_paths(*given, z, spread, turning, order)
    if backward:
        paths = [np.hstack([path[:, ::-1], at.x[:, start:]]) for path in paths]
    else:
        paths = [np.hstack([at.x[:, :start], path]) for path in paths]
    pairs = zip(ends, paths, strict=True)
    return [replace(at, theta=end[:n], x=path) for end, path in pairs]


def alternative_sizes(job, solved) -> list:
    """Return the best hypothesis with other values of sizes that no touch determines.

    solved: the best first; sizes that one of them has are not proposed again.
    """
    best, shape, at = solved[0], job.shape, solved[0].at
    if not (best.solution.success and getattr(shape, "symmetries", ())):
        return []  # the unknowns are not side lengths
    mean, deviation = shape.size_prior
    chosen = final_unknowns(best.problem)
    C, *_ = reduced_covariance(best.problem, best.solution, chosen)
    faces, proposed = best.touched, []
    for axis in (0, 1):
        known = faces[axis].min() >= KNOWN_FACE
        if known or np.sqrt(max(C[axis, axis], 0.0)) > UNOBSERVED_SHARE * deviation:
            continue
        for size in (mean - deviation, mean):
            off = [abs(size - s.at.theta[axis]) for s in solved]
            if off[0] > SAME_OPTIMUM and min(off) > SIZE_TRIED:
                proposed.append(resized(at, axis, size, faces[axis]))
    return proposed


def resized(hypothesis, axis: int, size: float, touched):
    """Return a planar hypothesis of another size [m], its touched face kept in place.

    touched (2,): samples on the face at the lower and at the upper end of the axis.
    A change of the height (axis 2) does not change a planar pose.
    """
    theta, x = hypothesis.theta.copy(), hypothesis.x.copy()
    low, high = np.asarray(touched) >= KNOWN_FACE
    way = (size - theta[axis]) / 2 * (int(low) - int(high))
    theta[axis] = size
    if axis < 2:
        turn = x[2] + axis * np.pi / 2
        x[:2] += way * np.array([np.cos(turn), np.sin(turn)])
    return replace(hypothesis, theta=theta, x=x)
