"""Simulate fingers that touch and push an object; record measurements and truth."""

from __future__ import annotations

import os
from dataclasses import KW_ONLY, dataclass

import numpy as np

from formulations.exploration import least_jerk

from ..common.npz import write_npz
from ..common.validation import check_types
from ..data.ground import scene_number
from ..data.measurements import FARTHEST, Measurements
from ..data.noise_model import Noise, add_noise
from ..data.scene import GROUND_HEIGHT
from ..errors import SceneError, typed_call
from ..evaluation.metrics import TrueBody
from ..geometry.interpolation import PARKED_MOTION, path_of
from .arguments import (
    WORLD_NUMBERS,
    centred_hull,
    checked_lengths,
    pose_of,
    world_error,
)
from .mujoco_plant import TIME_STEP, Plant

SAMPLE_RATE = 30  # [Hz] of the record, as the tactile sensors of the paper
CONTACT_STEPS = 40  # steps (10 ms) over which a sensor averages the contact force
LONGEST_ACTION = 600.0  # [s] of an action: 2.4 million steps
SAME_INSTANT = 1e-6  # [s] largest difference of equal times
BACK_OFF, BACK_OFF_TIME = 0.008, 0.2  # [m], [s] first, along the contact normal
RETURN_TIME = 0.4  # [s] then, back along the path
REST_TIME = 0.2  # [s] after an action: the object comes to rest
SAVED = (
    *("side_lengths", "vertices", "mass"),
    *("friction_ground", "friction_finger", "gravity", "max_force"),
)


@dataclass(frozen=True, eq=False)
class Truth:
    """The true state at T samples, in SI and in the world frame.

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


@typed_call()
@dataclass(eq=False, repr=False)
class World:
    """A simulated world in which fingers push one rigid object.

    side_lengths:    (3,) [m] of a box; or
    vertices:        (V, 3) [m] or a trimesh.Trimesh: the body is their convex hull,
                     with the hull's centroid as origin
    position:        (2,) [m] of a body on the ground, or (3,) [m] of its origin
    quaternion:      (4,) wxyz, body to world, at first
    mass:            [kg], of uniform density
    friction_ground, friction_finger: [1] Coulomb
    finger_radius:   (F,) [m], spherical fingertips
    ground:          [m] height of the ground plane, or None (gravity must be 0 then)
    gravity:         [m/s^2]
    max_force:       [N], limit of a finger's servo
    contact_force:   [N], normal force (10 ms average) above which contact is reported
    settle:          [s] that the object rests before the first action
    rate:            [Hz] of samples, at most 4080; rounded so that a sample is a whole
                     number of steps; above 102 Hz the force is averaged over a sample
    restitution:     [1], relative speed after an impact over that before, at most 0.9
    noise:           of the sensors; `truth` has none

    `measurements` and `truth` hold all samples, None before the first action.  Equal
    arguments and trajectories give equal records, to the last digit.  Raises
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
    rate: float = SAMPLE_RATE
    restitution: float = 0.0
    noise: Noise = Noise()  # noqa: RUF009 (it is frozen)

    def __post_init__(self) -> None:
        if (self.side_lengths is None) == (self.vertices is None):
            got = "both or neither"
            raise world_error("side_lengths, vertices", "one of the two", got)
        check_types(noise=(self.noise, Noise))
        for name, (expected, low, most) in WORLD_NUMBERS.items():
            value, high = getattr(self, name), np.nextafter(most, np.inf)
            setattr(self, name, scene_number(name, value, expected, low, high))
        if self.ground is not None or self.gravity > 0:
            self.ground = scene_number("ground", self.ground, "a height [m]")
        self.finger_radius = checked_lengths("finger_radius", self.finger_radius)
        if self.vertices is None:
            self.side_lengths = checked_lengths("side_lengths", self.side_lengths, 3)
            corners = (np.indices((2, 2, 2)).reshape(3, 8).T - 0.5) * self.side_lengths
        else:
            corners = self.vertices = centred_hull(self.vertices)
        pose = pose_of(self.position, self.quaternion, corners, self.ground)
        self.position, self.quaternion = pose[:3], pose[3:]
        self.measurements: Measurements | None = None
        self.truth: Truth | None = None
        self.plant = Plant(
            side_lengths=self.side_lengths, vertices=self.vertices, pose=pose,
            mass=self.mass, friction=(self.friction_ground, self.friction_finger),
            finger_radius=self.finger_radius, ground=self.ground, gravity=self.gravity,
            max_force=self.max_force, restitution=self.restitution,
        )  # fmt: skip
        self.plant.hold(self.settle)

    @property
    def time(self) -> float:
        """The simulated time [s]."""
        return self.plant.steps * TIME_STEP

    @property
    def pose(self) -> np.ndarray:
        """The true pose of the object now (7,): position [m], quaternion wxyz."""
        return self.plant.pose

    def execute(self, trajectory) -> Measurements:
        """Move the fingers along a trajectory, return the measurements, and retract.

        trajectory: has `time` (n,) [s], of which only differences matter, and
        `finger_position` (n, F, 3) [m], interpolated by PCHIP.  A finger of constant
        position is parked: it is present, but its samples are not valid.

        Fingers are placed at the start of the trajectory; their way there is not
        simulated.  Samples are recorded at `rate` to its end.  After it, in 0.8 s
        without samples, each finger moves away along its contact normal and returns
        along its path.

        Raises OptionError for a malformed trajectory, or one that starts in a body.
        """
        fingers = len(self.finger_radius)
        path, duration, parked = path_of(trajectory, fingers, LONGEST_ACTION, FARTHEST)
        each = max(1, round(1 / (self.rate * TIME_STEP)))  # steps per sample
        steps = np.arange(int(duration / (each * TIME_STEP) + 1e-6) * each + 1)
        reference = path(np.minimum(steps * TIME_STEP, duration))
        self.plant.place(reference[0])
        time = (self.plant.steps + steps[::each]) * TIME_STEP
        rows = [self._row(np.zeros((1, len(parked), 6)))]
        for k in range(0, len(steps) - 1, each):
            touch = self.plant.follow(reference[k : k + each + 1])
            rows.append(self._row(touch))
        true = Truth(*map(np.array, zip(*rows, strict=True)))
        here, normal = self.plant.fingers, true.normal[-1]
        self.plant.follow(retraction(here, normal, path, duration, parked))
        self.plant.hold(REST_TIME)
        return self._keep(time, true, parked)

    def _keep(self, time: np.ndarray, true: Truth, parked: np.ndarray) -> Measurements:
        """Append an action to measurements and truth; return what is measured of it."""
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

    def true_body(self, time: float) -> TrueBody | None:
        """Return the true body at the time [s] of a sample, or None."""
        from trimesh.convex import convex_hull
        from trimesh.creation import box
        from trimesh.transformations import quaternion_matrix

        if self.truth is None:
            return None
        row = int(np.abs(self.measurements.time - time).argmin())
        if abs(self.measurements.time[row] - time) > SAME_INSTANT:
            return None
        where = self.truth.object_position[row]
        turn = self.truth.object_quaternion[row]
        place = quaternion_matrix(turn)
        place[:3, 3] = where
        if self.side_lengths is None:
            mesh = convex_hull(self.vertices).apply_transform(place)
        else:
            mesh = box(self.side_lengths, place)
        return TrueBody(mesh, where, turn, self.side_lengths)

    def save(self, path: str | os.PathLike) -> None:
        """Write measurements, scene and truth as .npz, in the layout of README.md.

        `Scene.load` reads the scene: ground_height [m] is an empty array for no ground.
        """
        if self.measurements is None:
            raise SceneError(
                "nothing is recorded", where="world.save", got="no measurements",
                next="execute a trajectory first",
            )  # fmt: skip
        arrays = vars(self.measurements) | {key: getattr(self, key) for key in SAVED}
        arrays = {key: value for key, value in arrays.items() if value is not None}
        arrays[GROUND_HEIGHT] = np.array([] if self.ground is None else self.ground)
        for key, value in vars(self.truth).items():
            arrays[key if key.startswith("object_") else f"truth_{key}"] = value
        arrays["final_position"] = self.truth.object_position[-1]
        arrays["final_quaternion"] = self.truth.object_quaternion[-1]
        arrays["contact_force_threshold"] = self.contact_force
        arrays["solver_step"] = TIME_STEP
        write_npz(path, arrays)

    def _row(self, touch: np.ndarray) -> tuple:
        """Return one sample of Truth from the forces (n, F, 6) [N] since the last."""
        press, finger = touch[-CONTACT_STEPS:, :, 3:], np.arange(touch.shape[1])
        felt = np.linalg.norm(press, axis=2)
        force, last = felt.mean(axis=0), (felt > 0).cumsum(axis=0).argmax(axis=0)
        contact = force > self.contact_force  # its normal is the last one in the window
        unit = contact / np.where(contact, felt[last, finger], 1.0)
        normal = press[last, finger] * unit[:, None]
        impulse = touch[:, :, :3].sum(axis=0) * TIME_STEP
        pose, fingers, gap = self.pose, self.plant.fingers, self.plant.distance()
        return pose[:3], pose[3:], fingers, contact, normal, force, impulse, gap


def retraction(here, normal, path, duration: float, parked) -> np.ndarray:
    """Return the references (n, F, 3) [m] out along the normal, then back on the path.

    here: (F, 3) [m], positions of the fingers; normal: (F, 3), outward contact normals;
    path: positions (F, 3) [m] as a function of time [s] up to duration [s]; parked:
    (F,), fingers that do not move.  The offset from the path at its end decreases to
    zero along the way back.
    """
    out = here + BACK_OFF * _smooth(BACK_OFF_TIME) * normal
    back = path(duration * (1 - _smooth(RETURN_TIME)[:, 0, 0]))
    steps = np.diff(back, axis=0, prepend=back[:1])
    way = np.linalg.norm(steps, axis=-1).cumsum(axis=0)
    left = 1 - way / np.maximum(way[-1], PARKED_MOTION)
    back = back + left[:, :, None] * (out[-1] - back[0])
    return np.where(parked[:, None], path(0.0), np.concatenate([out, back[1:]]))


def _smooth(duration: float) -> np.ndarray:
    """Return the minimum-jerk profile from 0 to 1 at every step, (n, 1, 1)."""
    s = np.linspace(0, 1, round(duration / TIME_STEP) + 1)
    return least_jerk(s)[:, None, None]
