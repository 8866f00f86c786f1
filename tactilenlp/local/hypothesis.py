"""A hypothesis: one local optimum of shape and trajectory, and how two are compared.

Which face was touched, which way the object is turned, how it was pushed: each answer
is a hypothesis of its own.  Two are the same body where their supports agree at the
first and at the last pose.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import ClassVar

import numpy as np

from ..common.brief import printed
from ..common.layout import ANY
from ..geometry.faces import KNOWN_FACE
from ..geometry.transforms import is_planar, matrices
from ..information.mixture import relabellings
from ..tracking.surface import supports, trajectory_outline
from ..tracking.tracks import diverse
from .margins import ranked

SAME_BODY = 1e-3  # [m] supports of one body agree this well
COMPARED = (0, -1)  # samples at which bodies are compared: first, last
EVERY = 8  # samples of a trajectory that are compared
# Starts that are far from each other (by trial on the shared boxes, as margins.py):
FAR_APART = 4e-3  # [m] root mean square distance of trajectories that count as far
FAR_BONUS = 6.0  # [nats] that a trajectory as far from those chosen may cost more
HOPELESS_START = 25.0  # [nats] behind the best


@printed
@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One local optimum: theta (n,) [m], poses x (unknowns, T), objective [nats].

    Poses are planar (3, T), or free (6, T) where a solve of free motion starts or ends;
    path: the proposals that led to it, one word an action; offset (3, F) [m] of the
    fingers, where their positions are not known exactly; carried: whether it was, by
    hand, between two actions; closed: whether every face was touched, of a polytope;
    compliance [m per weight] of the fingertips, where it was an unknown.
    """

    theta: np.ndarray
    x: np.ndarray
    objective: float
    path: tuple[str, ...]
    iterations: int = 0
    offset: np.ndarray | None = None
    carried: bool = False
    closed: bool = False
    compliance: float | None = None

    LAYOUT: ClassVar = {  # of the arrays in a file
        "theta": (ANY,), "x": (ANY, ANY), "offset": (3, ANY),
    }  # fmt: skip

    @classmethod
    def from_file(cls, path, **fields) -> Hypothesis:
        """Return that of a file, where `closed` may be a word of the path alone."""
        return cls(path=path, **{"closed": "closed" in path} | fields)

    @property
    def rank(self) -> float:
        """The objective to sort by, rounded: of symmetric twins the first one wins."""
        return ranked(self.objective)

    @property
    def end(self) -> np.ndarray:
        """Theta and the last pose (n + 3,), (n + 6,) in free motion."""
        return np.r_[self.theta, self.x[:, -1]]

    def with_offset(self, data):
        """Return the measurements with the fingers where this hypothesis has them."""
        if self.offset is None:
            return data
        return replace(data, finger_position=data.finger_position + self.offset.T)

    @property
    def shift(self) -> np.ndarray:
        """The offset of the fingers (3, F) [m]; (3, 1) of zeros where it is known."""
        return np.zeros((3, 1)) if self.offset is None else self.offset

    def at(self, samples: int) -> Hypothesis:
        """Return the hypothesis of the first samples only."""
        return replace(self, x=self.x[:, :samples])


def distinct(
    shape, hypotheses, count: int, hopeless: float, samples=COMPARED,
    key=lambda h: h.rank,
) -> list[Hypothesis]:  # fmt: skip
    """Return the best `count` hypotheses of which no two are the same body.

    hopeless [nats]: none that is further behind the best; samples: where bodies are
    compared; key: to sort by, the best first.
    """
    chosen = []
    for h in sorted(hypotheses, key=key):
        if chosen and h.objective > chosen[0].objective + hopeless:
            break
        again = (same_body(shape, h, other, samples) for other in chosen)
        if len(chosen) < count and not any(again):
            chosen.append(h)
    return chosen


def diverse_starts(shape, hypotheses, count: int) -> list[Hypothesis]:
    """Return good hypotheses far from each other, every second one of another yaw.

    Places along a touched face alone would take all starts, and leave its edges none.
    """
    far = far_apart(shape, hypotheses, count - count // 2)
    rest = [h for h in hypotheses if all(h is not other for other in far)]
    rest = [h for h in rest if h.objective < far[0].objective + HOPELESS_START]
    order = [*far, *sorted(rest, key=lambda h: h.objective)]
    yaw = np.array([h.x[2, -1] for h in order])
    chosen = diverse(_modulo_turns(shape, yaw), count).tolist()
    half = len(chosen) - len(chosen) // 2
    pairs = zip_longest(chosen[:half], chosen[half:])
    return [order[i] for pair in pairs for i in pair if i is not None]


def _modulo_turns(shape, yaw):
    """Return yaws [rad] within the turns about the vertical that leave a body the same.

    The circular mean is in the middle, so that nearly equal yaws stay together.
    """
    turns = len(relabellings(shape, upright=True))
    middle = np.angle(np.exp(1j * turns * yaw).mean()) / turns
    return (yaw - middle + np.pi / turns) % (2 * np.pi / turns)


def far_apart(shape, hypotheses, count: int) -> list[Hypothesis]:
    """Return the best hypothesis, then good ones whose trajectories are far."""
    outlines = np.array([trajectory_outline(shape, h, EVERY) for h in hypotheses])
    cost = np.array([h.objective for h in hypotheses])
    chosen, off = [int(np.argmin(cost))], np.full(len(cost), np.inf)
    while len(chosen) < min(count, len(cost)):
        ways = outlines[chosen[-1]] - outlines
        off = np.minimum(off, np.sqrt((ways**2).sum(axis=2).mean(axis=(1, 2))))
        score = cost - FAR_BONUS * np.minimum(1.0, off / FAR_APART)
        score[chosen] = np.inf
        i = int(np.argmin(score))
        if cost[i] > cost[chosen[0]] + HOPELESS_START or not np.isfinite(score[i]):
            break
        chosen.append(i)
    return [hypotheses[i] for i in chosen]


def same_body(shape, a: Hypothesis, b: Hypothesis, samples=COMPARED) -> bool:
    """Tell whether two hypotheses are the same body at the given samples."""
    pairs = ([supports(shape, h, k) for h in (a, b)] for k in samples)
    return all(np.abs(s - t).max() <= SAME_BODY for s, t in pairs)


def resized(hypothesis, axis: int, size: float, touched):
    """Return a hypothesis of another size [m], its touched face kept in place.

    touched (2,): samples on the face at the lower and at the upper end of the axis.
    A change of the height (axis 2) does not change a planar pose.
    """
    theta, x = hypothesis.theta.copy(), hypothesis.x.copy()
    low, high = np.asarray(touched) >= KNOWN_FACE
    way = (size - theta[axis]) / 2 * (int(low) - int(high))
    theta[axis] = size
    if not is_planar(x):
        x[:3] += way * matrices(x)[:, :, axis].T
    elif axis < 2:
        turn = x[2] + axis * np.pi / 2
        x[:2] += way * np.array([np.cos(turn), np.sin(turn)])
    return replace(hypothesis, theta=theta, x=x)
