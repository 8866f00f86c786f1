"""Relate joint angles and the tip of a TriFinger's finger: forward, inverse, Jacobian.

All TriFinger robots have the same mechanism.  With the unit vectors a0, a1 of the first
two axes and a2 = -z (a right-handed frame, base of the finger), upper and lower link of
length L, and s, c for sine and cosine,

    p0 = along + L s1 + L s12                the tip, along a0
    p1 = across c0 - depth s0                along a1
    p2 = across s0 + depth c0                down
    depth = L c1 + L c12

`along` and `across` are the sums of the links' offsets.  TriFingerEdu has a0 = -x and
a1 = y, TriFingerPro a0 = y and a1 = x.  A finger of the robot is that mechanism at its
base in the world (origin on the ground below the centre of the robot, z up).

Numbers: robot_properties_fingers (stock), the URDF of the paper's robot ("edu_dair").
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tactilenlp.common.validation import check_one_of, check_range, numbers_of
from tactilenlp.errors import typed_call

from .errors import LimitError, ReachError, RigError
from .ranges import check_ranges

ROUNDING = 1e-12  # [1], a cosine this far above one is one
EDU_AXES = ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0))  # rows a0, a1, a2
TURN = 2 * math.pi  # [rad], largest angle of a finger, a robot or a joint's limit
FAR, WIDE = 10.0, 0.1  # [m], largest length of a finger, largest radius of its tip
PRO_AXES = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))


@typed_call(RigError)
@dataclass(frozen=True)
class Finger:
    """Hold one finger of a robot: pose of its base, lengths, limits of its joints.

    angle:      [rad] at which the finger stands, 0 for finger 0 (clockwise from above)
    turn:       [rad] of the whole robot about z
    height:     [m] of the base above the ground
    offset:     [m] of the base from the robot's axis, inwards where positive
    axes:       a0, a1, a2 in the finger's base frame
    along, across, link: [m], as above
    lower, upper: (3,) [rad], soft limits of the joints
    tip_radius: [m], of the sphere about the tip's origin
    """

    angle: float
    turn: float
    height: float
    offset: float
    axes: tuple
    along: float
    across: float
    link: float
    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    tip_radius: float

    def __post_init__(self) -> None:
        for name in ("angle", "turn"):
            check_range(name, getattr(self, name), -TURN, TURN, "rad", RigError)
        for name in ("height", "offset", "along", "across"):
            check_range(name, getattr(self, name), -FAR, FAR, "m", RigError)
        check_range("link", self.link, 1e-3, FAR, "m", RigError)
        check_range("tip_radius", self.tip_radius, 1e-4, WIDE, "m", RigError)
        for name in ("lower", "upper"):
            check_ranges(name, getattr(self, name), 3, -TURN, TURN, "rad", RigError)
        if not np.all(np.less(self.lower, self.upper)):
            raise RigError(
                "no limits of joints", where="lower, upper",
                got=f"{self.lower}, {self.upper}", expected="lower below upper",
            )  # fmt: skip

    @property
    def base_rotation(self) -> np.ndarray:
        """R_wb (3, 3): from the finger's base frame to the world."""
        return _turned(self.turn - self.angle)

    @property
    def base_position(self) -> np.ndarray:
        """(3,) [m], the origin of the finger's base frame in the world."""
        inwards = [-math.cos(self.angle), math.sin(self.angle), 0.0]
        p_rb = self.offset * np.array(inwards)
        return _turned(self.turn) @ p_rb + [0.0, 0.0, self.height]

    @property
    def _R_wm(self) -> np.ndarray:
        return self.base_rotation @ np.array(self.axes).T

    def forward(self, angles: np.ndarray) -> np.ndarray:
        """Return the tip (..., 3) [m] in the world at joint angles (..., 3) [rad]."""
        angles = numbers_of("angles", angles, LimitError, ..., 3)
        planar, depth = self._planar(angles)
        s0, c0 = np.sin(angles[..., 0]), np.cos(angles[..., 0])
        across = self.across
        p_m = [planar, across * c0 - depth * s0, across * s0 + depth * c0]
        return np.stack(p_m, axis=-1) @ self._R_wm.T + self.base_position

    def rotation(self, angles: np.ndarray) -> np.ndarray:
        """Return R_wt (..., 3, 3) from tip to world; at zero angles R_wb."""
        angles = numbers_of("angles", angles, LimitError, ..., 3)
        R_bt = _about(self.axes[0], angles[..., 0]) @ _about(
            self.axes[1], angles[..., 1] + angles[..., 2]
        )
        return self.base_rotation @ R_bt

    def jacobian(self, angles: np.ndarray) -> np.ndarray:
        """Return dp/dq (..., 3, 3) [m/rad], the tip in the world by joint angles."""
        angles = numbers_of("angles", angles, LimitError, ..., 3)
        planar, depth = self._planar(angles)
        q0, q12 = angles[..., 0], angles[..., 1] + angles[..., 2]
        s0, c0, zero = np.sin(q0), np.cos(q0), np.zeros_like(q0)
        first = [zero, -self.across * s0 - depth * c0, self.across * c0 - depth * s0]
        columns = [np.stack(first, axis=-1)]
        lower = self.link * np.cos(q12), -self.link * np.sin(q12)
        for d_planar, d_depth in ((depth, self.along - planar), lower):
            columns.append(np.stack([d_planar, -d_depth * s0, d_depth * c0], axis=-1))
        return self._R_wm @ np.stack(columns, axis=-1)

    def turning(self, angles: np.ndarray) -> np.ndarray:
        """Return the axes of the joints (..., 3, 3), columns, in the world."""
        angles = numbers_of("angles", angles, LimitError, ..., 3)
        a0, a1 = np.array(self.axes[:2])
        bent = _about(self.axes[0], angles[..., 0]) @ a1
        columns = [np.broadcast_to(a0, bent.shape), bent, bent]
        return self.base_rotation @ np.stack(columns, axis=-1)

    def inverse(self, position: np.ndarray) -> np.ndarray:
        """Return the angles (..., 3) [rad] that bring the tip to (..., 3) [m], world.

        Of the four solutions the one with the hand below its base and the elbow bent
        as in the working pose (q2 <= 0).  Raises ReachError where there is none.
        """
        p_w = numbers_of("position", position, ReachError, ..., 3)
        p_m = (p_w - self.base_position) @ self._R_wm
        planar = p_m[..., 0] - self.along
        square = p_m[..., 1] ** 2 + p_m[..., 2] ** 2 - self.across**2
        self._reject(p_w, ~(square >= 0), "too close to the first axis")
        depth = np.sqrt(square)
        bend = (planar**2 + square) / (2 * self.link**2) - 1
        self._reject(p_w, ~(abs(bend) <= 1 + ROUNDING), "too far away")
        q2 = -np.arccos(np.clip(bend, -1, 1))
        swing = np.arctan2(p_m[..., 2], p_m[..., 1])
        q0 = swing - np.arctan2(depth, self.across)
        q1 = np.arctan2(planar, depth) - np.arctan2(np.sin(q2), 1 + np.cos(q2))
        return np.stack([_wrapped(q0), _wrapped(q1), q2], axis=-1)

    def _planar(self, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the tip along a0, and its depth [m] before the first joint turns."""
        q1, q12 = angles[..., 1], angles[..., 1] + angles[..., 2]
        planar = self.along + self.link * (np.sin(q1) + np.sin(q12))
        return planar, self.link * (np.cos(q1) + np.cos(q12))

    def _reject(self, position: np.ndarray, bad: np.ndarray, what: str) -> None:
        if not np.any(bad):
            return
        index = tuple(np.argwhere(bad)[0].tolist())
        got = f"{position[index].tolist()} m" + (f" at index {index}" if index else "")
        expected = f"a point that links of {self.link} m reach"
        parts = {"where": "inverse", "got": got, "expected": expected}
        raise ReachError(what, next="check frame and unit (world, metres)", **parts)


EDU = Finger(
    angle=0.0,
    turn=-math.pi / 2,
    height=0.283,
    offset=0.0455,
    axes=EDU_AXES,
    along=0.0,
    across=-0.014 - 0.03745 - 0.008,
    link=0.16,
    lower=(-1.6, -1.2, -3.0),
    upper=(1.0, 1.6, 3.0),
    tip_radius=0.0095,  # cap of the printed tip, centred on the tip's origin
)
PRO = replace(
    EDU,
    turn=0.0,
    height=0.29,
    offset=0.0,
    axes=PRO_AXES,
    along=0.0505,
    across=0.01685 + 0.05015 + 0.019,
    lower=(-0.33, 0.0, -2.7),
    upper=(1.0, 1.57, 0.0),
    tip_radius=0.01,
)
ROBOTS = {  # the authors' tip: a DenseTact with a margin
    "edu": EDU,
    "edu_dair": replace(EDU, height=0.282, offset=0.0395, tip_radius=0.01575),
    "pro": PRO,
}
STEP = 1e-4  # [m] of differences of a Jacobian
INITIAL = (0.0, 0.9, -1.7)  # [rad], the pose in which the robots start


def finger(robot: str = "edu_dair", degrees: float = 0.0) -> Finger:
    """Return the finger that stands at so many degrees on "edu", "edu_dair" or "pro".

    Stock robots have fingers at 0, 120 and 240 degrees, the paper's at 0 and 180.
    """
    check_one_of("robot", robot, ROBOTS, "no such robot", RigError)
    check_range("degrees", degrees, -360.0, 360.0, "deg", RigError)
    return replace(ROBOTS[robot], angle=math.radians(degrees))


def joints_about(fingers, places) -> dict[str, np.ndarray]:
    """Return what tactilenlp.JointZeros asks of fingers: place, jacobian, change.

    places: (F, 3) [m], where the tip of each works, world; to a few centimetres.
    """
    found = {"place": [], "jacobian": [], "change": []}
    places = numbers_of("places", places, ReachError, len(fingers), 3, unit="[m]")
    for finger, place in zip(fingers, places, strict=True):
        ends = place + STEP * np.array([np.eye(3), -np.eye(3)])
        ahead, behind = finger.jacobian(finger.inverse(ends))
        angles = finger.inverse(place)
        both = [finger.jacobian(angles), finger.turning(angles)]
        found["place"].append(place)
        found["jacobian"].append(np.concatenate(both))
        found["change"].append(np.moveaxis(ahead - behind, 0, -1) / (2 * STEP))
    return {name: np.array(values) for name, values in found.items()}


def _turned(angle: float) -> np.ndarray:
    """Return the rotation (3, 3) about z."""
    s, c = math.sin(angle), math.cos(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _about(axis: tuple, angle: np.ndarray) -> np.ndarray:
    """Return rotations (..., 3, 3) about a unit axis by angles (...) [rad]."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angle)[..., None, None], np.cos(angle)[..., None, None]
    return np.eye(3) + s * cross + (1 - c) * (cross @ cross)


def _wrapped(angle: np.ndarray) -> np.ndarray:
    """Return angles in (-pi, pi]."""
    return math.pi - (math.pi - angle) % (2 * math.pi)
