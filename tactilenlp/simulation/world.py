"""Simulate fingers that touch and push an object: the truth for examples and tests."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass

import numpy as np

from ..common.npz import write_npz
from ..data.measurements import Measurements
from ..data.noise_model import Noise, add_noise
from ..errors import OptionError, SceneError
from ..geometry.transforms import rotation_of
from .mujoco_plant import LIVELIEST, TIME_STEP, Plant
from .retraction import STILL, retraction

RECORD_RATE = 30  # [Hz] of the record, as the tactile sensors of the paper
WINDOW = 40  # steps (10 ms) at the end of a sample over which the sensor averages
SETTLE_TIME = 0.2  # [s] after an action: the object comes to rest
LARGEST = 5.0  # [m] of a side: fingers push nothing longer
SUNK = 1e-5  # [m] a body may be placed below the ground; more would make it jump
SHAPE = ("side_lengths", "vertices")
WORLD_ARGUMENTS = {  # what a world is told: unit and length
    "side_lengths": ("m > 0", 3),
    "finger_radius": ("m > 0", None),
    "mass": ("kg > 0", -1),
    "friction_ground": (">= 0", -1),
    "friction_finger": (">= 0", -1),
    "ground": ("m", -1),
    "gravity": ("m/s^2 >= 0", -1),
    "max_force": ("N > 0", -1),
    "contact_force": ("N >= 0", -1),
    "settle": ("s >= 0", -1),
    "rate": ("Hz > 0", -1),
    "restitution": (">= 0", -1),
}
PLANT = (
    *SHAPE,
    "mass",
    "finger_radius",
    "ground",
    "gravity",
    "max_force",
    "restitution",
)


@dataclass(frozen=True, eq=False)
class Truth:
    """Hold what no sensor measures, at T samples, in SI and in the world frame.

    object_position, object_quaternion: (T, 3) [m], (T, 4) wxyz, body to world
    finger_position, contact, normal:   as in Measurements, before any noise
    normal_force:  (T, F) [N] mean of the last 10 ms, on which `contact` is decided
    impulse:       (T, F, 3) [N s] of a finger on the object since the sample before
    distance:      (T, F) [m] from finger surface to object, negative where they overlap
    """

    object_position: np.ndarray
    object_quaternion: np.ndarray
    finger_position: np.ndarray
    contact: np.ndarray
    normal: np.ndarray
    normal_force: np.ndarray
    impulse: np.ndarray
    distance: np.ndarray


@dataclass(eq=False, repr=False)
class World:
    """Let fingers push one rigid object on the ground and record what they feel.

    side_lengths:    (3,) [m] of a box, or else
    vertices:        (V, 3) [m] or a trimesh.Trimesh: the body is their convex hull,
                     moved so that its origin is the hull's centroid
    position:        (2,) [m] where the body is set down, or (3,) [m] of its origin
    quaternion:      (4,) wxyz, body to world, at first
    mass:            [kg], of uniform density
    friction_ground, friction_finger: [1] Coulomb
    finger_radius:   (F,) [m], spherical fingertips
    ground:          [m] height of the ground plane, or None (gravity must be 0 then)
    gravity:         [m/s^2]
    max_force:       [N], the most that the servo of a finger applies
    contact_force:   [N] a contact is reported above this normal force (10 ms average)
    settle:          [s] that the object rests before the first action
    rate:            [Hz] of the record, made a whole number of the solver's steps, at
                     most 4080; above 102 a contact's average is over its sample only
    restitution:     [1] of an impact's speed that comes back, at most 0.9
    noise:           what the sensors add; `truth` stays clean

    `measurements` and `truth` hold all that was recorded, None before the first action.
    Equal arguments and trajectories give equal records, to the last digit.  Raises
    SceneError.
    """

    side_lengths: np.ndarray | None = None
    _: KW_ONLY
    vertices: np.ndarray | None = None
    position: np.ndarray | tuple = (0.0, 0.0)
    quaternion: np.ndarray | tuple = (1.0, 0.0, 0.0, 0.0)
    mass: float = 0.5
    friction_ground: float = 0.3
    friction_finger: float = 0.5
    finger_radius: np.ndarray | tuple = (0.01, 0.01)
    ground: float | None = 0.0
    gravity: float = 9.81
    max_force: float = 8.0
    contact_force: float = 0.05
    settle: float = 0.3
    rate: float = RECORD_RATE
    restitution: float = 0.0
    noise: Noise = Noise()  # noqa: RUF009 (it is frozen)

    def __post_init__(self) -> None:
        if (self.side_lengths is None) == (self.vertices is None):
            raise _wrong("side_lengths, vertices", "one of the two", "both or neither")
        self.finger_radius = np.atleast_1d(self.finger_radius)
        for name, rule in WORLD_ARGUMENTS.items():
            value = getattr(self, name)
            if value is not None or name not in ("side_lengths", "ground"):
                setattr(self, name, _checked(name, value, *rule))
        if self.restitution > LIVELIEST:
            raise _wrong("restitution", f"at most {LIVELIEST}", self.restitution)
        if self.rate * TIME_STEP > 1:
            fix = "a sample is one step of the solver at least"
            raise _wrong("rate", f"at most {1 / TIME_STEP:.0f} Hz", self.rate, fix)
        if self.ground is None and self.gravity > 0:
            raise _wrong("ground", "a height [m] where there is gravity", None)
        if self.vertices is None:
            corners = (np.indices((2, 2, 2)).reshape(3, 8).T - 0.5) * self.side_lengths
        else:
            corners = self.vertices = _hull(self.vertices)
        pose = _pose(self.position, self.quaternion, corners, self.ground)
        self.position, self.quaternion = pose[:3], pose[3:]
        self.measurements: Measurements | None = None
        self.truth: Truth | None = None
        friction = self.friction_ground, self.friction_finger
        known = {key: getattr(self, key) for key in PLANT}
        self._plant = Plant(pose=pose, friction=friction, **known)
        self._plant.hold(self.settle)

    @property
    def time(self) -> float:
        """The simulated time [s]."""
        return self._plant.steps * TIME_STEP

    @property
    def pose(self) -> np.ndarray:
        """The true pose of the object now (7,): position [m], quaternion wxyz."""
        return self._plant.pose

    def execute(self, trajectory) -> Measurements:
        """Move the fingers along a trajectory, return what they measured, and retract.

        trajectory: has `time` (n,) [s], of which differences count, and
        `finger_position` (n, F, 3) [m], followed smoothly (PCHIP).  A finger whose
        positions are constant stays parked: it is there, but its samples are not valid.

        Fingers appear at the start of the trajectory; the way there is not simulated.
        The record runs at `rate` to the end.  Then, unrecorded and in 0.8 s, each
        finger backs off along its contact normal and returns the way it came.

        Raises OptionError where a trajectory is malformed or starts inside a body.
        """
        path, duration, parked = _path(trajectory, len(self.finger_radius))
        each = max(1, round(1 / (self.rate * TIME_STEP)))  # steps per sample
        steps = np.arange(int(duration / (each * TIME_STEP) + 1e-6) * each + 1)
        reference = path(np.minimum(steps * TIME_STEP, duration))
        self._plant.place(reference[0])
        time = (self._plant.steps + steps[::each]) * TIME_STEP
        rows = [self._row(np.zeros((1, len(parked), 6)))]
        for k in range(0, len(steps) - 1, each):
            touch = self._plant.follow(reference[k : k + each + 1])
            rows.append(self._row(touch))
        true = Truth(*map(np.array, zip(*rows, strict=True)))
        out = self._plant.fingers, true.normal[-1]
        self._plant.follow(retraction(*out, path, duration, parked))
        self._plant.hold(SETTLE_TIME)
        return self._keep(time, true, parked)

    def _keep(self, time: np.ndarray, true: Truth, parked: np.ndarray) -> Measurements:
        past = self.measurements
        data = Measurements(
            time=time,
            finger_position=true.finger_position,
            finger_radius=self.finger_radius,
            contact=true.contact & ~parked,
            normal=np.where(parked[:, None], 0.0, true.normal),
            action=np.full(len(time), 0 if past is None else past.action[-1] + 1),
            valid=np.repeat(~parked[None], len(time), axis=0),
        )
        data = add_noise(data, self.noise)
        self.measurements = data if past is None else past.append(data)
        if past is not None:
            pairs = zip(vars(self.truth).values(), vars(true).values(), strict=True)
            true = Truth(*map(np.concatenate, pairs))
        self.truth = true
        return data

    def save(self, path: str | os.PathLike) -> None:
        """Write measurements, knowledge of the scene and truth as .npz (DESIGN.md)."""
        if self.measurements is None:
            raise SceneError("nothing is recorded", next="execute a trajectory first")
        known = (*SHAPE, "mass", "friction_ground", "friction_finger", "max_force")
        arrays = vars(self.measurements) | {key: getattr(self, key) for key in known}
        arrays = {key: value for key, value in arrays.items() if value is not None}
        for key, value in vars(self.truth).items():
            arrays[key if key.startswith("object_") else f"truth_{key}"] = value
        arrays["final_position"] = self.truth.object_position[-1]
        arrays["final_quaternion"] = self.truth.object_quaternion[-1]
        arrays |= {
            "contact_force_threshold": self.contact_force,
            "solver_step": TIME_STEP,
        }
        write_npz(path, arrays)

    def _row(self, touch: np.ndarray) -> tuple:
        """Return one sample of Truth from the forces (n, F, 6) [N] since the last."""
        press, finger = touch[-WINDOW:, :, 3:], np.arange(touch.shape[1])
        felt = np.linalg.norm(press, axis=2)
        force, last = felt.mean(axis=0), (felt > 0).cumsum(axis=0).argmax(axis=0)
        contact = force > self.contact_force  # the normal is the one felt last
        unit = contact / np.where(contact, felt[last, finger], 1.0)
        normal = press[last, finger] * unit[:, None]
        impulse = touch[:, :, :3].sum(axis=0) * TIME_STEP
        pose, fingers, gap = self.pose, self._plant.fingers, self._plant.distance()
        return pose[:3], pose[3:], fingers, contact, normal, force, impulse, gap


def _path(trajectory, F: int) -> tuple[Callable, float, np.ndarray]:
    """Return the references as a function of time, the duration [s], who is parked."""
    from scipy.interpolate import PchipInterpolator

    time = np.asarray(getattr(trajectory, "time", None), float)
    position = np.asarray(getattr(trajectory, "finger_position", None), float)
    good = time.ndim == 1 and len(time) > 1 and np.isfinite(time).all()
    if not (good and (np.diff(time) > 0).all()):
        expected = "(n,) [s], finite, increasing, n >= 2"
        raise _wrong("time", expected, f"shape {time.shape}", kind=OptionError)
    if position.shape != (len(time), F, 3) or not np.isfinite(position).all():
        expected, got = f"{(len(time), F, 3)} [m], finite", f"shape {position.shape}"
        raise _wrong("finger_position", expected, got, kind=OptionError)
    parked = np.ptp(position, axis=0).max(axis=1) < STILL
    return PchipInterpolator(time - time[0], position), time[-1] - time[0], parked


def _pose(position, quaternion, corners: np.ndarray, ground: float | None):
    """Return the pose (7,) of a body whose corners (V, 3) [m] stand on the ground."""

    quaternion = _checked("quaternion", quaternion, "unit length", 4)
    if not np.isclose(np.linalg.norm(quaternion), 1, atol=1e-6):
        raise _wrong("quaternion", "unit length", quaternion, "the order is wxyz")
    R_wo = rotation_of(quaternion).as_matrix()
    lowest = (corners @ R_wo.T)[:, 2].min()
    position = _checked("position", np.atleast_1d(position), "m", None)
    if len(position) == 2 and ground is not None:
        position = np.append(position, ground - lowest)
    if len(position) != 3:
        raise _wrong("position", "(3,) [m], or (2,) with a ground", position)
    if ground is not None and position[2] + lowest < ground - SUNK:
        fix = "give two coordinates, and the body is set down"
        raise _wrong("position", "a body above the ground", position, fix)
    return np.concatenate([position, quaternion / np.linalg.norm(quaternion)])


def _hull(vertices) -> np.ndarray:
    """Return the vertices of the convex hull (V, 3) [m] about its centroid."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        points = np.asarray(getattr(vertices, "vertices", vertices), float)
        hull = ConvexHull(points.reshape(len(points), 3))
    except (QhullError, TypeError, ValueError) as bad:
        expected, fix = "(V, 3) [m], a body", "give the corners of a convex body"
        raise _wrong("vertices", expected, np.shape(vertices), fix) from bad
    inside = points.mean(axis=0)
    legs = points[hull.simplices] - inside  # a tetrahedron per facet
    volume = abs(np.linalg.det(legs))
    centroid = inside + volume @ legs.sum(axis=1) / (4 * volume.sum())
    return points[np.sort(hull.vertices)] - centroid


def _checked(name: str, value, unit: str, length: int | None = -1):
    """Return a finite number or array (length,), above the zero that the unit names."""
    low = {"> 0": np.finfo(float).tiny, "= 0": 0.0}.get(unit[-3:], -np.inf)
    try:
        array = np.asarray(value, float)
    except (TypeError, ValueError):
        array = np.array(np.nan)
    shape = () if length == -1 else (length or max(array.size, 1),)
    if array.shape != shape or not (np.isfinite(array) & (array >= low)).all():
        raise _wrong(name, f"finite, shape {shape}, [{unit}]", value)
    if name == "side_lengths" and array.max() > LARGEST:
        raise _wrong(name, f"at most {LARGEST} m", value, "divide by 1000 if in mm")
    return array if shape else float(array)


def _wrong(where: str, expected: str, got: object, next: str = "", kind=SceneError):
    parts = {"where": where, "expected": expected, "got": f"{got}", "next": next}
    return kind("cannot be simulated", **parts)
