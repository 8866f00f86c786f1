"""A hypothesis: one local optimum of where the object is, what it is, how it moved.

Which face was touched, which way the object is turned, how it was pushed: every answer
is a hypothesis of its own.  They are compared by the body at the first and last pose.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from weakref import WeakKeyDictionary

import numpy as np

from ..problem.poses import planar_corners

SAME = 1e-3  # [m] hypotheses whose corners agree this well are one
HOPELESS = 60.0  # [nats] behind the best start or hypothesis: not followed up
ENDS = (0, -1)  # the poses by which bodies are compared: the first and the last


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One local optimum: theta (n,) [m], poses x (unknowns, T), objective [nats].

    Poses are planar (3, T), or free (6, T) where a solve of free motion starts or ends;
    path: the guess it came from, one word an action; offset (3, F) [m] of the fingers,
    where these are not known exactly.
    """

    theta: np.ndarray
    x: np.ndarray
    objective: float
    path: tuple[str, ...]
    iterations: int = 0
    offset: np.ndarray | None = None

    @property
    def rank(self) -> float:
        """The objective to sort by: symmetric twins are a tie, the first one wins."""
        return round(self.objective, 3)

    @property
    def end(self) -> np.ndarray:
        """Theta and the last pose (n + 3,)."""
        return np.r_[self.theta, self.x[:, -1]]

    def seen(self, data):
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


class Kinds(dict):
    """Kinds of terms by page and motion; they stay in the process that derived them."""

    def __reduce__(self):
        return Kinds, ()


# Where estimates came from, and the kinds that solving them took: an update shares
# them as long as the estimate is in this process.
_solved: WeakKeyDictionary[Hypothesis, tuple[tuple, Kinds]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Job:
    """What a solve needs to know, picklable: the data so far and how to read them."""

    data: object
    scene: object
    shape: object
    precision: object
    reductions: object
    deadline: float
    first: tuple = ()  # (name, theta, x) guesses of the first touch, if a user has some
    cuts: tuple = ()  # samples within still spans that need a pose of their own
    kinds: Kinds = field(default_factory=Kinds)

    def kinds_of(self, page, window) -> dict:
        """Return the kinds that the problems of a page share, if they are alike.

        They are where the functions of terms depend on page, shape, scene and motion,
        not on what else a window holds: a page says so by ALIKE.
        """
        if not getattr(page, "ALIKE", False):
            return {}
        return self.kinds.setdefault((page, window.motion, window.frictionless), {})

    def remember(self, origin: Hypothesis, page) -> None:
        """Keep the kinds for whoever goes on from the estimate of this origin."""
        _solved[origin] = (self.scene, self.shape, page.build), self.kinds

    def recall(self, origin: Hypothesis, page) -> None:
        """Take the kinds of an estimate of this origin, if it was solved here."""
        of, kinds = _solved.get(origin, (None, {}))
        if of == (self.scene, self.shape, page.build):  # not of a page that was edited
            self.kinds.update(kinds)


def distinct(
    shape, found, count: int, hopeless=HOPELESS, samples=ENDS
) -> list[Hypothesis]:
    """Return the best `count` hypotheses of which no two are the same body."""
    kept = []
    for h in sorted(found, key=lambda h: h.rank):
        if kept and h.objective > kept[0].objective + hopeless:
            break
        if len(kept) < count and not any(same(shape, h, k, samples) for k in kept):
            kept.append(h)
    return kept


def same(shape, a: Hypothesis, b: Hypothesis, samples=ENDS) -> bool:
    """Tell whether two hypotheses are one: corners agree at the given samples."""
    for k in samples:
        corners = [planar_corners(shape, h.theta, h.x[:, k]) for h in (a, b)]
        apart = np.linalg.norm(corners[0][:, None] - corners[1][None], axis=2)
        if max(apart.min(axis=0).max(), apart.min(axis=1).max()) > SAME:
            return False
    return True
