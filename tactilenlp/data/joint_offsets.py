r"""What is known of fingers whose joints count from angles that are a little wrong.

A finger's joints are off by d ~ N(0, sigma^2): its tip at `place` by e = J d, and it is
turned by W d, (J, W) = jacobian.  With J^+ e for d, at p it is off by

    e + sum_k (p - place)_k (dJ / dp_k) J^+ e        and turned by        W J^+ e.

e (3,) [m] is what is estimated; its covariance is sigma^2 J J'.  The turn is what tells
of it: the sides of a body on level ground seem to lean, by as much as the finger does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import SceneError

WIDEST = 0.35  # [rad], 20 degrees: beyond it a deviation was given in degrees
LAYOUT = {  # of each finger
    "place": ((3,), "[m]"),
    "jacobian": ((6, 3), "[m/rad, 1]"),
    "change": ((3, 3, 3), "[1/rad]"),
}


@dataclass(frozen=True)
class JointZeros:
    """Say how wrong zero angles of joints put fingers elsewhere and turn them; world.

    sigma:    [rad], standard deviation of each joint's zero angle
    place:    (F, 3) [m], of each tip, amid its work
    jacobian: (F, 6, 3) [m/rad, 1], there: how each joint moves, then turns the tip
    change:   (F, 3, 3, 3) [1/rad], d jacobian[:3, joint] / d place: row, joint, x y z

    Those of a TriFinger's fingers: hardware.kinematics.joints_about.
    """

    sigma: float
    place: tuple
    jacobian: tuple
    change: tuple

    def __post_init__(self) -> None:
        sigma = np.asarray(self.sigma)
        if sigma.ndim or sigma.dtype.kind not in "iuf" or not 0 < sigma < WIDEST:
            raise SceneError(
                "no deviation of an angle", where="JointZeros.sigma", got=self.sigma,
                expected=f"one number above 0 and below {WIDEST} rad",
                next="np.deg2rad(1.0) is a degree",
            )  # fmt: skip
        object.__setattr__(self, "sigma", float(sigma))
        for name in LAYOUT:
            array = _numbers(name, getattr(self, name), self.fingers)
            object.__setattr__(self, name, _tuples(array.tolist()))
        if (np.linalg.cond(self._J) > 1e6).any():
            raise SceneError(
                "joints that cannot move the tip every way",
                where="JointZeros.jacobian", expected="three independent joints",
            )  # fmt: skip

    @property
    def fingers(self) -> int:
        """The number of fingers F."""
        return len(self.place) if np.ndim(self.place) else 0

    @property
    def _J(self) -> np.ndarray:
        return np.array(self.jacobian)[:, :3]

    @property
    def slope(self) -> np.ndarray:
        """(F, 3, 3, 3) [1/m]: how e (middle index) changes along x, y, z (last)."""
        return np.einsum("fijk,fjl->filk", self.change, np.linalg.inv(self._J))

    @property
    def turn(self) -> np.ndarray:
        """(F, 3, 3) [rad/m]: the turn of a finger that is off by e."""
        return np.array(self.jacobian)[:, 3:] @ np.linalg.inv(self._J)

    @property
    def covariance(self) -> np.ndarray:
        """(F, 3, 3) [m^2] of e."""
        return self.sigma**2 * self._J @ self._J.transpose(0, 2, 1)

    @property
    def information(self) -> np.ndarray:
        """(F, 9) [1/m^2]: the inverse of each covariance, as a page reads it."""
        return np.linalg.inv(self.covariance).reshape(-1, 9)

    def beside(self, said: np.ndarray, finger: np.ndarray) -> np.ndarray:
        """Return rows (n, N), each beside 39 numbers that a page reads."""
        slope = self.slope.transpose(0, 3, 2, 1).reshape(-1, 27)
        turn = self.turn.transpose(0, 2, 1).reshape(-1, 9)
        return np.hstack([said, np.hstack([self.place, slope, turn])[finger]])

    def off(self, said: np.ndarray, e: np.ndarray) -> np.ndarray:
        """Return by how much fingers that say (..., F, 3) [m] are off; e (F, 3) [m]."""
        way = np.asarray(said) - self.place
        return e + np.einsum("...fk,filk,fl->...fi", way, self.slope, e)

    def seen_from(self, ground) -> JointZeros:
        """Return the same in the frame of a Ground."""
        R = ground.rotation
        J = np.array(self.jacobian)
        J = np.concatenate([R @ J[:, :3], R @ J[:, 3:]], axis=1)
        change = np.einsum("ai,fijk,bk->fajb", R, self.change, R)
        return JointZeros(self.sigma, ground.to_ground(self.place), J, change)


def _numbers(name: str, value, fingers: int) -> np.ndarray:
    shape, unit = LAYOUT[name]
    words = ", ".join(["F", *map(str, shape)])
    try:
        array = np.asarray(value, float)
        fit = array.shape == (fingers, *shape) and np.isfinite(array).all()
    except (TypeError, ValueError):  # words, ragged lists
        fit = False
    if fit and fingers:
        return array
    raise SceneError(
        "not the numbers of fingers", where=f"JointZeros.{name}", got=repr(value)[:60],
        expected=f"({words}) {unit}, of as many fingers as place",
        next="stack those of every finger",
    )  # fmt: skip


def _tuples(nested):
    return tuple(map(_tuples, nested)) if isinstance(nested, list) else nested
