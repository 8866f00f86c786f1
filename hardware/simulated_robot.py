"""Simulate a robot on all wires of a rig: boards, fingers, sensors, an object.

The object and the fingertips are tactilenlp's simulation.  A finger is a point mass
that the torques of its motors push through the Jacobian, against friction in the joints
and the weight of the links; encoders measure its true position up to an error of the
zero angles.  Sensors measure the simulated contact force: pictures of a DenseTact,
packets of an OptoForce.

While no current flows, the fingers are held fixed.  The robot is a clock: time passes
only during `sleep`, so that a run gives the same digits on any computer.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tactilenlp.simulation.mujoco_plant import SERVO_STIFFNESS, TIME_STEP, Plant

from .impedance import holding
from .kinematics import INITIAL
from .motor_can import Quantity
from .motor_joints import JointMap
from .rig import CAMERA, FingerRig, Rig, Tactile
from .simulated_board import SimulatedBoard
from .simulated_sensors import FORCES, simulated_sensor
from .touch import INWARD

NOON = 1.7e9  # [s], time of day at the start of the simulation
COULOMB, VISCOUS = 0.043, 0.02  # [N m], [N m s/rad] in a joint; the first measured
SLIP = 0.05  # [rad/s], below it Coulomb friction is viscous
WIRES = 500.0  # [Hz] of boards; the real ones send at 1 kHz
SKIN = 0.02  # [1], share of a change that a skin follows in a step: 12 ms
FRICTION = 0.3, 0.5  # [1], object and ground, object and finger
SENT = (Quantity.POSITION, Quantity.VELOCITY)


class SimulatedFinger:
    """Hold one finger: boards of its motors, true kinematics, sensor."""

    def __init__(self, rig: FingerRig, zero_error: np.ndarray, seed: int) -> None:
        self.rig, self.geometry = rig, rig.geometry
        true = np.array(rig.joints.zero) + zero_error
        self.joints = JointMap(rig.joints.motors, tuple(true.tolist()))
        self.boards = [
            SimulatedBoard(c, alignment=0.02, streams=SENT, period=0.05)
            for c in rig.boards
        ]
        self.skin = simulated_sensor(rig.tactile, seed)

    @property
    def torques(self) -> np.ndarray:
        """The torques (3,) [N m] of the currents that flow."""
        return self.joints.torques(np.stack([board.current for board in self.boards]))


class SimulatedRobot:
    """Simulate the robot of a rig; `with` opens the other ends of its wires.

    side_lengths: (3,) [m] of the box, `position` (2,) [m] and `quaternion` (4,) of its
                  pose;  mass [kg];  friction of ground and fingers [1]
    zero_error:   (F, 3) [rad], error of the rig's zero angles
    angles:       (F, 3) [rad], true joint angles at the start
    seed:         of pictures and their noise

    Use it as clock and for the sensors of a bench:
    `Bench(rig, clock=robot, reader=robot.reader, listen_only=False)`.
    `after` is called after every step of the wires, with the time [s].  `wall_step` [s]
    is by how much the wall clock, which stamps frames, was set since the beginning.
    """

    def __init__(
        self,
        rig: Rig,
        side_lengths: tuple = (0.058, 0.049, 0.053),
        *,
        position: tuple = (0.0, 0.0),
        quaternion: tuple = (1.0, 0.0, 0.0, 0.0),
        mass: float = 0.5,
        friction: tuple = FRICTION,
        zero_error: np.ndarray | None = None,
        angles: np.ndarray | None = None,
        seed: int = 0,
    ) -> None:
        count = len(rig.fingers)
        error = np.zeros((count, 3)) if zero_error is None else np.asarray(zero_error)
        self.fingers = [
            SimulatedFinger(one, error[k], seed + k)
            for k, one in enumerate(rig.fingers)
        ]
        self.after: Callable[[float], None] | None = None
        self.rig = rig
        self._plant = Plant(
            side_lengths=np.array(side_lengths, float),
            vertices=None,
            pose=np.array([*position, side_lengths[2] / 2, *quaternion], float),
            mass=mass,
            friction=tuple(friction),
            finger_radius=np.array([f.geometry.tip_radius for f in self.fingers]),
            ground=0.0,
            gravity=9.81,
            max_force=50.0,
        )
        start = np.tile(INITIAL, (count, 1)) if angles is None else np.asarray(angles)
        tips = [f.geometry.forward(q) for f, q in zip(self.fingers, start, strict=True)]
        self._plant.place(np.array(tips))
        self._tips, self._velocity = np.array(tips), np.zeros((count, 3))
        self._touch = np.zeros((count, 6))
        self._torque, self._inverse = np.zeros((count, 3)), np.zeros((count, 3, 3))
        self._now = self._wires_due = NOON
        self.wall_step = 0.0

    def __enter__(self) -> SimulatedRobot:
        for finger in self.fingers:
            for board in finger.boards:
                board.__enter__()
            finger.skin.open()
        return self

    def __exit__(self, *exception) -> None:
        for finger in self.fingers:
            for board in finger.boards:
                board.__exit__(*exception)
            finger.skin.close()

    @property
    def pose(self) -> np.ndarray:
        """The true pose of the object (7,): position [m], quaternion wxyz."""
        return self._plant.pose

    @property
    def tips(self) -> np.ndarray:
        """The true positions of the fingertips (F, 3) [m]."""
        return self._tips.copy()

    def now(self) -> float:
        """Return the time [s]."""
        return self._now

    def wall(self) -> float:
        """Return the time of day [s], by which frames are stamped."""
        return self._now + self.wall_step

    def sleep(self, duration: float) -> None:
        """Let a duration [s] pass."""
        end = self.now() + duration
        while self._now < end - TIME_STEP / 2:
            if self._now >= self._wires_due - TIME_STEP / 2:
                self._wires_due = max(self._wires_due, self._now) + 1 / WIRES
                self._talk(self._now)
            live = any(board.live for one in self.fingers for board in one.boards)
            steps = max(round((min(end, self._wires_due) - self._now) / TIME_STEP), 1)
            for _ in range(steps if live else 0):
                self._step()
            self._now += steps * TIME_STEP

    def reader(self, tactile: Tactile, name: str, sink, clock) -> object:
        """Return the reader of a sensor: pictures directly, other data by its wire."""
        if tactile.wire != CAMERA:
            return tactile.reader(name, sink, clock)
        named = {f"{one.rig.name}, tactile": one for one in self.fingers}
        skin = named[name].skin
        skin.name, skin.sink, skin.clock = name, sink, self
        return skin

    def _step(self) -> None:
        # Friction changes with every step, the Jacobian only as fast as the wires.
        velocity = np.einsum("fij,fj->fi", self._inverse, self._velocity)
        drag = VISCOUS * velocity + COULOMB * np.tanh(velocity / SLIP)
        force = np.einsum("fji,fj->fi", self._inverse, self._torque - drag)
        # with this goal the servo of the plant applies exactly this force
        goal = self._tips + force / SERVO_STIFFNESS
        touch = self._plant.follow(np.stack([goal - TIME_STEP * self._velocity, goal]))[
            0
        ]
        tips = self._plant.fingers
        self._velocity, self._tips = (tips - self._tips) / TIME_STEP, tips
        self._touch += SKIN * (touch - self._touch)

    def _talk(self, now: float) -> None:
        """Receive and send on all wires; update joint angles, Jacobians and torques."""
        for k, finger in enumerate(self.fingers):
            angles = finger.geometry.inverse(self._tips[k])
            self._inverse[k] = np.linalg.inv(finger.geometry.jacobian(angles))
            turns = finger.joints.revolutions(angles)
            krpm = finger.joints.krpm(self._inverse[k] @ self._velocity[k])
            for b, board in enumerate(finger.boards):
                board.listen(now)
                measured = {Quantity.POSITION: turns[b], Quantity.VELOCITY: krpm[b]}
                board.talk(measured, now, self.wall())
            self._torque[k] = finger.torques - holding(angles, finger.rig.robot)
            R_tw = finger.geometry.rotation(angles).T
            force, press = R_tw @ -self._touch[k, :3], R_tw @ self._touch[k, 3:]
            finger.skin.send(force, press, now, self.wall())
        if self.after is not None:
            self.after(now)


def simulated_rig(kind: str = "densetact", name: str = "simulated") -> Rig:
    """Return the paper's two opposing fingers on virtual wires.

    kind: densetact (320 x 240 px), optoforce or optoforce_can
    name: of the channels; two robots in one process need two
    """

    def bus(channel: str) -> dict:
        wire = {"interface": "virtual", "channel": f"{name} {channel}"}
        return wire | {"preserve_timestamps": True}

    fingers = []
    for k, degrees in enumerate((180.0, 0.0)):  # finger 0 comes from +x, as in the data
        touch: dict = {"mount": INWARD, "rest": 10}
        options: dict = {"can": bus(f"{k} tactile")} if kind.endswith("can") else {}
        if kind == "densetact":
            touch["lens"] = {"centre": (160.0, 120.0), "edge": 118.0}
            options["camera"] = {"size": (320, 240)}
        tactile = Tactile(kind, touch=touch, speed=FORCES, **options)
        boards = bus(f"{k} board 0"), bus(f"{k} board 1")
        fingers.append(FingerRig(f"finger {k}", degrees, boards, tactile))
    return Rig(tuple(fingers))
