"""Prior knowledge of the scene: object, ground, fingertips and sensors."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, fields, replace

import numpy as np

from ..common.brief import shown
from ..common.npz import read_npz
from ..common.validation import check_kind, check_one_of, check_types
from ..errors import MeasurementError, SceneError, typed_call
from .ground import Ground, scene_number
from .joint_offsets import JointZeros
from .measurements import Measurements

STEEPEST = 0.2  # [rad] a ground that may lean further than this is not known
LATEST = 0.2  # [s] sensors that are later than this do not tell where a body is
HEAVIEST = 100.0  # [kg] no finger pushes more: beyond it a mass is in grams
MUST_BE_KNOWN = "this must be known, give a guess"
SCENE_REMEDIES = {  # of a number that is out of range
    "sigma_position": "divide by 1000 if it is in mm; None if unknown",
    "sigma_offset": "divide by 1000 if it is in mm; None if there is none",
    "mass": "divide by 1000 if it is in grams; if it is not known, give a guess",
    "gravity": "give its magnitude, 9.81: it acts against the ground's normal",
}
LARGEST_SIGMA = 0.1  # [m] deviation of a finger position: beyond it is in mm
# [-] of ground, of fingers where not known; no ground has none: pushes divide by it
TYPICAL_FRICTION = 0.3, 0.5
LOW_FRICTION = 0.1  # [-] of the ground, where it is not known and must stop the body
GROUND_HEIGHT = "ground_height"  # key of a file: [m], an empty array for no ground
KNOWN_KEYS = (  # read from a file
    *("mass", "friction_ground", "friction_finger", "gravity"),
    GROUND_HEIGHT,
)


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
    sigma_normal:    [rad], standard deviation of each component of a normal
    flip_rate:       [1], probability that a contact boolean is wrong
    sigma_offset:    [m], standard deviation of each coordinate of a constant offset of
                     each finger, which is estimated; None: positions have no offset;
                     JointZeros: the offset is that of wrong zero angles of joints
    compliance:      [m/N], how far a fingertip yields under a normal force, all alike;
                     0: rigid; None: rigid unless the measurements say otherwise
    sigma_centre:    [1], standard deviation of each coordinate of the centre of mass
                     from the body's centroid, of a typical size; 0: it is the centroid
    sigma_tilt:      [rad], standard deviation of a rotation of the true ground against
                     `ground`, about each horizontal axis; 0: `ground` is exact
    latency:         [s], by which contacts and normals are reported later than finger
                     positions, normals no later than contacts; None: 0, for both,
                     unless the measurements say otherwise

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
    sigma_tilt: float = 0.0087  # half a degree
    latency: float | None = None

    def __post_init__(self) -> None:
        never, inf = np.nextafter(0.0, 1.0), np.inf  # the least number above zero
        most = np.nextafter(HEAVIEST, inf)
        for name, unknown, low, high, expected in (
            ("mass", False, never, most, f"a mass in (0, {HEAVIEST:.0f}] kg"),
            ("friction_ground", True, 0.0, 10.0, "a coefficient in [0, 10)"),
            ("friction_finger", True, 0.0, 10.0, "a coefficient in [0, 10)"),
            ("gravity", False, 0.0, inf, "an acceleration of 0 m/s^2 or more"),
            ("finger_length", False, 0.0, 0.5, "a length in [0, 0.5) m"),
            ("sigma_position", True, never, LARGEST_SIGMA, "a deviation in (0, 0.1) m"),
            ("sigma_normal", True, never, inf, "a standard deviation above 0"),
            ("flip_rate", True, 0.0, 0.5, "a probability in [0, 0.5)"),
            ("compliance", True, 0.0, 1.0, "a compliance in [0, 1) m/N"),
            ("latency", True, 0.0, LATEST, "a time in [0, 0.2) s"),
            ("sigma_centre", False, 0.0, 1.0, "a share of a typical size in [0, 1)"),
            ("sigma_tilt", False, 0.0, STEEPEST, "an angle in [0, 0.2) rad"),
            ("sigma_offset", True, never, LARGEST_SIGMA, "a deviation in (0, 0.1) m"),
        ):
            value = getattr(self, name)
            of_joints = name == "sigma_offset" and isinstance(value, JointZeros)
            if of_joints or (value is None and unknown):
                continue
            usual = "None if unknown" if unknown else MUST_BE_KNOWN
            fix = SCENE_REMEDIES.get(name, usual)
            number = scene_number(name, value, expected, low, high, fix)
            object.__setattr__(self, name, number)
        fix = "write Ground(height=..., normal=...)"
        check_kind("ground", self.ground, (Ground, type(None)), SceneError, fix)
        if self.ground is None and isinstance(self.sigma_offset, JointZeros):
            raise SceneError(
                "joint offsets can be estimated with a ground only",
                where="sigma_offset", got="JointZeros",
                expected="a ground, or one number [m]",
            )  # fmt: skip

    @classmethod
    def load(cls, path: str | os.PathLike, **overrides: object) -> Scene:
        """Read mass, frictions, gravity and ground_height from an .npz that has them.

        ground_height: [m], of a level ground; an empty array (0,) where there is none.
        Any field can be overridden: `Scene.load(path, friction_ground=None)`.  A file
        without mass raises SceneError unless the mass is given: impulses are in units
        of the weight.  All else that the file does not have is that of Scene().
        """
        names = [one.name for one in fields(cls)]
        for name in overrides:
            check_one_of("Scene.load", name, names, "a scene has no such field")
        values = read_npz(path, KNOWN_KEYS, error=SceneError) | overrides
        if "mass" not in values:
            raise SceneError(
                "no mass", where=os.fspath(path), got=f"only {sorted(values)}",
                expected="a number [kg]",
                next="give it: Scene.load(path, mass=...), --mass on the command line",
            )  # fmt: skip
        height = values.pop(GROUND_HEIGHT, None)
        if height is not None and "ground" not in overrides:
            values["ground"] = _ground_of(height)
        return cls(**values)

    @property
    def as_told(self) -> Scene:
        """The scene with the ground that was given, where another was estimated."""
        ground = None if self.ground is None else self.ground.told
        return self if ground is None else replace(self, ground=ground)

    def on_ground_of(self, other: Scene) -> Scene:
        """Return the scene with the ground that was estimated for another one."""
        same = other.as_told.ground == self.ground
        return replace(self, ground=other.ground) if same else self

    @property
    def joints(self) -> JointZeros | None:
        """The joints whose zero angles are wrong, in the ground's frame; or None."""
        has_joints = isinstance(self.sigma_offset, JointZeros)
        return self.sigma_offset.in_frame_of(self.ground) if has_joints else None

    @property
    def tilt_is_known(self) -> bool:
        """Whether the ground leans as it was told, or there is none."""
        return self.ground is None or self.sigma_tilt == 0

    @property
    def typical_offset(self) -> float:
        """The deviation [m] of a coordinate of a finger's offset."""
        if self.joints is None:
            return self.sigma_offset or 0.0
        return float(np.sqrt(np.mean(np.linalg.eigvalsh(self.joints.covariance))))

    def check(self, data: Measurements) -> None:
        """Raise MeasurementError where the centre of a finger lies below the ground.

        The surface of a fingertip may touch the ground; samples not valid are skipped.
        Also where the orientation of capsules was not measured; SceneError where
        sigma_offset is of another number of fingers.
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
                got=f"{-1e3 * height[index]:.3g} mm below, in {len(below)} samples "
                f"of {data.valid.sum()}",
                expected="a centre above the plane normal . p = height",
                next="set Scene(ground=Ground(height=...)), or ground=None for none; "
                "set valid=False where single positions are wrong",
            )


def _ground_of(height: np.ndarray) -> Ground | None:
    """Return the level ground at the height [m] of a file, None for an empty array."""
    if height.shape == (0,):
        return None
    fix = "write an empty array where there is no ground"
    number = scene_number(GROUND_HEIGHT, height, "a height [m]", fix=fix)
    return Ground(number)


def typical_friction(scene) -> tuple[float, float]:
    """Return the friction of the ground and of the fingers: typical where not known."""
    ground, finger = TYPICAL_FRICTION
    finger = finger if scene.friction_finger is None else scene.friction_finger
    return scene.friction_ground or ground, finger


def low_friction(scene) -> float:
    """Return the friction of the ground, low where it is not known."""
    return LOW_FRICTION if scene.friction_ground is None else scene.friction_ground
