"""Compute the deviation of one unknown from its profile likelihood.

The page is solved again with one unknown held off its optimum by some steps [m], all
else free.  A `Profile` chooses how far the steps go, and tells what deviation the rises
of the objective mean.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from ..geometry.faces import KNOWN_FACE
from ..information.tangent_space import LEAST_SIGMA
from ..local.margins import BETTER_OPTIMUM, ONE_SIGMA, PROFILE_RISE
from ..local.solved import Solved

VAGUE_SHARE = 0.3  # [prior deviations] a larger sigma of a size needs no profile
FIRST_STEP = 0.5e-3  # [m] at least
MAX_STEP_GROWTH = 10.0  # [-] from step to step
# [-] at least, once a straight line would have ended: else 30 more solves on a plateau
PLATEAU_GROWTH = 1.5
# [-] behind the rise, or after a steep one: far solves are slow (109 iterations; 216
# with 4)
TAIL_GROWTH = 2.0
# [-] of the rise at which a profile ends: where a step rises by so much, twice as much
# as by the Hessian, it was too long; [-] steps that are near; [-] of the Hessian's rise
STEEP_RISE, BESIDE, AS_GAUSSIAN = 4.0, 1.5, 0.5
ENDED = 0.99  # [-] of the rise, or of the prior's deviation, at which a profile ends
POSTERIOR_NODES = 1000  # of the integral over a narrow optimum and a wide plateau


class Point(NamedTuple):
    """A solve with the unknown held off by a step [m], and its rise [nats]."""

    step: float
    rise: float
    solved: Solved


@dataclass(frozen=True, eq=False)
class Profile:
    """A profile of one of the sizes and unknowns of the final pose (k,).

    best: the solve at the optimum; axis: which one; prior [m]: the most that it may be
    off; touched (2,): samples on both faces of a size, None of a pose; seeks: whether a
    lower objective ends the profile; cost(change [m]) of a size that a touch leaves
    open: what the prior adds [nats].
    """

    best: Solved
    axis: int
    prior: float
    touched: np.ndarray | None = None
    seeks: bool = True
    cost: Callable | None = None

    @property
    def target_rise(self) -> float:
        """The rise of the objective [nats] at which the profile ends."""
        return PROFILE_RISE / 2 if self.touched is None else PROFILE_RISE

    def deviation(self, solve_held, direction, off):
        """Return by how much sizes and final pose are off (k,) where this one is.

        solve_held(step, start, direction, touched): the Point at a step, from the one
        before, or None; direction (unknowns,): by how much they change [1/m]; touched
        (2,): samples on both faces of a size, of which those touched stay, or None.
        direction, off: what all unknowns, and sizes and final pose (k,), do by the
        Hessian where it is off by a deviation, SI. The Hessian's deviation is kept
        where it is large, where there is no profile, and of an untouched size or a pose
        where it is the larger one.  The second result is a better solve, or None.
        A larger body is the flatter side: what lies behind a touched face contradicts
        no finger. A smaller one is solved where a larger one gives no result; of a pose
        both directions are solved, and the wider one counts.
        """
        axis, touched, widest = self.axis, self.touched, None
        hessian_sigma = max(off[axis], LEAST_SIGMA)
        off = off * min(1.0, self.prior / hessian_sigma)
        is_open = touched is None or touched.min() < KNOWN_FACE
        # Where a Gaussian costs twice as much; most cost half as much.
        first = np.sqrt(4 * self.target_rise) * hessian_sigma
        first = max(min(first, VAGUE_SHARE * self.prior), FIRST_STEP)
        first = min(first, self.prior)
        for way in (1, -1):
            solve = partial(
                solve_held, direction=way * direction / hessian_sigma,
                touched=touched if is_open and way > 0 else None,
            )  # fmt: skip
            least_sigma = abs((off if widest is None else widest)[axis])
            wide, better = self.one_side(solve, way, first, least_sigma)
            if better is not None:
                return off, better
            both = [d for d in (widest, wide) if d is not None]
            widest = max(both, key=lambda d: abs(d[axis]), default=None)
            if widest is not None and touched is not None:
                break
        if widest is None or (is_open and abs(widest[axis]) <= abs(off[axis])):
            return off, None
        return widest, None

    def one_side(self, solve, way: int, step: float, least_sigma: float):
        """Return the widest deviation (k,) in one direction, or None; a better optimum.

        solve(step, start): as above, in this direction; way: 1 or -1; least_sigma [m]:
        from the other direction or the Hessian.  The profile ends at the target
        rise, and beyond the distance at which that rise leaves a large deviation.  A
        steep rise, of 100 nats where a finger passed, tells nothing of what lies before
        it, and a solve over a long way can end in another optimum: it is repeated
        nearer.  Where the first one then rises as a Gaussian of least_sigma would, the
        profile ends.
        """
        prior, target_rise, best = self.prior, self.target_rise, self.best
        widest, points, steep = None, [Point(0.0, 0.0, best)], False
        vague, reached, least_growth = VAGUE_SHARE * prior, least_sigma, 1.0
        farthest = vague * np.sqrt(2 * target_rise)
        while reached < vague:
            if (point := solve(step, points[-1])) is None:
                break
            _, rise, solved = point
            if rise < -BETTER_OPTIMUM and self.seeks:
                return None, solved
            last = points[-1].step
            near = step <= max(BESIDE * last, FIRST_STEP)
            if rise > STEEP_RISE * target_rise and not near:
                first = max(step * np.sqrt(target_rise / rise), FIRST_STEP)
                step, steep = np.sqrt(last * step) if last else first, True
                continue
            points.append(point)
            deviation = self.deviation_at(point)
            if widest is None or deviation > reached:
                widest = (solved.at.end - best.at.end) * deviation / step
                reached = abs(widest[self.axis])
            if rise >= ENDED * target_rise or step >= farthest:
                break
            gaussian = (step / least_sigma) ** 2 / 2
            if steep and not last and rise > AS_GAUSSIAN * gaussian:
                break
            growth = max(least_growth, target_rise / max(rise, ONE_SIGMA))
            growth = min(TAIL_GROWTH if steep else MAX_STEP_GROWTH, growth)
            step = min(step * growth, farthest)
            least_growth = PLATEAU_GROWTH if rise > ONE_SIGMA else 1.0
        if self.cost is not None:  # a large deviation by the Hessian, or none
            least = least_sigma if vague <= least_sigma < ENDED * prior else 0.0
            widest = self.open_deviation(solve, way, widest, points, least)
        return widest, None

    def deviation_at(self, point: Point) -> float:
        """Return the deviation [m] of a Gaussian that has risen as much."""
        return min(point.step / np.sqrt(2 * max(point.rise, ONE_SIGMA)), self.prior)

    def open_deviation(self, solve, way, widest, points, least: float):
        """Return the deviation (k,) of an open size, or None; widest: by its profile.

        Solves farther off tell whether the rise levels off, until no plateau at the
        last rise would widen the deviation, and, at a deviation of the prior, whether a
        large one by the Hessian, least [m], 0 if there is none, is larger.
        """
        prior, most, last = self.prior, 2 * self.target_rise, points[-1]
        ended = last.rise >= ENDED * self.target_rise
        while last.step < prior and last.rise < most and (least or ended):
            plateau = self.of_posterior(way, [*points, last._replace(step=prior)])
            if not least and plateau <= abs(widest[self.axis]):
                break
            step = prior if least else min(TAIL_GROWTH * last.step, prior)
            if (point := solve(step, last)) is None:
                break
            last, points = point, [*points, point]
            if least:
                widest = (last.solved.at.end - self.best.at.end) * least / prior
        if widest is None or last.rise >= most:
            return widest
        deviation = min(self.of_posterior(way, points), prior)
        return widest * max(1.0, deviation / abs(widest[self.axis]))

    def of_posterior(self, way: int, points) -> float:
        """Return the root of the second moment [m] of exp(-rise), a posterior density.

        A plateau a few nats above a narrow optimum can have most of its mass.  Between
        the points the root of the rise is a straight line, as of a Gaussian; behind the
        last one what is not the prior's, cost(step), rises as before.
        """
        steps, rises = np.array([(p.step, max(p.rise, 0.0)) for p in points]).T
        d = np.linspace(0, self.prior * np.sqrt(2 * self.target_rise), POSTERIOR_NODES)
        rise, behind = np.interp(d, steps, np.sqrt(rises)) ** 2, d > steps[-1]
        rest = rises[-2:] - self.cost(way * steps[-2:])
        slope = max(0.0, (rest[1] - rest[0]) / (steps[-1] - steps[-2]))
        rise[behind] += slope * (d[behind] - steps[-1])
        rise[behind] += self.cost(way * d[behind]) - self.cost(way * steps[-1])
        density = np.exp(-rise)
        return float(np.sqrt((density * d**2).sum() / density.sum()))
