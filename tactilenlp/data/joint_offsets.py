r"""Joint offsets: the prior of finger offsets caused by wrong zero angles of joints.

The zero angles of a finger's joints have errors d ~ N(0, sigma^2).  They displace the
tip at `place` by e = J d and rotate it by W d, (J, W) = jacobian.  With d = J^+ e, the
displacement and the rotation at p are

    e + sum_k (p - place)_k (dJ / dp_k) J^+ e        and        W J^+ e.

e (3,) [m] is estimated; its covariance is sigma^2 J J'.  The rotation makes it
observable: the sides of a body on level ground seem to lean by as much as the finger.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..common.brief import printed
from ..common.validation import as_floats, numbers_of
from ..errors import SceneError, typed_call
from .ground import scene_number

LARGEST_JOINT_SIGMA = 0.35  # [rad], 20 degrees: a larger one was given in degrees
JOINT_LAYOUT = {  # of each finger
    "place": ((3,), "[m]"),
    "jacobian": ((6, 3), "[m/rad, 1]"),
    "change": ((3, 3, 3), "[1/rad]"),
}


@printed
@typed_call()
@dataclass(frozen=True)
class JointZeros:
    """How wrong zero angles of joints displace and rotate fingers, world frame.

    sigma:    [rad], standard deviation of each joint's zero angle
    place:    (F, 3) [m], of each tip, in the middle of its work space
    jacobian: (F, 6, 3) [m/rad, 1], there: displacement, then rotation of the tip
    change:   (F, 3, 3, 3) [1/rad], d jacobian[:3, joint] / d place: row, joint, x y z

    For a TriFinger: hardware.kinematics.joints_about.
    """

    sigma: float
    place: tuple
    jacobian: tuple
    change: tuple

    def __post_init__(self) -> None:
        expected = f"one number above 0 and below {LARGEST_JOINT_SIGMA} rad"
        limits = np.nextafter(0.0, 1.0), LARGEST_JOINT_SIGMA
        fix = "give radians: np.deg2rad(1.0) is one degree"
        sigma = scene_number("JointZeros.sigma", self.sigma, expected, *limits, fix)
        object.__setattr__(self, "sigma", sigma)
        for name, (shape, unit) in JOINT_LAYOUT.items():
            array = numbers_of(
                f"JointZeros.{name}", getattr(self, name), SceneError,
                max(self.fingers, 1), *shape, finite=True,
                unit=f"{unit}, of as many fingers as place",
                next="stack the arrays of all fingers",
            )  # fmt: skip
            object.__setattr__(self, name, _tuples(array.tolist()))
        if (np.linalg.cond(self._J) > 1e6).any():
            raise SceneError(
                "the joints cannot move the tip in all directions",
                where="JointZeros.jacobian", expected="three independent joints",
            )  # fmt: skip

    @property
    def fingers(self) -> int:
        """The number of fingers F."""
        return len(np.atleast_1d(as_floats(self.place)))

    @property
    def _J(self) -> np.ndarray:
        """The Jacobians of the positions (F, 3, 3) [m/rad]."""
        return np.array(self.jacobian)[:, :3]

    @property
    def slope(self) -> np.ndarray:
        """(F, 3, 3, 3) [1/m]: how e (middle index) changes along x, y, z (last)."""
        return np.einsum("fijk,fjl->filk", self.change, np.linalg.inv(self._J))

    @property
    def turn(self) -> np.ndarray:
        """(F, 3, 3) [rad/m]: the rotation of a finger displaced by e."""
        return np.array(self.jacobian)[:, 3:] @ np.linalg.inv(self._J)

    @property
    def covariance(self) -> np.ndarray:
        """(F, 3, 3) [m^2]: the covariance of e."""
        return self.sigma**2 * self._J @ self._J.transpose(0, 2, 1)

    @property
    def information(self) -> np.ndarray:
        """(F, 9) [1/m^2]: the inverse of each covariance, flattened for the page."""
        return np.linalg.inv(self.covariance).reshape(-1, 9)

    def with_numbers(self, p_wf: np.ndarray, finger: np.ndarray) -> np.ndarray:
        """Return rows `p_wf` (n, N) with the 39 numbers of their fingers appended."""
        slope = self.slope.transpose(0, 3, 2, 1).reshape(-1, 27)
        turn = self.turn.transpose(0, 2, 1).reshape(-1, 9)
        return np.hstack([p_wf, np.hstack([self.place, slope, turn])[finger]])

    def displacement(self, p_wf: np.ndarray, e: np.ndarray) -> np.ndarray:
        """Return the displacements (..., F, 3) [m] at measured positions; e (F, 3)."""
        way = np.asarray(p_wf) - self.place
        return e + np.einsum("...fk,filk,fl->...fi", way, self.slope, e)

    def in_frame_of(self, ground) -> JointZeros:
        """Return the same in the frame of a Ground."""
        R = ground.rotation
        J = np.array(self.jacobian)
        J = np.concatenate([R @ J[:, :3], R @ J[:, 3:]], axis=1)
        change = np.einsum("ai,fijk,bk->fajb", R, self.change, R)
        return JointZeros(self.sigma, ground.to_ground(self.place), J, change)


def _tuples(nested):
    return tuple(map(_tuples, nested)) if isinstance(nested, list) else nested
