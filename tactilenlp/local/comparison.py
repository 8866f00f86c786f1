"""Compare two hypotheses: whether they are the same body, and how far apart.

They are the same body where their supports agree at the first and at the last pose.
"""

from __future__ import annotations

from itertools import zip_longest

import numpy as np

from ..information.mixture import relabellings
from ..problem.hypothesis import Hypothesis
from ..tracking.surface import supports, trajectory_outline
from ..tracking.tracks import YAW_CELL

SAME_BODY = 1e-3  # [m] supports of one body agree this well
COMPARED = (0, -1)  # samples at which bodies are compared: first, last
EVERY = 8  # samples of a trajectory that are compared
# Starts that are far from each other (by trial on the shared boxes, as margins.py):
FAR_APART = 4e-3  # [m] root mean square distance of trajectories that count as far
FAR_BONUS = 6.0  # [nats] that a trajectory as far from those chosen may cost more
HOPELESS_START = 25.0  # [nats] behind the best


def distinct(
    shape, hypotheses, count: int, hopeless: float, samples=COMPARED,
    key=lambda h: h.rank, first=None,
) -> list[Hypothesis]:  # fmt: skip
    """Return the best `count` hypotheses of which no two are the same body.

    hopeless [nats]: none that is further behind the best; samples: where bodies are
    compared; key: to sort by, the best first; first: one of them that comes before all.
    """
    chosen = []
    for h in sorted(hypotheses, key=lambda h: (h is not first, key(h))):
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
    several = far_apart(shape, hypotheses, count)
    far, most = several[: count - count // 2], several[0].objective + HOPELESS_START
    good = sorted(hypotheses, key=lambda h: h.objective)
    good = [h for h in good if h.objective < most]
    others = of_other_yaw(shape, good, far)
    ids = {id(h) for h in (*far, *others)}
    rest = [*others, *(h for h in several if id(h) not in ids)]
    pairs = zip_longest(far, rest[: count - len(far)])
    return [h for pair in pairs for h in pair if h is not None]


def of_other_yaw(shape, hypotheses, known) -> list[Hypothesis]:
    """Return hypotheses that end with a yaw of none of those known, or before them.

    Others differ by YAW_CELL, within the turns that leave an upright body the same.
    """
    turn, others = 2 * np.pi / len(relabellings(shape, upright=True)), []
    yaws = [h.x[2, -1] for h in known]
    for h in hypotheses:
        off = (h.x[2, -1] - np.array(yaws) + turn / 2) % turn - turn / 2
        if np.abs(off).min(initial=np.pi) > YAW_CELL:
            others.append(h)
            yaws.append(h.x[2, -1])
    return others


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
