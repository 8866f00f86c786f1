"""Ask for other sizes of what was touched on one face only, or on none.

Pushes and friction make optima of an untouched size that look sharp: a thin body and a
thick one can explain the same data, nats apart.  Where physics alone claims to know
such a size, the page is solved again from other sizes, the touched face staying where
it is; what is found competes with the estimate and widens its sigma.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from .information import ENOUGH, TOUCHED, reduced_covariance
from .result import poses, touched_faces
from .search import RIVAL
from .trial import opened

CLAIMED = 0.5  # [prior deviations] a size less certain than this claims nothing
NEAR = 6e-3  # [m] sizes this close lead to the same optimum


def challenged(job, page, solved, options, solve) -> list:
    """Return the solved hypotheses and their rivals of other sizes, best first.

    solve: (job, page, hypothesis, options, shared, levels) -> solved.
    """
    best, shared = solved[0], {}
    if not (job.reductions.planar and best.solution.success):
        return solved
    found = list(solved)
    for h in other_sizes(job, best):
        if time.monotonic() > job.deadline:
            break
        rough = opened(page.LEVELS, final=False)
        rival = solve(job, page, h, options, shared, rough)
        if rival.solution.objective > best.solution.objective + RIVAL:
            continue
        rival = solve(job, page, rival.at, options, shared, page.LEVELS[-1:])
        if rival.solution.success:
            found.append(rival)
    return sorted(found, key=lambda s: (not s.solution.success, s.solution.objective))


def other_sizes(job, best) -> list:
    """Return the best hypothesis with other sizes that physics alone speaks against."""
    shape, at = job.shape, best.at
    if not getattr(shape, "symmetries", ()):
        return []  # not a body whose unknowns are the lengths of its sides
    mean, deviation = shape.size_prior
    C, *_ = reduced_covariance(best.problem, best.solution, np.arange(shape.theta))
    _, turned = poses(shape, best.window.motion, at.theta, at.x, None)
    faces = touched_faces(job.data, turned, TOUCHED)
    proposed = []
    for axis in (0, 1):
        known = faces[axis].min() >= ENOUGH
        if known or np.sqrt(max(C[axis, axis], 0.0)) > CLAIMED * deviation:
            continue
        for size in (mean - deviation, mean):
            if abs(size - at.theta[axis]) > NEAR:
                proposed.append(resized(at, axis, size, faces[axis]))
    return proposed


def resized(hypothesis, axis: int, size: float, touched):
    """Return a planar hypothesis of another size [m], its touched face where it was.

    touched (2,): samples on the face at the lower and at the upper end of the axis.
    """
    theta, x = hypothesis.theta.copy(), hypothesis.x.copy()
    low, high = np.asarray(touched) >= ENOUGH
    way = (size - theta[axis]) / 2 * (int(low) - int(high))
    theta[axis] = size
    turn = x[2] + axis * np.pi / 2
    x[:2] += way * np.array([np.cos(turn), np.sin(turn)])
    return replace(hypothesis, theta=theta, x=x)
