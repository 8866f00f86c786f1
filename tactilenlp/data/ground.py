"""The ground that carries the object: a plane, its frame, how far it was turned."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..common.validation import (
    as_array,
    check_types,
    checked_array,
    checked_unit,
)
from ..errors import SceneError, shortened, typed_call
from .measurements import UNIT_EXACT

NORMAL_TOLERANCE = 1e-6  # [1], a normal further from unit length was not normalised
UPRIGHT = 0.5  # [1], cosine to the world's z from which places are told in x and y
FLIP_LIMIT = -0.9  # [1], cosine below which the shortest rotation to +z is ill-defined


@typed_call()
@dataclass(frozen=True)
class Ground:
    """The plane that the object rests on: all points p with normal . p = height.

    height: [m], of the plane above the world's origin, along the normal
    normal: (3,), unit, pointing up, world frame

    The ground frame g has the ground as z = 0 and the normal as +z; where the normal is
    the world's +z, its axes are exactly those of the world.  told: the ground as it was
    given, where this one was estimated from it (Scene.sigma_tilt); else None.
    """

    height: float = 0.0
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    told: Ground | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        height = scene_number("ground.height", self.height, "a height [m]")
        object.__setattr__(self, "height", height)
        object.__setattr__(self, "normal", _unit("ground.normal", self.normal))
        check_types(told=(self.told, (Ground, type(None))))

    @property
    def tilt(self) -> np.ndarray:
        """(3,) from the ground that was told, world frame: axis times sine of angle."""
        original = self if self.told is None else self.told
        return np.cross(original.normal, self.normal)

    def turned(self, tilt, about) -> Ground:
        """Return the ground turned by rotations (2,) [rad] about its own x and y axes.

        about (3,) [m]: a point of it that stays, ground frame.
        """
        from scipy.spatial.transform import Rotation  # lazily: import stays light

        turn = Rotation.from_rotvec([*tilt, 0.0]).as_matrix()
        normal = self.rotation.T @ turn[:, 2]
        height = float(normal @ self.from_ground(np.asarray(about)))
        original = self if self.told is None else self.told
        unit = tuple((normal / np.linalg.norm(normal)).tolist())
        return Ground(height, unit, told=original)

    @property
    def rotation(self) -> np.ndarray:
        """R_gw (3, 3): rotates vectors from the world to the ground frame."""
        n_w = np.array(self.normal)
        flip = np.eye(3)
        if n_w[2] < FLIP_LIMIT:  # first half a turn about x, then the shortest rotation
            flip = np.diag([1.0, -1.0, -1.0])
            n_w = flip @ n_w
        x, y, z = n_w
        cross = np.array([[0.0, 0.0, -x], [0.0, 0.0, -y], [x, y, 0.0]])  # [n x e_z]
        return (np.eye(3) + cross + cross @ cross / (1.0 + z)) @ flip

    @property
    def origin(self) -> np.ndarray:
        """(3,) [m], origin of the ground frame, in the world frame."""
        return self.height * np.array(self.normal)

    @property
    def translation(self) -> np.ndarray:
        """(3,) [m], t of the rigid motion p_g = R_gw p_w + t."""
        return -self.rotation @ self.origin

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Return the signed distance (...) [m] of world points (..., 3) [m].

        Above the ground it is positive.  Raises OptionError unless points are finite.
        """
        points = checked_array("points", points, ..., 3, unit="[m]")
        return points @ np.array(self.normal) - self.height

    def to_ground(self, points: np.ndarray) -> np.ndarray:
        """Map points (..., 3) [m] from the world to the ground frame.

        Raises OptionError unless they are finite.
        """
        points = checked_array("points", points, ..., 3, unit="[m]")
        return (points - self.origin) @ self.rotation.T

    def from_ground(self, points: np.ndarray) -> np.ndarray:
        """Map points (..., 3) [m] from the ground frame back to the world.

        Raises OptionError unless they are finite.
        """
        points = checked_array("points", points, ..., 3, unit="[m]")
        return points @ self.rotation + self.origin

    def point(self, place: np.ndarray, distance: float = 0.0) -> np.ndarray:
        """Return a place (3,) [m] as it is; of (x, y) the point at a distance from it.

        World frame.  Raises SceneError where the plane is too steep for x and y alone.
        """
        if len(place) == 3:
            return place
        if self.normal[2] < UPRIGHT:
            raise SceneError(
                "the ground is too steep for a place in x and y", where="ground.normal",
                got=list(self.normal), expected=f"a third component above {UPRIGHT}",
                next="give three coordinates of the place",
            )  # fmt: skip
        point = np.array([*place, 0.0])
        point[2] = (distance - self.distance(point)) / self.normal[2]
        return point


def frame_of(ground: Ground | None) -> Ground:
    """Return the ground in whose frame problems are written; without one, the world."""
    return Ground() if ground is None else ground


def scene_number(
    name: str,
    value: object,
    expected: str,
    low: float = -np.inf,
    high: float = np.inf,
    fix: str = "give one finite number in SI units",
) -> float:
    """Return a finite number in [low, high), or raise SceneError."""
    array = as_array(value, "iuf")
    single = array is not None and array.ndim == 0
    if not (single and np.isfinite(array) and low <= array < high):
        raise SceneError(
            "out of range" if single else "not one number",
            where=name,
            got=shortened(value, most=80),
            expected=expected,
            next=fix,
        )
    return float(array)


def _unit(name: str, value: object) -> tuple[float, float, float]:
    """Return a unit vector as a tuple, or raise SceneError."""
    fix = "divide it by its length; (0, 0, 1) is level ground"
    vector = checked_unit(name, value, 3, NORMAL_TOLERANCE, SceneError, fix)
    length = np.linalg.norm(vector)
    if abs(length - 1.0) > UNIT_EXACT:
        vector = vector / length
    return tuple(vector.tolist())
