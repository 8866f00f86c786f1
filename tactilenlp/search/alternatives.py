"""Ask for another past, and for other sizes of what was touched on one face or none.

A search goes forward: what the first touches leave open is told by later ones, when
the path is chosen already.  So the path is followed backward once more, from where it
is well known, and the page solved from there.  No finger feels how far a body turned
while it was pushed, so that is tried several ways.

Pushes and friction make optima of an untouched size that look sharp: a thin body and a
thick one can explain the same data, nats apart.  Where physics alone claims to know
such a size, the page is solved again from other sizes, the touched face staying where
it is; what is found competes with the estimate and widens its sigma.
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
from .kalman_filter import follow
from .local_solve import best_first, opened, solved_from
from .multistart import raced
from .proposals import spherical

CLAIMED = 0.5  # [prior deviations] a size less certain than this claims nothing
NEAR = 6e-3  # [m] sizes this close to the best one's lead to the same optimum
RISEN = 0.5  # [nats] an objective that rises by less has no better past
CLEAR = 0.8  # [nats an action] what precise fingers felt costs no more on a right path
PASTS = 3  # actions that have a middle to go back from
JUMPS = 3  # of a path at most that are followed over, the longest first
JUMP = 1e-3  # [m] between actions that is worth a rival
NOISE = 3.0  # [position noise] that makes jumps this long
TURNING = (1.0, 0.3, 0.1)  # [-] how readily an object may have turned in the past
KNOWN_SIZE = 1e-4  # [m] deviation of sizes, where a path is followed backward
OPEN_SIZE = 10e-3  # [m] and where a jump may come from sizes that are wrong
KNOWN_POSE = np.r_[3e-4, 3e-4, 5e-3]  # [m, m, rad] and of the pose it starts from
KNOWN = 3e-3  # [m] sizes this close to those of another hypothesis are known


def challenged(job, page, solved, options, start=None) -> list:
    """Return the solved hypotheses and their rivals, best first.

    start: the estimate that this one carries on, if its rivals were asked for; what is
    good of them is among the hypotheses, so others are asked for only now and then.
    """
    if not job.reductions.planar:
        return solved
    levels = opened(page.LEVELS, final=True)

    def with_rivals(solved, proposed) -> list:
        rivals = raced(job, page, proposed(job, solved), options, levels, known=solved)
        return best_first([*solved, *rivals])

    anew = start is None or _asks(job, solved[0], start)
    over = partial(unbroken, since=0 if anew else start.measurements.actions)
    for _ in range(JUMPS):
        best, solved = solved[0], with_rivals(solved, over)
        if solved[0] is best:
            break
    if anew:
        if not _explains(job, solved[0]):
            solved = with_rivals(solved, other_pasts)
        solved = with_rivals(solved, other_sizes)
        solved = best_first([*solved, *softened(job, page, solved, options)])
    good = [s for s in solved if s.solution.success]
    return good or solved


def _explains(job, best) -> bool:
    """Tell whether a path explains what precise fingers felt: few do so better.

    Of noise each touch costs a nat or so, and which ones are too dear no one can tell.
    """
    enough = CLEAR * job.data.actions
    good = best.solution.success and best.solution.objective < enough
    return good and precise(job.data, job.precision)


def settled(best, start) -> bool:
    """Tell whether what was felt since an estimate leaves its path as it is.

    More data cost no less: where the objective has not risen there is nothing to gain.
    """
    risen = best.solution.objective > start.objective + RISEN
    return best.solution.success and not risen


def _asks(job, best, start) -> bool:
    """Tell whether what was felt since an estimate asks for another past.

    Noise lifts the objective by itself; then a past is asked for where there is a new
    middle.
    """
    moved = middle(job.data.actions) != middle(start.measurements.actions)
    asked = moved or precise(job.data, job.precision)
    return asked and not settled(best, start)


def softened(job, page, solved, options) -> list:
    """Return the best one solved anew from where its own softer problem ends, if any.

    A page that has levels for guessed poses (`ROUGH`) says how to soften it: kinks of
    sliding and sticking that hold a path are rounded there, and it slips over them.
    """
    levels = getattr(page, "ROUGH", ())[-2:]
    return (
        [solved_from(job, page, solved[0].at, options, levels=levels)] if levels else []
    )


def middle(actions: int) -> int:
    """Return how many of so many actions make the first half."""
    return (actions + 1) // 2


def other_pasts(job, solved) -> list:
    """Return the best hypothesis with its first half followed backward from the second.

    Poses before the middle action, from its first one: size and pose are known there,
    so every earlier touch moves the path as little as it can, and turns it more or less
    readily (TURNING).
    """
    at, action = solved[0].at, job.data.action
    actions = np.unique(action)
    if len(actions) < PASTS:
        return []
    start = int(np.argmax(action == actions[middle(len(actions))]))
    return _followed(job, at, start, True, [KNOWN_SIZE] * len(TURNING), TURNING)


def unbroken(job, solved, since=0) -> list:
    """Return the best hypothesis without its longest jump between actions, if any.

    since: the first so many actions were asked about before.

    Nothing moves an object while no finger is near: a jump is a wrong turn, taken
    before it or after it.  So the path is followed from one side over the other.
    """
    at, asked = solved[0].at, max(since - 1, 0)
    way = jumps(job.data, at.x)[asked:]
    if way.max(initial=0.0) < worth(job.precision):
        return []
    start = int(starts_of(job.data)[asked + np.argmax(way)])
    sizes = [KNOWN_SIZE, OPEN_SIZE]
    return [h for b in (True, False) for h in _followed(job, at, start, b, sizes)]


def jumps(data, x) -> np.ndarray:
    """Return how far (actions - 1,) [m] a body at poses x jumps between actions.

    Along the ground; where it lies flat, a radian of turn counts as ARM.
    """
    first = starts_of(data)
    jump = x[:, first] - x[:, first - 1]
    turn = ARM * jump[2] if is_planar(x) else 0.0
    return np.hypot(np.linalg.norm(jump[:2], axis=0), turn)


def worth(precision) -> float:
    """Return how long a jump between actions must be to be worth a rival [m]."""
    return max(JUMP, NOISE * precision.position)


def starts_of(data) -> np.ndarray:
    """Return the first sample (actions - 1,) of every action but the first one."""
    return 1 + np.nonzero(np.diff(data.action))[0]


def _followed(job, at, start: int, backward: bool, sizes, turning=None) -> list:
    """Return the hypothesis followed backward from `start`, or forward over it.

    One for each of `sizes` [m], by how much the sizes may be off, and of `turning` [-],
    how readily it turns.
    """
    data, window = spherical(job)
    n, here = len(at.theta), start - (not backward)
    z = np.tile(np.r_[at.theta, at.x[:, here]], (len(sizes), 1))
    deviations = [np.r_[np.full(n, size), KNOWN_POSE] for size in sizes]
    spread = np.array([np.diag(d**2) for d in deviations])
    turning = np.ones(len(sizes)) if turning is None else np.array(turning)
    samples = np.arange(at.x.shape[1])
    order = samples[:start][::-1] if backward else samples[start:]
    given = at.seen(data), window, job.shape
    ends, paths = follow(*given, z, spread, turning, order)
    if backward:
        paths = [np.hstack([path[:, ::-1], at.x[:, start:]]) for path in paths]
    else:
        paths = [np.hstack([at.x[:, :start], path]) for path in paths]
    pairs = zip(ends, paths, strict=True)
    return [replace(at, theta=end[:n], x=path) for end, path in pairs]


def other_sizes(job, solved) -> list:
    """Return the best hypothesis with other sizes that physics alone speaks against.

    solved: the best first; sizes that one of them has are no others.
    """
    best, shape, at = solved[0], job.shape, solved[0].at
    if not (best.solution.success and getattr(shape, "symmetries", ())):
        return []  # not a body whose unknowns are the lengths of its sides
    mean, deviation = shape.size_prior
    chosen = final_unknowns(best.problem)
    C, *_ = reduced_covariance(best.problem, best.solution, chosen)
    faces, proposed = best.touched, []
    for axis in (0, 1):
        known = faces[axis].min() >= KNOWN_FACE
        if known or np.sqrt(max(C[axis, axis], 0.0)) > CLAIMED * deviation:
            continue
        for size in (mean - deviation, mean):
            off = [abs(size - s.at.theta[axis]) for s in solved]
            if off[0] > NEAR and min(off) > KNOWN:
                proposed.append(resized(at, axis, size, faces[axis]))
    return proposed


def resized(hypothesis, axis: int, size: float, touched):
    """Return a planar hypothesis of another size [m], its touched face where it was.

    touched (2,): samples on the face at the lower and at the upper end of the axis.
    The height (axis 2) of what lies on the ground leaves a planar pose where it is.
    """
    theta, x = hypothesis.theta.copy(), hypothesis.x.copy()
    low, high = np.asarray(touched) >= KNOWN_FACE
    way = (size - theta[axis]) / 2 * (int(low) - int(high))
    theta[axis] = size
    if axis < 2:
        turn = x[2] + axis * np.pi / 2
        x[:2] += way * np.array([np.cos(turn), np.sin(turn)])
    return replace(hypothesis, theta=theta, x=x)
