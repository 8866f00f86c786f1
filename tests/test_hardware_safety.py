"""The table of hardware/README.md that says what stops the motors, when: measured."""

import re
from pathlib import Path

import can
import numpy as np
import pytest
from bench_robot import FREE, Setup, poised, stop_a_board
from test_hardware_faults import (
    close_a_bus,
    fail_a_board,
    press_ctrl_c,
    report_bus_off,
    stop_a_sensor,
)
from test_hardware_interrupted import jump
from test_hardware_zeros import FAILURE, replace_packets

from hardware.errors import HardwareError
from hardware.impedance import Limits
from hardware.motor_can import Quantity, Reference, encode

README = Path(__file__).resolve().parents[1] / "hardware" / "README.md"
ROW = re.compile(r"^\| (.+?) \| (.+?) \| \*\*(\d+) ms\*\* \|", re.M)
STATED = {what: int(ms) for what, _, ms in ROW.findall(README.read_text())}
DELAYS = 0.15, 0.2, 0.25  # [s] after the start, at which it happens: fingers move then


def freeze_a_camera(setup):
    setup.robot.fingers[1].skin.frozen = True


def run_away(setup):
    setup.world.limits = Limits(top_speed=1e-3)


def hold_up(setup):
    """Something keeps the control loop from running for 0.3 s."""
    poll = setup.bench.poll

    def late():
        setup.bench.poll = poll
        setup.robot.sleep(0.3)
        poll()

    setup.bench.poll = late


def die(setup):
    """The program sends nothing any more, not even zero currents."""
    for one in setup.bench.fingers:
        for board in one.boards:
            board.listen_only = True
    raise SystemExit


def mute_velocities(setup):
    setup.robot.fingers[0].boards[1].sending.discard(Quantity.VELOCITY)


def command_from_elsewhere(setup):
    with can.Bus(**setup.rig.fingers[0].boards[0]) as other:
        other.send(encode(Reference((0.3, -0.3))))


def switch_a_motor_off(setup):
    setup.robot.fingers[0].boards[1]._enabled = np.array([False, True])


def hang_an_adapter(setup):
    def full(message, timeout):
        raise can.CanTimeoutError("transmit buffer full")

    setup.bench.boards[1].bus.send = full


HARMS = {
    "a board falls silent": stop_a_board,
    "a force sensor falls silent": stop_a_sensor,
    "a board sends no velocities": mute_velocities,
    "a force sensor repeats one sample": lambda s: replace_packets(s, moving=False),
    "a force sensor reports a failure": lambda s: replace_packets(s, FAILURE),
    "a camera repeats one picture": freeze_a_camera,
    "a board reports a fault": fail_a_board,
    "a board reports that a motor is off, without a fault": switch_a_motor_off,
    "another program commands a board": command_from_elsewhere,
    "a CAN adapter takes no more frames": hang_an_adapter,
    "a position jumps": lambda s: jump(s, 0.1),
    "`RobotWorld.stop` is called elsewhere": lambda s: s.world.stop(),
    "the CAN controller reports bus-off": report_bus_off,
    "a CAN adapter is unplugged": close_a_bus,
    "a joint moves faster than `Limits.top_speed`": run_away,
    "Ctrl-C, or any exception": press_ctrl_c,
    "the control loop is held up": hold_up,
    "the program dies (kill -9), or the computer": die,
}


def measured(harm, delay):
    """Return the time [s] from a harm to the last current of any motor."""
    kind = "densetact" if harm is freeze_a_camera else "optoforce_can"
    with Setup(kind, angles=poised()) as setup:
        setup.world.start()
        flowing = []

        def look(now):
            if any(b.current.any() for one in setup.robot.fingers for b in one.boards):
                flowing.append(now)

        done = setup.after(delay, lambda: harm(setup))
        happens = setup.robot.after
        setup.robot.after = lambda now: (look(now), happens(now))
        with pytest.raises((HardwareError, KeyboardInterrupt, SystemExit)):
            setup.world.execute(FREE)
        setup.robot.sleep(0.3)
        assert flowing[-1] < setup.robot.now() - 0.1
    return max(flowing[-1] - done[0], 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("what", HARMS)
def test_motors_stop_as_soon_as_the_table_says(what):
    worst = max(measured(HARMS[what], delay) for delay in DELAYS)
    print(f"{what}: {1e3 * worst:.0f} ms")
    assert 1e3 * worst <= STATED[what]


def test_every_entry_of_the_table_is_measured():
    assert set(STATED) == set(HARMS)


def test_stopping_sends_zero_current_before_all_else():
    with Setup() as setup:
        setup.world.start()
        setup.after(0.1, lambda: fail_a_board(setup))
        with pytest.raises(HardwareError):
            setup.world.execute(FREE)
        for board in setup.boards:
            assert board.received[-4] == Reference((0.0, 0.0))
