"""Record boxes and hulls in plain MuJoCo, in worlds unlike the estimator's.

`recorded(box, world)` returns the arrays of a recording, in the layout of the README.
Servo-driven spheres push a box.  A `ForeignWorld` says how it departs from the
estimator's assumptions; its defaults are two fingers, actions of a second, stiff
contacts and low pushes, which the estimator's model describes.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from foreign_bodies import Box
from foreign_model import model_of
from foreign_paths import STEP, reference
from scipy.spatial.transform import Rotation

from tactilenlp import Measurements, Scene

REST = 0.5  # [s] between actions, in which the fingers are away
BUMPED_AT = 0.5  # [s] after the begin of an action
LIFTED = 1.0  # [m] their height then
AVERAGED = 30  # steps (10 ms) of the mean force that is felt
STIFF = "0.002 1", "0.99 0.999 0.001"  # solref, solimp of MuJoCo
DEFAULT = "0.02 1", "0.9 0.95 0.001 0.5 2"
GEL = "0.03 1", "0.7 0.95 0.005 0.5 2"
SCENE = ("mass", "friction_ground", "friction_finger")  # of a recording


@dataclass(frozen=True)
class ForeignWorld:
    """How a world departs from the estimator's assumptions.

    contact:   MuJoCo's solref and solimp of all contacts
    tip:       the same of the fingertips, if these differ
    stiffness: [N/m] of the servos
    centre:    of mass, from the middle along x, y and z, as a share of the side
    by_face:   share by which the friction of fingers differs between faces
    by_direction: share by which the friction of the ground differs between x and y
    edge:      [m] radius of the edges of a box
    tilt:      [deg] of the ground about x; the estimator is told that it is level
    above:     [rad] pushes come down by up to this angle, and touch the top
    heights:   of the pushes, lowest and highest, as a share of the box's height
    touching:  whether every second action begins where the one before ended
    latency:   [s] by which contact and normal are reported late
    rate:      [Hz] of samples; a sample is a whole number of steps of 1/3 ms
    speed:     [m/s] of the fingers
    felt:      [N] mean normal force above which contact is reported
    carried:   [m], [rad] by which the box is moved between actions, standard deviations
    scale:     factor of the sides
    radius:    [m] of the fingertips
    wall:      [m] between the box's circle and an upright wall that nobody tells of
    torsion:   [m] of MuJoCo's torsional friction between box and ground
    path:      of the fingers' references, one of foreign_paths.PATHS
    duration:  [s] of an action
    fingers:   how many there are
    mass:      factor of the body's mass, which the estimator is told
    friction:  factor of both frictions, which the estimator is told
    bumped:    [m/s] by which something unseen pushes the body once an action
    """

    contact: tuple[str, str] = STIFF
    tip: tuple[str, str] | None = None
    stiffness: float = 2000.0
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    by_face: float = 0.0
    by_direction: float = 0.0
    edge: float = 0.0
    tilt: float = 0.0
    above: float = 0.0
    heights: tuple[float, float] = (0.25, 0.5)
    touching: bool = False
    latency: float = 0.0
    rate: float = 30.0
    speed: float = 0.05
    felt: float = 0.05
    carried: tuple[float, float] = (0.0, 0.0)
    scale: float = 1.0
    radius: float = 0.01
    wall: float = 0.0
    torsion: float = 0.0
    path: str = "straight"
    duration: float = 1.0
    fingers: int = 2
    mass: float = 1.0
    friction: float = 1.0
    bumped: float = 0.0


def body_of(world: ForeignWorld, number: int, kind=Box) -> Box:
    """Return the body of a number in a world: a Box or a Hull."""
    return kind(number, world.scale, world.radius, world.mass, world.friction)


class Simulation:
    """A box on the ground and fingertips, stepped by MuJoCo."""

    def __init__(self, box: Box, world: ForeignWorld):
        self.box, self.world, self.count = box, world, world.fingers
        self.model = mujoco.MjModel.from_xml_string(model_of(box, world))
        self.data = mujoco.MjData(self.model)
        tilted = Rotation.from_euler("x", world.tilt, degrees=True)
        turn = tilted * Rotation.from_euler("z", box.yaw)
        self.data.qpos[:3] = tilted.apply([0, 0, box.height])
        self.data.qpos[3:7] = turn.as_quat(scalar_first=True)
        self._faces = 1 + world.by_face * np.array([[1, -1], [-1, 1], [0, 0]])
        self.felt = []  # of every step: (2, 3) outward normals times force [N]
        self.lift()
        self.hold(REST)

    @property
    def pose(self) -> np.ndarray:
        """The pose of the box's middle (7,): position [m], quaternion wxyz."""
        return self.data.qpos[:7].copy()

    @property
    def fingers(self) -> np.ndarray:
        """The centres of the fingertips (2, 3) [m]."""
        return self.data.qpos[7:].reshape(-1, 3).copy()

    def lift(self) -> None:
        """Take the fingers away."""
        self.place(
            np.c_[
                np.arange(self.count), np.zeros(self.count), np.full(self.count, LIFTED)
            ]
        )

    def place(self, position) -> None:
        """Put the fingers somewhere (2, 3) [m], at rest."""
        self.data.qpos[7:] = self.data.ctrl[:] = np.ravel(position)
        self.data.qvel[6:] = 0.0

    def hold(self, duration: float) -> None:
        """Step for a duration [s] while the fingers' references stay."""
        for _ in range(round(duration / STEP)):
            self.step(self.data.ctrl.reshape(-1, 3))

    def carry(self, rng) -> None:
        """Move the box over the ground by hand, and turn it."""
        far, turn = self.world.carried
        if not far:
            return
        self.data.qpos[:2] += rng.normal(0, far, 2)
        turned = Rotation.from_euler("z", rng.normal(0, turn))
        turned *= Rotation.from_quat(self.pose[3:], scalar_first=True)
        self.data.qpos[3:7] = turned.as_quat(scalar_first=True)
        self.data.qvel[:6] = 0.0

    def bump(self, rng) -> None:
        """Give the body a velocity across the ground, in any direction."""
        heading = rng.uniform(0, 2 * np.pi)
        way = np.array([np.cos(heading), np.sin(heading)])
        self.data.qvel[:2] += self.world.bumped * way

    def step(self, reference) -> None:
        """Step with a reference (2, 3) [m] of the fingers."""
        self.data.ctrl[:] = np.ravel(reference)
        if self.world.by_face:
            self.model.geom_friction[-self.count :, 0] = self.box.finger * self.share()
        mujoco.mj_step(self.model, self.data)
        self.felt.append(self.forces())

    def share(self) -> np.ndarray:
        """Return the factor of friction of the face next to each finger (2,)."""
        turn = Rotation.from_quat(self.pose[3:], scalar_first=True)
        p = turn.inv().apply(self.fingers - self.pose[:3]) / self.box.sides
        axis = np.abs(p).argmax(axis=1)
        return self._faces[axis, (p[np.arange(self.count), axis] > 0).astype(int)]

    def forces(self) -> np.ndarray:
        """Return normal force times outward normal of each finger (2, 3) [N]."""
        out, wrench = np.zeros((self.count, 3)), np.zeros(6)
        first = self.model.ngeom - self.count
        for k in range(self.data.ncon):
            contact = self.data.contact[k]
            pair = sorted(contact.geom)
            if pair[0] != first - 1 or pair[1] < first:
                continue
            mujoco.mj_contactForce(self.model, self.data, k, wrench)
            sign = 1.0 if contact.geom[0] == first - 1 else -1.0
            out[pair[1] - first] += sign * wrench[0] * contact.frame[:3]
        return out

    def reading(self):
        """Return contact (2,) and normal (2, 3) as the sensors report them now."""
        end = len(self.felt) - round(self.world.latency / STEP)
        force = np.mean(self.felt[max(0, end - AVERAGED) : end], axis=0)
        size = np.linalg.norm(force, axis=1)
        least = self.world.felt
        contact = size > least
        share = np.where(contact, 1 / np.maximum(size, least), 0)
        return contact, share[:, None] * force


def recorded(box: Box, world: ForeignWorld, actions: int) -> dict[str, np.ndarray]:
    """Return the arrays of a recording: measurements, scene and truth."""
    rng = np.random.default_rng([2029, box.number])
    simulation, rows, at = Simulation(box, world), [], None
    every = round(1 / (world.rate * STEP))
    for action in range(actions):
        centre = simulation.pose[:3]
        start, aim = box.pushes(rng, centre, world.heights, world.above, world.fingers)
        if world.touching and action % 2:
            start = at
        else:
            simulation.lift()
            if action:
                simulation.carry(rng)
            simulation.hold(REST)
            simulation.place(start)
        for k in range(round(world.duration / STEP)):
            if k % every == 0:
                rows.append(row_of(simulation, action))
            at = reference(world.path, start, aim, k, world.speed)
            if world.bumped and k == round(BUMPED_AT / STEP):
                simulation.bump(rng)
            simulation.step(at)
    columns = map(np.array, zip(*rows, strict=True))
    names = ("time", "action", "finger_position", "contact", "normal",
             "object_position", "object_quaternion")  # fmt: skip
    arrays = dict(zip(names, columns, strict=True))
    if box.points is None:
        arrays["side_lengths"] = box.sides
    else:
        arrays["vertices"] = box.points
    return arrays | {
        "valid": np.ones_like(arrays["contact"]),
        "finger_radius": np.full(world.fingers, world.radius),
        "mass": box.mass, "friction_ground": box.ground, "friction_finger": box.finger,
    }  # fmt: skip


def told_of(true) -> tuple[Measurements, Scene]:
    """Return the measurements and the scene among the arrays of a recording."""
    names = ("time", "finger_position", "finger_radius", "contact", "normal")
    data = Measurements(**{k: true[k] for k in (*names, "action", "valid")})
    return data, Scene(**{k: float(true[k]) for k in SCENE})


def row_of(simulation: Simulation, action: int) -> tuple:
    """Return one sample of a recording."""
    pose, reading = simulation.pose, simulation.reading()
    fingers = simulation.fingers
    return simulation.data.time, action, fingers, *reading, pose[:3], pose[3:]
