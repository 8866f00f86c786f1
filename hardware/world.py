"""Move the fingers of a robot, and return measurements: the world for `explore`.

    with Bench(rig, listen_only=False) as bench, RobotWorld(bench) as world:
        data = world.execute(trajectory)

After any error (a silent wire, a fault, a limit, Ctrl-C) all motors get zero current
first; then the error is passed on to the caller.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np

from tactilenlp.common.validation import check_range
from tactilenlp.data.measurements import Measurements

from .assemble import COMPLETE, assemble
from .bench import TOUCH_STALE, Bench, FingerBench
from .clock import HostClock
from .errors import ClockError, HardwareError, LimitError
from .impedance import Gains, Limits
from .motor_board import RECEIVE_TIMEOUT, STALE
from .paths import PEAK, row_of, tip_paths, way_back, way_there

CONTROL = 250.0  # [Hz] of commands
CONTROLS = 50.0, 2000.0  # [Hz], between which it may be
HELD_UP = 0.1  # [s] between commands, beyond which the loop is held up
SETTLE = 0.1  # [s] at the start of a trajectory, not recorded
KEEP = 0.02  # [s] between two tests whether the thread is to end
LAST = 1.0  # [s] that its last command may take: then the boards are stopped anyway
THERE = 1e-3  # [rad], a start that is closer needs no motion


class RobotWorld:
    """Execute trajectories on the robot of an open bench (listen_only=False).

    gains, limits: of the control
    control:       [Hz] of the control loop
    complete:      [1], least share of valid samples of a finger that moves

    `measurements` holds all actions so far, None before the first one; `origin` [s] is
    the host time of their time 0.

    Motors are enabled by `start` or at the first action; after a stop, of an error
    too, by `start` only.  Between actions a thread holds the fingers, unless the clock
    is simulated and does not run then.  `stop` ends the thread, a start and an action,
    and takes the current away, and so does the end of a `with` block.  It may be called
    anywhere, by a signal handler for instance.
    """

    def __init__(
        self,
        bench: Bench,
        gains: Gains | None = None,
        limits: Limits | None = None,
        *,
        control: float = CONTROL,
        complete: float = COMPLETE,
    ) -> None:
        self.bench, self.clock = bench, bench.clock
        self.gains, self.limits = gains or Gains(), limits or Limits()
        check_range("RobotWorld.control", control, *CONTROLS, "Hz", LimitError)
        check_range("RobotWorld.complete", complete, 0.0, 1.0, "", LimitError)
        self.control, self.complete = control, complete
        for one in bench.rig.fingers:
            needs = one.joints.newton_metres
            self.gains.check_bound(f"RobotWorld, {one.name}", needs, bench.max_current)
        self.measurements: Measurements | None = None
        self.origin = 0.0
        self._running = -1  # the count of stops of the bench at the last start
        self._last_tick: float | None = None
        self._seen: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self._keeper: threading.Thread | None = None
        self._leave, self._failed = threading.Event(), None

    def __enter__(self) -> RobotWorld:
        return self

    def __exit__(self, *exception) -> None:
        self.stop()

    def execute(self, trajectory) -> Measurements:
        """Move along a trajectory and back, and return the measurements at 30 Hz.

        trajectory: has `time` (n,) [s], of which only differences are used, and
        `finger_position` (n, F, 3) [m], followed smoothly (PCHIP).  A finger whose
        positions are constant stays parked where it is; its samples are not valid.

        The motion to the start (paths.py) is not recorded.  Raises LimitError before
        anything moves, other HardwareErrors afterwards, or where it had been stopped.
        """
        stops = self.bench.stops if self._running < 0 else self._running
        try:
            plan, duration = self._planned(trajectory)
            self._end_keeping()
            self._start(stops)
            here, parked = self._here(), np.array([path is None for path in plan])
            paths = [h if p is None else p for p, h in zip(plan, here, strict=True)]
            self._approach([path[0] for path in paths])
            self.bench.remember()
            begin = self._follow(paths, duration)
            here = [finger.angles for finger in self.bench.fingers]
            self._follow(list(map(way_back, paths, here)), duration)
            samples = self.bench.taken()
            if isinstance(self.clock, HostClock):
                self._keep()  # before the rest, which takes longer than a time-out
            data = self._assembled(samples, begin, begin + duration, parked)
            past = self.measurements
            self.measurements = data if past is None else past.append(data)
        except BaseException:
            self.stop()
            raise
        return data

    def check(self, trajectory) -> None:
        """Raise LimitError or ReachError as `execute` would; move nothing."""
        self._planned(trajectory)

    @property
    def finger_radius(self) -> np.ndarray:
        """The radii (F,) [m] of the fingertips."""
        geometries = [one.geometry for one in self.bench.rig.fingers]
        return np.array([geometry.tip_radius for geometry in geometries])

    def start(self) -> None:
        """Enable the motors, and wait until the sensors have found their zero.

        `execute` does so the first time.  No current flows yet.  Raises HardwareError.
        """
        try:
            if self._running not in (-1, self.bench.stops):
                self.stop()  # what was stopped has ended before it starts again
            self._start(self.bench.stops)
        except BaseException:
            self.stop()
            raise

    def stop(self) -> None:
        """Command zero current on all boards and disable them; logs all errors."""
        self.bench.stop()
        self._leave.set()
        keeper, self._keeper = self._keeper, None
        if keeper not in (None, threading.current_thread()):
            keeper.join(LAST)
            self.bench.stop()  # after its last command
        self._last_tick = None

    def _start(self, stops: int) -> None:
        """Start unless done; a stop since the bench had counted so many ends it."""
        if self._running != stops:
            self._running = stops  # from now on a stop stays in force
            self.bench.learn_zeros()
            self.bench.check_running(stops)
            self.bench.start(RECEIVE_TIMEOUT)
            self._last_tick = self._failed = None
            self._seen.clear()
            if self.measurements is None:
                self.origin = self.clock.now()
        self.bench.catch_up(stops)

    def _keep(self) -> None:
        """Hold the fingers where they are, in a thread."""
        leave = self._leave = threading.Event()  # never cleared: a stop stays a stop

        def run() -> None:
            try:
                here = self._here()
                while not leave.is_set():
                    self._follow(here, KEEP)
            except BaseException as bad:
                if self._running == self.bench.stops:  # not stopped from elsewhere
                    self._failed = bad
                self.bench.stop()

        keeper = threading.Thread(target=run, name="keeper", daemon=True)
        keeper.start()
        self._keeper = keeper

    def _end_keeping(self) -> None:
        """End that thread; raises the error that ended it."""
        self._leave.set()
        keeper, self._keeper = self._keeper, None  # another thread may stop meanwhile
        if keeper is not None:
            keeper.join()
        if self._failed is not None:
            failed, self._failed = self._failed, None
            raise failed

    def _planned(self, trajectory) -> tuple[list[np.ndarray | None], float]:
        """Return joint paths (n, 3) [rad] at the control rate, and the duration [s].

        None stands for the path of a parked finger.
        """
        fingers = self.bench.fingers
        limits, control = self.limits, self.control
        tips, duration = tip_paths(trajectory, len(fingers), limits.longest, control)
        paths: list[np.ndarray | None] = []
        for finger, path in zip(fingers, tips, strict=True):
            angles = None if path is None else finger.geometry.inverse(path)
            if angles is not None:
                self._check(finger, angles, duration / (len(path) - 1))
            paths.append(angles)
        return paths, duration

    def _approach(self, goals: list[np.ndarray]) -> None:
        """Move to joint angles, slowly, and settle there."""
        here = [finger.angles for finger in self.bench.fingers]
        far = max(abs(g - h).max() for g, h in zip(goals, here, strict=True))
        duration = PEAK * far / self.limits.approach
        steps = max(round(duration * self.control), 2)
        paths = []
        for finger, start, goal in zip(self.bench.fingers, here, goals, strict=True):
            path = way_there(finger.geometry, start, goal, steps)
            if far > THERE and not np.array_equal(start, goal):
                begun = finger.position[2] - finger.geometry.tip_radius
                self._check(finger, path[1:], duration / steps, begun)
            paths.append(path)
        self._follow(paths, duration if far > THERE else 0.0)
        self._follow([goal[None].repeat(2, axis=0) for goal in goals], SETTLE)

    def _check(self, finger: FingerBench, angles: np.ndarray, *path: float) -> None:
        self.limits.check_path(finger.rig.name, finger.geometry, angles, *path)

    def _follow(self, paths: list[np.ndarray], duration: float) -> float:
        """Track joint paths (n, 3), spread over a duration [s]; return its start."""
        begin = now = self.clock.now()
        speeds = [np.gradient(path, axis=0) * (len(path) - 1) for path in paths]
        step = 0
        while now < begin + duration:
            self.bench.check_running(self._running)
            share = min(max((now - begin) / duration, 0.0), 1.0)
            for finger, path, speed in zip(
                self.bench.fingers, paths, speeds, strict=True
            ):
                row = share * (len(path) - 1)
                self._drive(finger, row_of(path, row), row_of(speed, row) / duration)
            step += 1
            due = begin + step / self.control - self.clock.now()
            self.clock.sleep(min(due, 1 / self.control))
            self.bench.poll()
            self.bench.check(STALE, TOUCH_STALE)
            now = self.clock.now()
            self._watch(now)
        return begin

    def _drive(
        self, finger: FingerBench, target: np.ndarray, velocity: np.ndarray
    ) -> None:
        angles, speed = finger.angles, finger.velocities
        name, geometry = finger.rig.name, finger.geometry
        self.limits.check_state(name, geometry, angles, speed)
        stamps, (before, place) = finger.stamps, self._seen.get(name, (None, None))
        if before is not None:
            self.limits.check_jump(name, angles - place, float((stamps - before).max()))
        self._seen[name] = stamps, angles
        self.limits.check_target(name, geometry, target, velocity)
        state = angles, speed, finger.rig.robot
        finger.apply(self.gains.torques(target, velocity, *state))

    def _watch(self, now: float) -> None:
        """Raise HardwareError if the time since the last command is too long."""
        last, self._last_tick = self._last_tick, now
        if last is not None and not now >= last:
            raise ClockError(
                "the clock of the control loop ran backward",
                where="RobotWorld",
                got=f"a step of {now - last:g} s",
                expected="a clock that never steps, such as HostClock",
            )
        if last is not None and now - last > HELD_UP:
            raise HardwareError(
                "the control loop was held up",
                where="RobotWorld",
                got=f"{now - last:.3f} s",
                expected=f"a command every {1 / self.control:.3f} s",
                next="solve in other processes (executor=): they share no lock",
            )

    def _here(self) -> list[np.ndarray]:
        return [finger.angles[None].repeat(2, axis=0) for finger in self.bench.fingers]

    def _assembled(
        self, samples: list[Callable], begin: float, end: float, parked: np.ndarray
    ) -> Measurements:
        streams = [made() for made in samples]
        names = [one.name for one in streams]
        past = self.measurements
        return assemble(
            streams,
            origin=self.origin,
            start=begin,
            end=end,
            action=0 if past is None else int(past.action[-1]) + 1,
            parked=[name for name, still in zip(names, parked, strict=True) if still],
            complete=self.complete,
            nearest=True,  # the action is over
        )
