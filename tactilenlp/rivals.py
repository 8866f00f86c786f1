"""Ask for other sizes of what was touched on one face only, or on none.

Pushes and friction make optima of an untouched size that look sharp: a thin body and a
thick one can explain the same data, nats apart.  Where physics alone claims to know
such a size, the page is solved again from other sizes, the touched face staying where
it is; what is found competes with the estimate and widens its sigma.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .information import ENOUGH, TOUCHED, reduced_covariance
from .race import raced
from .result import poses, touched_faces
from .trial import opened

CLAIMED = 0.5  # [prior deviations] a size less certain than this claims nothing
NEAR = 6e-3  # [m] sizes this close to the best one's lead to the same optimum
KNOWN = 3e-3  # [m] sizes this close to those of another hypothesis are known


def challenged(job, page, solved, options) -> list:
    """Return the solved hypotheses and their rivals of other sizes, best first."""
    if not (job.reductions.planar and solved[0].solution.success):
        return solved
    levels = opened(page.LEVELS, final=True)
    rivals = raced(job, page, other_sizes(job, solved), options, levels, known=solved)
    found = [*solved, *(s for s in rivals if s.solution.success)]
    return sorted(found, key=lambda s: (not s.solution.success, s.solution.objective))


def other_sizes(job, solved) -> list:
    """Return the best hypothesis with other sizes that physics alone speaks against.

    solved: the best first; sizes that one of them has are no others.
    """
    best, shape, at = solved[0], job.shape, solved[0].at
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
            off = [abs(size - s.at.theta[axis]) for s in solved]
            if off[0] > NEAR and min(off) > KNOWN:
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
