"""Between a start and an action nobody reads: the action begins from what is now."""

import numpy as np
import pytest
from bench_board import driven
from bench_robot import FREE, Setup, stop_a_board

from hardware.can_bus import POLL_LIMIT
from hardware.errors import HardwareError, StaleStreamError
from hardware.impedance import Limits
from hardware.motor_can import Pair, Quantity, encode


def move_by_hand(robot, turn):
    """Turn the second joint of finger 0 by an angle [rad] while no current flows."""
    moved = robot.fingers[0].geometry.inverse(robot._tips[0]) + np.array([0, turn, 0])
    robot._tips[0] = robot.fingers[0].geometry.forward(moved)
    robot._plant.place(robot._tips)


def test_a_finger_that_was_moved_after_a_start_approaches_from_where_it_is():
    with Setup() as setup:
        setup.world.start()
        setup.robot.sleep(0.05)
        move_by_hand(setup.robot, 0.35)
        speeds, talk = [], setup.robot._talk

        def look(now):
            talk(now)
            moved = setup.robot._inverse[0] @ setup.robot._velocity[0]
            speeds.append(abs(moved).max())

        setup.robot._talk = look
        setup.after(0.1, setup.world.stop)
        with pytest.raises(HardwareError, match="was stopped"):
            setup.world.execute(FREE)
        assert max(speeds) < 1.2 * Limits().approach


def test_what_waited_is_read_before_an_action_however_much_it_is():
    with Setup() as setup:
        setup.world.start()
        board = setup.robot.fingers[0].boards[0]
        old = encode(Pair(Quantity.POSITION, (9.0, 9.0)), setup.robot.wall())
        for _ in range(2 * POLL_LIMIT):
            board.send(old)
        setup.robot.sleep(0.02)
        setup.bench.catch_up(setup.bench.stops)
        assert abs(setup.bench.boards[0].newest(Quantity.POSITION)).max() < 5.0
        assert setup.bench.fingers[0].stamps.min() > old.timestamp


def test_a_board_that_fell_silent_in_a_pause_is_found_before_a_current_flows():
    with Setup() as setup:
        setup.world.start()
        stop_a_board(setup)
        setup.robot.sleep(0.05)
        with pytest.raises(StaleStreamError, match="finger 1, board 0: no position"):
            setup.world.execute(FREE)
        assert not np.any([pair for board in setup.references() for pair in board])


def test_a_frame_that_waited_is_as_old_as_its_stamp():
    with driven() as wired:
        wired.firmware.sending = {Quantity.POSITION}
        wired.clock.sleep(0.01)
        wired.firmware.sending = set()
        wired.clock.sleep(0.2)
        assert wired.board.poll() > 5
        with pytest.raises(StaleStreamError, match=r"silence for 0\.2"):
            wired.board.check()
