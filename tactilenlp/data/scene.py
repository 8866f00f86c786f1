"""Prior knowledge of the scene: object, ground, fingertips and sensors."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, fields

import numpy as np

from ..common.brief import shown
from ..common.npz import read_npz
from ..common.validation import (
    as_array,
    as_floats,
    check_types,
    checked_array,
)
from ..errors import MeasurementError, OptionError, SceneError, shortened, typed_call
from .joint_offsets import JointZeros
from .measurements import UNIT_EXACT, Measurements

NORMAL_TOLERANCE = 1e-6  # [1], a normal further from unit length was not normalised
FLIP_LIMIT = -0.9  # [1], cosine below which the shortest rotation to +z is ill-defined
HEAVIEST = 100.0  # [kg] no finger pushes more: beyond it a mass is in grams
GUESS = "this must be known, give a guess"
REMEDIES = {  # of a number that is out of range, where it cannot be None
    "mass": "divide by 1000 if it is in grams; if it is not known, give a guess",
    "gravity": "give its magnitude, 9.81: it acts along the ground's normal",
}
KNOWN_KEYS = ("mass", "friction_ground", "friction_finger")  # read from a file


@typed_call()
@dataclass(frozen=True)
class Ground:
    """The plane that the object rests on: all points p with normal . p = height.

    height: [m], of the plane above the world's origin, along the normal
    normal: (3,), unit, pointing up, world frame

    The ground frame g has the ground as z = 0 and the normal as +z; where the normal is
    the world's +z, its axes are exactly those of the world.
    """

    height: float = 0.0
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        height = _number("ground.height", self.height, "a height [m]")
        object.__setattr__(self, "height", height)
        object.__setattr__(self, "normal", _unit("ground.normal", self.normal))

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
        """Return the signed distance (...) [m] of world points (..., 3) [m]."""
        points = checked_array("points", points, -1, 3, unit="[m]")
        return points @ np.array(self.normal) - self.height

    def to_ground(self, points: np.ndarray) -> np.ndarray:
        """Map points (..., 3) [m] from the world to the ground frame."""
        points = checked_array("points", points, -1, 3, unit="[m]")
        return (points - self.origin) @ self.rotation.T

    def from_ground(self, points: np.ndarray) -> np.ndarray:
        """Map points (..., 3) [m] from the ground frame back to the world."""
        points = checked_array("points", points, -1, 3, unit="[m]")
        return points @ self.rotation + self.origin


@shown
@typed_call()
@dataclass(frozen=True)
class Scene:
    """What is known of object, ground and sensors; SceneError if it is impossible.

    mass:            [kg], of the object; must be given, impulses scale with it
    friction_ground: [1], Coulomb, object and ground; None: unknown, estimated
    friction_finger: [1], Coulomb, object and fingertip; None: unknown, estimated
    ground:          the plane that carries the object; None: there is none
    gravity:         [m/s^2], acts against the ground's normal (along -z without one);
                     without ground and gravity the object floats and keeps its velocity
    finger_length:   [m], of the straight part of a fingertip: 0 for spheres, else
                     capsules along z of the measured finger_orientation
    sigma_position:  [m], standard deviation of each coordinate of a finger position
    sigma_normal:    [1], about rad, standard deviation of each component of a normal
    flip_rate:       [1], probability that a contact boolean is wrong
    sigma_offset:    [m], standard deviation of each coordinate of a constant offset of
                     each finger, which is estimated; None: positions have no offset;
                     JointZeros: the offset is that of wrong zero angles of joints
    compliance:      [m/N], how far a fingertip yields under a normal force, all alike;
                     0: rigid; None: rigid unless the measurements say otherwise

    sigma_centre:    [1], standard deviation of each coordinate of the centre of mass
                     from the body's centroid, of a typical size; 0: it is the centroid

    The default mass and frictions are those of the recorded scenes.  Sensor
    figures that are None are estimated from the data, except sigma_offset.
    """

    mass: float = 0.5
    friction_ground: float | None = 0.3
    friction_finger: float | None = 0.5
    ground: Ground | None = field(default_factory=Ground)
    gravity: float = 9.81
    finger_length: float = 0.0
    sigma_position: float | None = None
    sigma_normal: float | None = None
    flip_rate: float | None = None
    sigma_offset: float | JointZeros | None = None
    compliance: float | None = None
    sigma_centre: float = 0.03

    def __post_init__(self) -> None:
        never, inf = np.nextafter(0.0, 1.0), np.inf  # the least number above zero
        most = np.nextafter(HEAVIEST, inf)
        for name, unknown, low, high, expected in (
            ("mass", False, never, most, f"a mass in (0, {HEAVIEST:.0f}] kg"),
            ("friction_ground", True, 0.0, 10.0, "a coefficient in [0, 10)"),
            ("friction_finger", True, 0.0, 10.0, "a coefficient in [0, 10)"),
            ("gravity", False, 0.0, inf, "an acceleration of 0 m/s^2 or more"),
            ("finger_length", False, 0.0, 0.5, "a length in [0, 0.5) m"),
            ("sigma_position", True, never, inf, "a standard deviation above 0 m"),
            ("sigma_normal", True, never, inf, "a standard deviation above 0"),
            ("flip_rate", True, 0.0, 0.5, "a probability in [0, 0.5)"),
            ("compliance", True, 0.0, 1.0, "a compliance in [0, 1) m/N"),
            ("sigma_centre", False, 0.0, 1.0, "a share of a typical size in [0, 1)"),
            ("sigma_offset", True, never, inf, "a standard deviation above 0 m"),
        ):
            value = getattr(self, name)
            given = name == "sigma_offset" and isinstance(value, JointZeros)
            if given or (value is None and unknown):
                continue
            fix = "None if unknown" if unknown else REMEDIES.get(name, GUESS)
            number = _number(name, value, expected, low, high, fix)
            object.__setattr__(self, name, number)
        if self.ground is not None and not isinstance(self.ground, Ground):
            raise SceneError(
                "not a ground",
                where="ground",
                got=shortened(self.ground, most=80),
                expected="a Ground, or None",
                next="write Ground(height=..., normal=...)",
            )
        if self.ground is None and isinstance(self.sigma_offset, JointZeros):
            raise SceneError(
                "joint offsets can be estimated with a ground only",
                where="sigma_offset", got="JointZeros",
                expected="a ground, or one number [m]",
            )  # fmt: skip

    @classmethod
    def load(cls, path: str | os.PathLike, **overrides: object) -> Scene:
        """Read mass, friction_ground and friction_finger from an .npz that has them.

        Any field can be overridden: `Scene.load(path, friction_ground=None)`.  A file
        without mass raises SceneError unless the mass is given: impulses are in units
        of the weight.  Frictions that the file does not have are those of Scene().
        """
        names = [known.name for known in fields(cls)]
        for name in overrides:
            if name not in names:
                raise OptionError(
                    "a scene has no such field",
                    where="Scene.load",
                    got=name,
                    expected=f"one of {names}",
                    next="check the spelling",
                )
        known = read_npz(path, KNOWN_KEYS, error=SceneError) | overrides
        if "mass" not in known:
            raise SceneError(
                "no mass", where=os.fspath(path), got=f"only {sorted(known)}",
                expected="a number [kg]",
                next="give it: Scene.load(path, mass=...), --mass on the command line",
            )  # fmt: skip
        return cls(**known)

    @property
    def joints(self) -> JointZeros | None:
        """The joints whose zero angles are wrong, in the ground's frame; or None."""
        known = isinstance(self.sigma_offset, JointZeros)
        return self.sigma_offset.seen_from(self.ground) if known else None

    @property
    def typical_offset(self) -> float:
        """The deviation [m] of a coordinate of a finger's offset."""
        if self.joints is None:
            return self.sigma_offset or 0.0
        return float(np.sqrt(np.mean(np.linalg.eigvalsh(self.joints.covariance))))

    def check(self, data: Measurements) -> None:
        """Raise MeasurementError where the centre of a finger lies below the ground.

        The surface of a fingertip may touch the ground; samples not valid are skipped.
        Also where the orientation of capsules was not measured.
        """
        check_types(data=(data, Measurements))
        if self.finger_length > 0 and data.finger_orientation is None:
            raise MeasurementError(
                "the orientation of the fingertips is missing",
                where="finger_orientation",
                got="None",
                expected=f"unit quaternions for capsules of {self.finger_length} m",
                next="record it, or set Scene(finger_length=0) for spheres",
            )
        if self.joints is not None and self.joints.fingers != data.fingers:
            raise SceneError(
                "another number of fingers", where="sigma_offset",
                got=f"those of {self.joints.fingers}",
                expected=f"those of the {data.fingers} fingers measured",
                next="stack place, jacobian and change of every finger",
            )  # fmt: skip
        if self.ground is None:
            return
        height = self.ground.distance(data.finger_position)
        below = np.argwhere(data.valid & (height < 0))
        if len(below):
            index = tuple(below[0].tolist())
            raise MeasurementError(
                f"the finger's centre is below the ground at index {index}",
                index=index,
                where="finger_position",
                got=f"{-1e3 * height[index]:.3g} mm below",
                expected="a centre above the plane normal . p = height",
                next="set Scene(ground=Ground(height=...)), or ground=None for none",
            )


def _number(
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
    vector = as_floats(value)
    length = np.linalg.norm(vector)
    if vector.shape != (3,) or not abs(length - 1.0) <= NORMAL_TOLERANCE:
        raise SceneError(
            "not a unit vector",
            where=name,
            got=shortened(value, most=80),
            expected=f"3 numbers of length 1 within {NORMAL_TOLERANCE}",
            next="divide it by its length; (0, 0, 1) is level ground",
        )
    if abs(length - 1.0) > UNIT_EXACT:
        vector = vector / length
    return tuple(vector.tolist())
