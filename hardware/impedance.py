"""Compute joint torques from joint targets: spring, damper and weight of the links.

    torque = kp (q_target - q) + kd (dq_target - dq) + g(q), bounded

The robot's own controllers do the same at 1 kHz; at the few hundred hertz of this loop
more damping is needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactilenlp.common.validation import check_range, check_whole, numbers_of
from tactilenlp.errors import typed_call

from .errors import LimitError
from .kinematics import Finger
from .ranges import check_most, check_ranges

GRAVITY = 9.81  # [m/s^2]
ROUNDING = 1e-9  # [m] of forward and inverse kinematics
STIFFEST, MOST_DAMPED = 100.0, 10.0  # [N m/rad], [N m s/rad]: more is a wrong unit
STRONGEST = 0.396  # [N m] of a joint: 2.2 A of a motor of TriFingerPro
JUMP = 0.02  # [rad] by which a position may change beyond what the top speed explains:
# 3 rad/s of a target for 6 ms, by which stamps may be wrong
MOST_ROWS = 10_000_000  # of a path
FASTEST = 20.0  # [rad/s] of a joint, velocity limit of the URDF
SLOWEST = 1e-3  # [rad/s], least speed limit
# Mass [kg], and where its centre is in the mechanism's frame (kinematics.py) [m]:
# across, down the upper and down the lower link.  From the authors' URDF, and from
# xacro/pro of robot_properties_fingers.  `across`, and the torque of the first joint at
# zero angles, are negative for the Edu and positive for the Pro.
EDU_LINKS = (
    (0.160, -0.014 - 0.019, 0.079, 0.0),
    (0.035, -0.014 - 0.03745 - 0.009, 0.16, 0.089),
    (0.010, -0.014 - 0.03745 - 0.008, 0.16, 0.16),
)
PRO_LINKS = (
    (0.250, 0.01685 + 0.028, 0.08, 0.0),
    (0.021, 0.01685 + 0.04922, 0.16, 0.06),
    (0.031, 0.01685 + 0.04922 + 0.0185, 0.16, 0.1626),
)
LINKS = {"edu": EDU_LINKS, "edu_dair": EDU_LINKS, "pro": PRO_LINKS}  # by robot


@typed_call(LimitError)
@dataclass(frozen=True)
class Gains:
    """Hold the stiffness and damping with which joints follow their targets.

    stiffness: (3,) [N m / rad];  damping: (3,) [N m s / rad]
    torque:    [N m], bound of each joint: 2 A of a motor
    weight:    [1], 1 to compensate the weight of the links, 0 not to.  Neither masses
               nor signs were tried on a real TriFingerPro
    """

    stiffness: tuple[float, float, float] = (7.0, 7.0, 6.5)
    damping: tuple[float, float, float] = (0.15, 0.15, 0.1)
    torque: float = 0.36
    weight: float = 1.0

    def __post_init__(self) -> None:
        check_ranges("Gains.stiffness", self.stiffness, 3, 0.0, STIFFEST, "N m/rad")
        check_ranges("Gains.damping", self.damping, 3, 0.0, MOST_DAMPED, "N m s/rad")
        check_range("Gains.torque", self.torque, 0.0, STRONGEST, "N m", LimitError)
        check_range("Gains.weight", self.weight, 0.0, 2.0, "", LimitError)

    def check_bound(self, where: str, newton_metres: float, most: float) -> None:
        """Raise LimitError where the largest torque needs more than `most` [A].

        newton_metres: [N m/A] of a joint
        """
        if not (current := self.torque / newton_metres) <= most:
            raise LimitError(
                "gains.torque needs more current than the bench allows",
                where=where,
                got=f"{self.torque:g} N m / {newton_metres:g} N m/A = {current:.4g} A",
                expected=f"max_current = {most:g} A at most",
                next=f"give Gains(torque={most * newton_metres:.3g}), or the bench "
                "another max_current",
            )

    def torques(
        self,
        target: np.ndarray,
        target_velocity: np.ndarray,
        angles: np.ndarray,
        velocities: np.ndarray,
        robot: str = "edu_dair",
    ) -> np.ndarray:
        """Return the torques (3,) [N m] towards a target, within the bound.

        robot: whose links weigh on the joints, a name of kinematics.ROBOTS.
        Raises LimitError where one of the numbers is not finite.
        """
        with np.errstate(invalid="ignore", over="ignore"):  # refused below
            torque = np.array(self.stiffness) * (target - angles)
            torque += np.array(self.damping) * (target_velocity - velocities)
            torque += self.weight * holding(angles, robot)
        if np.shape(torque) != (3,) or not np.isfinite(torque).all():
            got = f"target {target}, {target_velocity}, state {angles}, {velocities}"
            raise LimitError(
                "no torque", where="target, state", got=got,
                expected="three finite numbers each",
            )  # fmt: skip
        return np.clip(torque, -self.torque, self.torque)


def holding(angles: np.ndarray, robot: str = "edu_dair") -> np.ndarray:
    """Return the torques (..., 3) [N m] that hold the links' weight at rest."""
    q0, q1, q2 = np.moveaxis(np.asarray(angles, float), -1, 0)
    s0, c0, s1, s12 = np.sin(q0), np.cos(q0), np.sin(q1), np.sin(q1 + q2)
    torque = np.zeros(np.shape(angles))
    for mass, across, upper, lower in LINKS[robot]:
        weight = mass * GRAVITY
        depth = upper * np.cos(q1) + lower * np.cos(q1 + q2)
        torque[..., 0] -= weight * (across * c0 - depth * s0)
        torque[..., 1] += weight * c0 * (upper * s1 + lower * s12)
        torque[..., 2] += weight * c0 * lower * s12
    return torque


@typed_call(LimitError)
@dataclass(frozen=True)
class Limits:
    """Hold the limits of what a robot may do; a path beyond them is refused beforehand.

    joint_speed: [rad/s], of targets
    top_speed:   [rad/s], of measured joint speeds: beyond it all motors stop
    lowest:      [m] between the tip's surface and the ground
    approach:    [rad/s], on the way to a start
    margin:      [rad], by which joints may leave their soft limits before motors stop
    longest:     [s] of an action, as its samples are in memory until it ends
    """

    joint_speed: float = 3.0
    top_speed: float = 8.0
    lowest: float = 0.001
    approach: float = 1.0
    margin: float = 0.1
    longest: float = 60.0

    def __post_init__(self) -> None:
        for name in ("joint_speed", "top_speed", "approach"):
            speed = getattr(self, name)
            check_range(f"Limits.{name}", speed, SLOWEST, FASTEST, "rad/s", LimitError)
        check_range("Limits.lowest", self.lowest, 0.0, 1.0, "m", LimitError)
        check_range("Limits.margin", self.margin, 0.0, 0.5, "rad", LimitError)
        check_range("Limits.longest", self.longest, 0.01, 3600.0, "s", LimitError)

    def check_path(
        self, name: str, finger: Finger, angles: np.ndarray, dt: float, begun=np.inf
    ) -> None:
        """Refuse a path (n, 3) [rad] of samples dt [s] apart; raises LimitError.

        begun: [m], height of the tip's surface at the start: a finger that is below
        `lowest` there may move up, but no lower.
        """
        angles = numbers_of(f"{name}, angles", angles, LimitError, "n", 3)
        check_whole(f"{name}, rows of angles", len(angles), 1, MOST_ROWS, LimitError)
        check_range(f"{name}, sample interval", dt, 1e-9, self.longest, "s", LimitError)
        outside = ~((angles >= finger.lower) & (angles <= finger.upper))
        if outside.any():
            step, joint = np.argwhere(outside)[0].tolist()
            raise LimitError(
                f"joint {joint} would leave its limits",
                where=name,
                got=f"{angles[step, joint]:.3f} rad at step {step}",
                expected=f"{finger.lower[joint]} to {finger.upper[joint]} rad",
                next="choose a trajectory within the limits",
            )
        speed = abs(np.diff(angles, axis=0)).max(initial=0.0) / dt
        told = "rad/s", "give the trajectory a longer duration"
        check_most(name, "too fast", speed, self.joint_speed, *told)
        height = finger.forward(angles)[:, 2].min() - finger.tip_radius
        lowest = min(self.lowest, begun)
        if not height >= lowest - ROUNDING:
            raise LimitError(
                "the tip would touch the ground",
                where=name,
                got=f"{1e3 * height:.1f} mm above it",
                expected=f"{1e3 * lowest:.1f} mm or more",
                next="choose a higher trajectory",
            )

    def check_state(
        self, name: str, finger: Finger, angles: np.ndarray, velocities: np.ndarray
    ) -> None:
        """Refuse to go on from a state; raises LimitError."""
        words = "a joint has left its limits", "check the zero angles of the rig"
        self._check_angles(name, finger, angles, *words)
        told = self.top_speed, "rad/s", "check the gains"
        check_most(name, "a joint runs away", velocities, *told)

    def check_jump(self, name: str, change: np.ndarray, dt: float) -> None:
        """Refuse a change (3,) [rad] of joint angles in dt [s]; raises LimitError."""
        most = self.top_speed * max(dt, 0.0) + JUMP
        what, fix = f"a joint jumps in {1e3 * dt:.1f} ms", "check encoders and cables"
        check_most(name, what, change, most, "rad", fix)

    def check_target(
        self, name: str, finger: Finger, angles: np.ndarray, velocities: np.ndarray
    ) -> None:
        """Refuse a target that a command is to be made of; raises LimitError."""
        fix = "check how the path was made"
        self._check_angles(name, finger, angles, "a target lies beyond the limits", fix)
        told = velocities, FASTEST, "rad/s", fix
        check_most(name, "a target moves too fast", *told)

    def _check_angles(
        self, name: str, finger: Finger, angles: np.ndarray, what: str, fix: str
    ) -> None:
        low, high = np.array(finger.lower), np.array(finger.upper)
        off = np.maximum(low - angles, angles - high)
        if not off.max() <= self.margin:  # NaN as well
            got, expected = f"{np.round(angles, 3)} rad", "joints within their limits"
            raise LimitError(what, where=name, got=got, expected=expected, next=fix)
