"""A wall clock that is set while the simulated robot moves, and what is checked."""

from dataclasses import replace
from itertools import chain

import numpy as np
from bench import wait_for
from bench_robot import FREE, Setup, numbers, trajectory

from hardware.clock import HostClock
from hardware.errors import HardwareError
from hardware.simulated_robot import NOON, simulated_rig

PHASES = ("start", "zero", "approach", "settle", "path", "way back", "kept up")
SMALLEST, LARGEST = 5e-3, 3600.0  # [s] of a step
FAR = trajectory(  # 3 cm from where the fingers are: there is an approach
    [(0.12, 0.02, 0.07), (0.1, 0.0, 0.06)],
    [(-0.12, 0.02, 0.07), (-0.1, 0.0, 0.06)],
    duration=0.2,
)


class HostTime:
    """The module `time` of a computer on which a simulated robot makes time pass."""

    def __init__(self, robot):
        self.robot = robot

    def time(self):
        return self.robot.wall()

    def monotonic(self):
        return self.robot.now() - NOON

    def sleep(self, duration):
        self.robot.sleep(duration)


class Jumping(Setup):
    """A bench by the clock of the host, whose wall clock is set during an action."""

    def __init__(self, monkeypatch):
        super().__init__(rig=slow_to_find_zero())
        monkeypatch.setattr("hardware.clock.time", HostTime(self.robot))
        self.bench.clock = self.world.clock = HostClock()
        self.begun, self._moments = {}, []
        self._watch_phases()

    def look(self, now):
        super().look(now)
        if self._moments:
            phase, delay, step = self._moments[0]
            if now - self.begun.get(phase, np.inf) >= delay:
                self.robot.wall_step += step
                self._moments.pop(0)

    def step_at(self, phase, delay, step):
        """Set the wall clock by a step [s], so long [s] after a phase began."""
        self._moments.append((phase, delay, step))

    def stepped(self):
        """Return whether all steps were made."""
        return not self._moments

    def _watch_phases(self):
        """Note when each phase begins: by what the world calls."""
        world, follow, approach = self.world, self.world._follow, self.world._approach
        begin, names = self._begin, iter(())

        def watched_follow(*given):
            begin(next(names, None))
            return follow(*given)

        def watched_approach(*given):
            nonlocal names
            names = iter(PHASES[2:])
            return approach(*given)

        def watched_learn():
            begin("zero")
            return learn()

        begin("start")
        learn, self.bench.learn_zeros = self.bench.learn_zeros, watched_learn
        world._follow, world._approach = watched_follow, watched_approach

    def _begin(self, phase):
        if phase is not None:
            self.begun.setdefault(phase, self.robot.now())


def slow_to_find_zero():
    """A rig whose sensors take a quarter of a second to find their zero."""
    rig = simulated_rig("optoforce_can", f"jumps {next(numbers)}")
    fingers = []
    for one in rig.fingers:
        tactile = replace(one.tactile, touch=one.tactile.touch | {"rest": 25})
        fingers.append(replace(one, tactile=tactile))
    return replace(rig, fingers=tuple(fingers))


def run_trial(monkeypatch, phase, delay, step, first=FREE):
    """Step the wall clock once; return what was measured, or the typed error.

    Checks that no command and no motion goes beyond the limits, and that all motors
    have no current in the end.
    """
    with Jumping(monkeypatch) as setup:
        setup.step_at(phase, delay, step)
        try:
            result = setup.world.execute(first)
            if phase == "kept up":
                waited = setup.robot.now() + delay + 0.3
                wait_for(lambda: setup.robot.now() > waited or setup.world._failed)
                result = setup.world.execute(FREE)
        except HardwareError as bad:
            result = bad
        setup.world.stop()
        assert setup.left_in_peace()
        said = list(chain(*setup.references()))
    assert setup.stepped(), phase
    bound = setup.world.gains.torque / setup.rig.fingers[0].joints.newton_metres
    assert np.isfinite(said).all()
    assert np.abs(said).max() <= bound + 1e-6
    return setup, result
