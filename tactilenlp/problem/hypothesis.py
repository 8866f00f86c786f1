"""A hypothesis: one local optimum of shape and trajectory, what a solve starts from.

Which face was touched, which way the object is turned, how it was pushed: each answer
is a hypothesis of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ..common.brief import printed
from ..common.layout import ANY
from ..geometry.faces import KNOWN_FACE
from ..geometry.transforms import is_planar, matrices, planar_matrix

UNSEARCHED = "a search from action"  # what a deadline omits: poses from there on stay


def ranked(objective: float) -> float:
    """Return an objective to sort by, rounded: of symmetric twins the first wins."""
    return round(objective, 3)


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
        fields.pop("iterations", None)  # of older files
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

    def at(self, samples: int) -> Hypothesis:
        """Return the hypothesis of the first samples only."""
        return replace(self, x=self.x[:, :samples])

    def with_axes_of_ground(self) -> tuple[Hypothesis, np.ndarray]:
        """Return the planar motion of a polytope in axes of the ground at the end.

        The second result is the rotation (3, 3) from the axes before to those now.
        """
        turn = planar_matrix(yaw := self.x[2, -1])
        theta = (self.theta.reshape(-1, 3) @ turn.T).ravel()
        return replace(self, theta=theta, x=self.x - [[0.0], [0.0], [yaw]]), turn


def resized(hypothesis, axis: int, size: float, touched):
    """Return a hypothesis of another size [m], its touched face kept in place.

    touched (2,): samples on the face at the lower and at the upper end of the axis.
    A change of the height (axis 2) does not change a planar pose; one of a size that is
    no width along an axis (axis 3 and on) changes no pose.
    """
    theta, x = hypothesis.theta.copy(), hypothesis.x.copy()
    low, high = np.asarray(touched) >= KNOWN_FACE
    way = (size - theta[axis]) / 2 * (int(low) - int(high))
    theta[axis] = size
    if axis > 2:
        return replace(hypothesis, theta=theta)
    if not is_planar(x):
        x[:3] += way * matrices(x)[:, :, axis].T
    elif axis < 2:
        turn = x[2] + axis * np.pi / 2
        x[:2] += way * np.array([np.cos(turn), np.sin(turn)])
    return replace(hypothesis, theta=theta, x=x)
