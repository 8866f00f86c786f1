"""Step one rigid object and the fingers that push it, by MuJoCo."""

from __future__ import annotations

import numpy as np

from ..errors import OptionError, SceneError, TactileError

TIME_STEP = 1 / 4080  # [s]; an impact at 0.2 m/s sinks in by 0.05 mm in one step
# Contacts settle in 1 ms (MuJoCo wants two steps at least) without rebound, under the
# largest impedance that MuJoCo takes: 8 N sink in by less than 0.1 um.  Friction is ten
# times as stiff: no creep is left that the slow noslip solver could remove.
CONTACT_SETTINGS = 'condim="3" solref="{} {}" solimp="0.9999 0.9999 0.001"'
CONTACT_TIME = 0.001  # [s] of a contact without rebound
REBOUND_TIME = 0.005  # [s] of one with rebound: many steps, or it gains energy
MAX_RESTITUTION = 0.9  # [1]; above, contacts oscillate for long
SOLVER_SETTINGS = (
    'integrator="implicitfast" cone="elliptic" impratio="10" tolerance="1e-10"'
)
FINGER_MASS = 0.05  # [kg], a fingertip; the object feels it in impacts only
SERVO_STIFFNESS = 3125.0  # [N/m] of the servo: a finger alone reaches 250 rad/s
# Critical for 0.5 kg in front of the finger; with less damping a push is many impacts.
SERVO_DAMPING = 2 * (SERVO_STIFFNESS * (FINGER_MASS + 0.5)) ** 0.5  # [N s/m]
PARKING_HEIGHT = 10.0  # [m] least height of the fingers before the first action
PARKING_GAP = 1.0  # [m] then: least gap to the object, least distance of two centres
MAX_OVERLAP = 1e-5  # [m] of a placed finger; a resting object sinks in by 0.1 um


class Plant:
    """The MuJoCo model of one free object, a ground plane and F servo-driven fingers.

    side_lengths:   (3,) [m] of a box, or None for the convex hull of
    vertices:       (V, 3) [m] in the body frame
    pose:           (7,) position [m] and quaternion wxyz, body to world
    mass:           [kg]
    friction:       [1] with the ground, with the fingers
    finger_radius:  (F,) [m]
    ground:         [m] height of the ground plane, or None
    gravity:        [m/s^2]
    max_force:      [N] of a finger's servo
    restitution:    [1] of all contacts

    The arguments are not checked here (see arguments.py).
    """

    def __init__(
        self,
        *,
        side_lengths: np.ndarray | None,
        vertices: np.ndarray | None,
        pose: np.ndarray,
        mass: float,
        friction: tuple[float, float],
        finger_radius: np.ndarray,
        ground: float | None,
        gravity: float,
        max_force: float,
        restitution: float = 0.0,
    ) -> None:
        import mujoco  # lazily: importing this module stays light

        body, contact = (side_lengths, vertices, mass), _contact(restitution)
        xml = _xml(*body, friction, finger_radius, ground, contact)
        try:
            self.model = mujoco.MjModel.from_xml_string(xml)
        except ValueError as bad:
            raise SceneError(
                "MuJoCo refuses this world", where="World", got=str(bad),
                expected="a mass and an extent that its solver can compute with",
                next="check mass [kg], lengths [m] and friction",
            ) from bad  # fmt: skip
        self.model.opt.gravity[:] = 0.0, 0.0, -gravity
        self._data = mujoco.MjData(self.model)
        self._object = self.model.geom("object").id
        self._first = self._object + 1  # the geoms of the fingers follow the object's
        top = pose[2] + self.model.geom_rbound[self._object]
        self._data.qpos[:] = np.concatenate([pose, _parked(top, finger_radius)])
        self._max_force = max_force
        self.steps = 0

    @property
    def pose(self) -> np.ndarray:
        """The pose of the object (7,): position [m], quaternion wxyz."""
        return self._data.qpos[:7].copy()

    @property
    def fingers(self) -> np.ndarray:
        """The centres of the fingers (F, 3) [m]."""
        return self._data.qpos[7:].reshape(-1, 3).copy()

    def distance(self) -> np.ndarray:
        """Return the distances (F,) [m] of finger surfaces to the object's, signed."""
        import mujoco

        model, data, far = self.model, self._data, 2 * PARKING_HEIGHT
        mujoco.mj_kinematics(model, data)  # geoms lag one step behind the coordinates
        fingers = range(self._first, model.ngeom)
        pairs = ((model, data, f, self._object, far, None) for f in fingers)
        return np.array([mujoco.mj_geomDistance(*pair) for pair in pairs])

    def place(self, position: np.ndarray) -> None:
        """Place the fingers at position (F, 3) [m], at rest.

        Raises OptionError if one is inside the object, the ground or a finger.
        """
        import mujoco

        self._data.qpos[7:], self._data.qvel[6:] = position.ravel(), 0.0
        mujoco.mj_forward(self.model, self._data)
        contact = self._data.contact
        geoms, overlap = contact.geom.reshape(-1, 2).max(axis=1), -contact.dist
        deep = np.flatnonzero((geoms >= self._first) & (overlap > MAX_OVERLAP))
        if len(deep):
            finger = geoms[deep[0]] - self._first
            raise OptionError(
                f"finger {finger} starts inside the object, the ground or a finger",
                where="finger_position",
                got=f"an overlap of {overlap[deep[0]]:.6f} m",
                expected="free space",
                next="start further out; World.truth has the pose of the object",
            )

    def hold(self, duration: float) -> None:
        """Step for a duration [s] while the fingers stay where they are."""
        self.follow(
            np.repeat(self.fingers[None], round(duration / TIME_STEP) + 1, axis=0)
        )

    def follow(self, reference: np.ndarray) -> np.ndarray:
        """Step through finger references (n + 1, F, 3) [m], one per step.

        Returns (n, F, 6) [N], per step and finger: the force on the object, then the
        normal force times the object's outward normal.
        """
        velocity = np.diff(reference, axis=0) / TIME_STEP
        touch = np.array(
            [self._step(*goal) for goal in zip(reference[1:], velocity, strict=True)]
        )
        if (
            abs(self._data.time - self.steps * TIME_STEP) > TIME_STEP
        ):  # MuJoCo resets itself
            raise TactileError(
                "the simulation diverged",
                where="Plant.follow",
                next="look for an object that is very light, thin or fast",
            )
        return touch.reshape(-1, reference.shape[1], 6)

    def _step(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Advance by a step of the servos to position (F, 3) [m]; return the touch."""
        import mujoco

        data = self._data
        force = SERVO_STIFFNESS * (position - data.qpos[7:].reshape(-1, 3))
        force += SERVO_DAMPING * (velocity - data.qvel[6:].reshape(-1, 3))
        size = np.linalg.norm(force, axis=1, keepdims=True)
        force *= self._max_force / np.maximum(size, self._max_force)
        data.qfrc_applied[6:] = force.ravel()
        mujoco.mj_step(self.model, data)
        self.steps += 1
        return self._touch()

    def _touch(self) -> np.ndarray:
        """Return (F, 6) [N] of each finger, as `follow` does."""
        import mujoco

        touch, wrench = np.zeros((self.model.ngeom - self._first, 6)), np.zeros(6)
        geoms = self._data.contact.geom
        if geoms.max(initial=0) < self._first:
            return touch
        low, high = geoms.min(axis=1, initial=self._first), geoms.max(axis=1, initial=0)
        for k in np.flatnonzero((low == self._object) & (high >= self._first)):
            mujoco.mj_contactForce(self.model, self._data, k, wrench)
            frame = self._data.contact.frame[k].reshape(3, 3)
            # Row 0 points from geom 0 to geom 1; the force is the one on geom 1.
            sign = 1.0 if geoms[k, 1] == self._object else -1.0
            finger = high[k] - self._first
            touch[finger, :3] += sign * wrench[:3] @ frame
            touch[finger, 3:] -= sign * wrench[0] * frame[0]
        return touch


def _xml(side_lengths, vertices, mass, friction, finger_radius, ground, contact) -> str:
    """Return the XML model of these arguments of a Plant; contact: of _contact.

    MuJoCo uses the larger friction of two geoms.
    """
    mesh, plane, geom = "", "", 'type="mesh" mesh="object"'
    if side_lengths is None:
        mesh = f'<asset><mesh name="object" vertex="{_text(vertices)}"/></asset>'
    else:
        geom = f'type="box" size="{_text(side_lengths / 2)}"'
    if ground is not None:
        plane = f"""<geom name="ground" type="plane" size="1 1 1"
            pos="0 0 {ground}" friction="{friction[0]} 0 0"/>"""
    slides = "".join(f'<joint type="slide" axis="{_text(e)}"/>' for e in np.eye(3))
    fingers = "".join(
        f"""<body gravcomp="1">{slides}<geom type="sphere" size="{radius}"
            mass="{FINGER_MASS}" friction="{friction[1]} 0 0"/></body>"""
        for radius in finger_radius.tolist()
    )
    return f"""<mujoco><option timestep="{TIME_STEP}" {SOLVER_SETTINGS}/>
        <default><geom {contact}/></default>{mesh}
        <worldbody>{plane}<body><freejoint/><geom name="object" {geom} mass="{mass}"
            friction="0 0 0"/></body>{fingers}</worldbody></mujoco>"""


def _parked(top: float, finger_radius: np.ndarray) -> np.ndarray:
    """Return the coordinates (3 F,) [m] of fingers that meet neither object nor finger.

    top: [m], height of the object's bounding sphere.  Before the first action the
    object rests, floats or falls, so that no part of it rises above that height, and
    the ground is below.
    """
    largest = finger_radius.max()
    z = max(PARKING_HEIGHT, top + largest + PARKING_GAP)
    spacing = max(PARKING_GAP, 3 * largest)  # surfaces are a radius apart or more
    return np.ravel([[f * spacing, 0.0, z] for f in range(len(finger_radius))])


def _contact(restitution: float) -> str:
    """Return MuJoCo's contact parameters for a coefficient of restitution.

    A spring and damper that cannot pull end the contact when their force is zero.  The
    restitution is then exp(-z (pi - atan(2 z s / (1 - 2 z^2))) / s), with the damping
    ratio z and s = sqrt(1 - z^2) (Schwager and Poeschel, 2007).
    """
    if restitution == 0:
        return CONTACT_SETTINGS.format(CONTACT_TIME, 1)
    z = np.linspace(0.01, 0.99, 1000)
    s = np.sqrt(1 - z**2)
    left = np.exp(-z / s * (np.pi - np.arctan2(2 * z * s, 1 - 2 * z**2)))
    return CONTACT_SETTINGS.format(REBOUND_TIME, np.interp(-restitution, -left, z))


def _text(numbers: np.ndarray) -> str:
    return " ".join(map(repr, np.ravel(numbers).tolist()))
