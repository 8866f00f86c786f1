"""Actions of the fingers: straight lines towards a target, as in the paper."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import cache

import casadi as ca
import numpy as np

from formulations import exploration as page

from ..common.brief import printed, shown
from ..common.validation import (
    as_array,
    as_floats,
    check_numbers,
    check_types,
    check_whole,
    checked_array,
)
from ..data.ground import frame_of
from ..data.scene import Ground
from ..errors import OptionError, shortened, typed_call

POINT_RATE = 100  # [Hz] points of a trajectory
MOST_FINGERS = 100  # [1]
MOST_POINTS = 20_000  # [1] of all fingers in a trajectory
MAX_RADIUS = 10.0  # [m]; larger values are most likely millimetres
SIMULATION_BOUND, ROBOT_BOUND = 2 * np.pi / 5, np.pi / 4  # [rad] of the paper
SINGLE_FINGER_BOUND = np.pi  # [rad] of right ascension: any direction
FREE_DRAWS = 1000  # [1] actions drawn at most until one avoids the obstacles


@printed
@typed_call()
@dataclass(frozen=True, eq=False)
class Trajectory:
    """Commanded finger positions.

    time:            (n,) [s]
    finger_position: (n, F, 3) [m], world frame; a finger of constant position is parked
    """

    time: np.ndarray
    finger_position: np.ndarray


@typed_call()
@dataclass(frozen=True)
class Workspace:
    """The fingers and the space of their actions.

    fingers:       [1], number of fingers
    bound:         [rad], of both approach angles, 2 pi / 5 as in the paper's simulation
    radius:        [m], of the sphere on which lines start
    duration:      [s], of an action
    finger_radius: [m]
    gap:           [m], least distance between the surfaces of two fingertips
    clearance:     [m], least height of a fingertip above the ground
    stiffness:     [N/m], of a finger's servo
    max_force:     [N], of a finger's servo
    ground:        Ground, in whose frame all angles are; None: world frame, no ground
    obstacles:     rows (x, y, z, x, y, z) [m], lowest and highest corner of boxes that
                   no fingertip may meet on its way; world frame, infinite ones as well
    """

    fingers: int = 2
    bound: float = SIMULATION_BOUND
    radius: float = 0.1
    duration: float = 1.0
    finger_radius: float = 0.01
    gap: float = 0.005
    clearance: float = 0.002
    stiffness: float = 3125.0
    max_force: float = 8.0
    ground: Ground | None = field(default_factory=Ground)
    obstacles: tuple = ()

    def __post_init__(self) -> None:
        what = "no integer in range"
        check_whole("fingers", self.fingers, 1, MOST_FINGERS, what=what)
        check_types(ground=(self.ground, (Ground, type(None))))
        for name in (f.name for f in fields(self) if f.type == "float"):
            limits = getattr(self, name), 0, np.finfo(float).max
            check_numbers("a finite number above 0", **{name: limits})
        if self.bound > np.pi / 2:
            fix = "convert degrees by numpy.radians"
            raise _option_error("bound", "at most pi / 2 [rad]", self.bound, fix)
        if self.radius > MAX_RADIUS:
            fix = "divide by 1000 if these are millimetres"
            raise _option_error(
                "radius", f"at most {MAX_RADIUS:.0f} m", self.radius, fix
            )
        least = self.apart / np.sin(np.pi / max(self.fingers, 2))
        if self.radius <= least:
            fix = "lines must start outside the gap between fingers"
            raise _option_error("radius", f"above {least:.3g} m", self.radius, fix)
        boxes = as_floats(self.obstacles)
        rows = boxes.ndim == 2 and boxes.shape[1] == 6
        if boxes.size and not (rows and (boxes[:, :3] < boxes[:, 3:]).all()):
            expected = "rows of six numbers [m], the lower corner first"
            raise _option_error("obstacles", expected, self.obstacles)
        object.__setattr__(self, "obstacles", tuple(map(tuple, boxes.tolist())))

    @classmethod
    def robot(cls, **overrides) -> Workspace:
        """Return the workspace of the paper's robot: both angles within pi / 4."""
        return cls(**{"bound": ROBOT_BOUND} | overrides)

    @classmethod
    def simulation(cls, **overrides) -> Workspace:
        """Return the paper's simulation, the default: both angles within 2 pi / 5."""
        return cls(**overrides)

    def around(self, reach: float) -> Workspace:
        """Return the workspace, its lines so long that they start outside a body.

        reach [m]: from the target, of all its points.
        """
        return replace(self, radius=max(self.radius, reach + self.apart))

    @property
    def apart(self) -> float:
        """Least distance [m] of a fingertip's centre from the next finger's sector."""
        return self.finger_radius + self.gap / 2

    @property
    def lower(self) -> np.ndarray:
        """Least angles (2 F,) [rad]: right ascension and declination of every finger.

        No declination is negative: such a line would meet the ground.
        """
        return np.tile([-self._sideways, 0.0], self.fingers)

    @property
    def upper(self) -> np.ndarray:
        """Largest angles (2 F,) [rad]."""
        return np.tile([self._sideways, self.bound], self.fingers)

    @property
    def _sideways(self) -> float:
        if self.fingers == 1:
            return SINGLE_FINGER_BOUND
        return min(self.bound, np.pi / self.fingers)

    def action(self, angles, active=None) -> Action:
        """Return the action with these angles (2 F,) [rad], checked."""
        return Action(angles, self, active)

    def random(self, rng: np.random.Generator, active=None, target=None) -> Action:
        """Return an action drawn uniformly, given a target (3,) [m] from the free ones.

        Raises OptionError where FREE_DRAWS actions meet an obstacle on the way to it.
        """
        check_types(rng=(rng, np.random.Generator))
        for _ in range(FREE_DRAWS):
            action = self.action(rng.uniform(self.lower, self.upper), active)
            if target is None or not action.blocked(target):
                return action
        action.trajectory(target)  # raises

    def parked(self, middle, away: float) -> np.ndarray:
        """Return places (F, 3) [m] of parked fingers, each in its sector, ground frame.

        away [m]: from the middle (3,) [m], horizontally; half as far above it.
        """
        heading = 2 * np.pi * np.arange(self.fingers) / self.fingers
        outward = [np.cos(heading), np.sin(heading), np.full(self.fingers, 0.5)]
        return middle + away * np.stack(outward, axis=1)

    def blocked(self, way: np.ndarray) -> bool:
        """Tell whether a finger, parked or not, meets an obstacle; way (n, F, 3)."""
        way = way[:, :, None]
        low, high = np.reshape(self.obstacles, (-1, 2, 3)).swapaxes(0, 1)
        away = np.linalg.norm(way - np.clip(way, low, high), axis=-1)
        return bool((away < self.finger_radius).any())


def workspace_of(radius, ground: Ground | None) -> Workspace:
    """Return the default workspace above a ground.

    radius [m]: of the fingers, (F,) or a number for the default ones; None: not known.
    """
    if radius is None:
        return Workspace(ground=ground)
    fingers = len(radius) if np.ndim(radius) else Workspace.fingers
    return Workspace(fingers, ground=ground, finger_radius=float(np.max(radius)))


@shown
@typed_call()
@dataclass(frozen=True, eq=False)
class Action:
    """One motion of all fingers towards a target.

    angles:    (2 F,) [rad], right ascension and declination of each finger
    workspace: Workspace
    active:    (F,) bool, fingers that move, all by default; the others stay parked
    """

    angles: np.ndarray
    workspace: Workspace
    active: tuple[bool, ...] | None = None

    def __post_init__(self) -> None:
        check_types(workspace=(self.workspace, Workspace))
        space = self.workspace
        angles = checked_array("angles", self.angles, ..., unit="[rad]").ravel()
        if angles.shape != space.lower.shape:
            expected = f"{2 * space.fingers} angles [rad], two of each finger"
            raise _option_error("angles", expected, angles.tolist())
        outside = (angles < space.lower - 1e-9) | (angles > space.upper + 1e-9)
        if outside.any():
            k = int(np.argmax(outside))
            limits = f"{space.lower[k]:.3g} to {space.upper[k]:.3g}"
            expected = f"{2 * space.fingers} angles [rad], this one within {limits}"
            raise _option_error(f"angles[{k}]", expected, float(angles[k]))
        active = (True,) * space.fingers if self.active is None else self.active
        flags = as_array(active, "biu")
        if flags is None or flags.shape != (space.fingers,) or not flags.any():
            expected = f"{space.fingers} booleans, one True"
            raise _option_error("active", expected, active)
        active = tuple(flags.astype(bool).tolist())
        object.__setattr__(self, "angles", np.clip(angles, space.lower, space.upper))
        object.__setattr__(self, "active", active)

    @property
    def directions(self) -> np.ndarray:
        """Unit vectors (F, 3) from the target to the fingers, ground frame."""
        headings = 2 * np.pi * np.arange(self.workspace.fingers) / len(self.active)
        triples = zip(headings, *self.angles.reshape(-1, 2).T, strict=True)
        return np.array([ca.DM(page.direction(*t)).full()[:, 0] for t in triples])

    def trajectory(self, target) -> Trajectory:
        """Return the path of all fingers towards a target (3,) [m], world frame.

        Raises OptionError if it meets an obstacle.
        """
        space, way = self.workspace, self.positions(target)
        if space.blocked(way):
            expected = f"a way to {np.round(target, 4).tolist()} m that avoids them"
            fix = "give other angles, or move the obstacles"
            raise _option_error("obstacles", expected, space.obstacles, fix)
        return Trajectory(np.linspace(0, space.duration, len(way)), way)

    def blocked(self, target) -> bool:
        """Tell whether a fingertip meets an obstacle on its way to a target (3,)."""
        space = self.workspace
        return bool(space.obstacles) and space.blocked(self.positions(target))

    def positions(self, target: np.ndarray, n: int | None = None) -> np.ndarray:
        """Return positions (n, F, 3) [m] at n instants, the trajectory's by default."""
        n = max(2, round(self.workspace.duration * POINT_RATE) + 1) if n is None else n
        space, target = self.workspace, checked_array("target", target, 3, unit="[m]")
        most = MOST_POINTS // space.fingers
        check_whole(f"n ({POINT_RATE} per second of duration)", n, 2, most)
        frame = frame_of(space.ground)
        target = frame.to_ground(target)
        alone = sum(self.active) == 1
        lowest = -np.inf if space.ground is None else space.clearance
        lowest += space.finger_radius
        limits = [space.radius, 0.0 if alone else space.apart, space.apart, lowest]
        way = _finger_lines(space.fingers, n, alone)(self.angles, target, limits)
        way = np.array(way.full()).T.reshape(n, space.fingers, 3)
        still = ~np.array(self.active)
        way[:, still] = space.parked(target, 2 * space.radius)[still]
        return frame.from_ground(way)


@cache
def _finger_lines(fingers: int, n: int, alone: bool) -> ca.Function:
    """Return the function (angles, target, limits) -> finger positions (3 F, n) [m].

    alone: one finger moves, in the half-space of its heading, the others are parked.
    """
    angles, target = ca.SX.sym("angles", 2 * fingers), ca.SX.sym("target", 3)
    limits = ca.SX.sym("limits", 4)
    radius, end, apart, lowest = ca.vertsplit(limits)
    width, columns = np.pi / (2 if alone else max(fingers, 2)), []
    for s in np.linspace(0, 1, n):
        rows = []
        for f in range(fingers):
            heading = 2 * np.pi * f / fingers
            toward = page.direction(heading, angles[2 * f], angles[2 * f + 1])
            offset = page.line(s, toward, radius, end)
            if fingers > 1:
                offset = page.kept_apart(offset, heading, width, apart)
            rows.append(page.above_ground(target + offset, lowest))
        columns.append(ca.vertcat(*rows))
    out = [ca.horzcat(*columns)]
    return ca.Function("way", [angles, target, limits], out, {"cse": True})


def _option_error(
    where: str, expected: str, got: object, next: str = ""
) -> OptionError:
    problem = "not an action" if where == "angles" else "cannot be planned with"
    got = shortened(got, str, 80)
    return OptionError(problem, where=where, expected=expected, got=got, next=next)
