"""A robot that is stopped from elsewhere stays stopped; what nobody saw before."""

import threading

import numpy as np
import pytest
from bench import wait_for
from bench_robot import FREE, Patient, Setup, poised

import hardware.world
from hardware.bench import Bench
from hardware.errors import HardwareError, LimitError
from hardware.impedance import STRONGEST, Gains
from hardware.motor_can import Command, Order, Quantity
from hardware.motor_checks import LARGEST_CURRENT
from hardware.motor_joints import JointMap
from hardware.simulated_robot import SimulatedRobot, simulated_rig
from hardware.world import RobotWorld

# Stopped from elsewhere


def test_a_stop_from_elsewhere_ends_an_action():
    with Setup() as setup:
        setup.world.start()
        done = setup.after(0.1, setup.world.stop)
        with pytest.raises(HardwareError, match="was stopped"):
            setup.world.execute(FREE)
        assert setup.robot.now() - done[0] < 0.01
        assert setup.left_in_peace()
        assert not setup.motors_enabled()
        setup.robot.after = setup.look
        with pytest.raises(HardwareError, match="was stopped"):
            setup.world.execute(FREE)  # a stop stays a stop
        assert not setup.motors_enabled()
        setup.world.start()
        assert setup.world.execute(FREE).samples > 5  # a new start is a new start


def test_a_stop_from_elsewhere_ends_the_alignment():
    with Setup() as setup:
        for board in setup.boards:
            board.alignment = 1.0
        done = setup.after(0.5, setup.world.stop)
        with pytest.raises(HardwareError, match="was stopped"):
            setup.world.start()
        assert setup.robot.now() - done[0] < 0.05
        with pytest.raises(HardwareError, match="was stopped"):
            setup.world.execute(FREE)
        assert not setup.motors_enabled()


@pytest.mark.parametrize("when", ["learn_zeros", "start"])
def test_a_stop_while_a_world_starts_leaves_no_motor_enabled(when, monkeypatch):
    """It may come before the motors are enabled, or just when all of them are."""
    with Setup() as setup:
        begin = getattr(setup.bench, when)

        def then(*given):
            begin(*given)
            setup.world.stop()

        monkeypatch.setattr(setup.bench, when, then)
        with pytest.raises(HardwareError, match="was stopped"):
            setup.world.start()
        assert not setup.motors_enabled()
        on = Order(Command.ENABLE_MOTOR_1, 1)
        heard = [on in board.received for board in setup.boards]
        assert heard == [when == "start"] * 4


def test_a_start_that_is_interrupted_leaves_no_motor_enabled(monkeypatch):
    with Setup() as setup:
        start, poll = setup.bench.start, setup.bench.poll

        def interrupt():
            raise KeyboardInterrupt

        def then(timeout):
            start(timeout)
            setup.bench.poll = interrupt

        setup.bench.start = then
        with pytest.raises(KeyboardInterrupt):
            setup.world.start()
        setup.bench.poll = poll
        assert not setup.motors_enabled()
        assert setup.left_in_peace()


def test_a_stop_of_the_bench_ends_the_thread_that_holds_the_fingers():
    with Setup(make=Patient) as setup:
        setup.world.execute(FREE)
        setup.bench.stop()
        setup.world._keeper.join(5.0)
        assert not setup.world._keeper.is_alive()
        assert not setup.motors_enabled()
        with pytest.raises(HardwareError, match="was stopped"):
            setup.world.execute(FREE)
        assert not setup.motors_enabled()


@pytest.mark.parametrize("make", [SimulatedRobot, Patient])
def test_a_stop_between_two_actions_is_not_forgotten(make):
    with Setup(make=make) as setup:
        setup.world.start()
        setup.world.stop()
        for _ in range(2):
            with pytest.raises(HardwareError, match="was stopped"):
                setup.world.execute(FREE)
            assert not setup.motors_enabled()
        setup.world.start()
        assert setup.motors_enabled()


def test_a_start_after_a_stop_leaves_one_thread_that_holds_the_fingers():
    with Setup(make=Patient) as setup:
        setup.world.execute(FREE)
        first = setup.world._keeper
        setup.bench.stop()
        setup.world.start()
        assert not first.is_alive()
        assert setup.world._keeper is None


def test_a_stop_while_the_thread_begins_is_not_lost(monkeypatch):
    """The stop comes when the thread is made, before it runs."""
    with Setup(make=Patient) as setup:

        def made(*given, **options):
            setup.world.stop()
            return threading.Thread(*given, **options)

        fake = type("Threads", (), vars(threading) | {"Thread": staticmethod(made)})
        monkeypatch.setattr(hardware.world, "threading", fake)
        setup.world.execute(FREE)
        setup.world._keeper.join(5.0)
        assert not setup.world._keeper.is_alive()
        assert not setup.motors_enabled()


def test_fingers_are_held_while_measurements_are_assembled(monkeypatch):
    with Setup(make=Patient) as setup:
        assembled = setup.world._assembled
        monkeypatch.setattr(setup.world, "_assembled", lambda *given: slowly(*given))

        def slowly(*given):
            begin = setup.robot.now()
            wait_for(lambda: setup.robot.now() > begin + 0.3)  # three time-outs
            return assembled(*given)

        first = setup.world.execute(FREE)
        assert setup.world._failed is None
        assert first.valid.all()
        assert setup.world.execute(FREE).valid.all()
        setup.world.stop()


# Jumps and silence


def jump(setup, turns):
    """Add motor turns to joint 0 of finger 0, within one step of the wires."""
    board = setup.robot.fingers[0].boards[1]
    talk = board.talk

    def jumped(measured, now, stamp=None):
        place = np.add(measured[Quantity.POSITION], [turns, 0.0])
        talk(measured | {Quantity.POSITION: place}, now, stamp)

    board.talk = jumped


def test_a_position_that_jumps_is_refused():
    with Setup(angles=poised()) as setup:
        setup.world.start()
        done = setup.after(0.15, lambda: jump(setup, 0.1))  # 4 degrees of the joint
        with pytest.raises(LimitError, match="finger 0: a joint jumps"):
            setup.world.execute(FREE)
        assert setup.robot.now() - done[0] < 0.01
        assert setup.left_in_peace()


def test_positions_that_come_late_are_no_jump():
    with Setup(angles=poised()) as setup:
        setup.world.start()

        def pause():
            for board in setup.robot.fingers[0].boards:
                board.silent = not board.silent

        setup.after(0.15, pause)
        first = setup.robot.after

        def look(now):
            first(now)
            board = setup.robot.fingers[0].boards[0]
            look.since = look.since if board.silent else now
            if now - look.since > 0.06:
                pause()

        look.since = setup.robot.now()
        setup.robot.after = look
        setup.world.complete = 0.3
        assert setup.world.execute(FREE).samples > 5


def test_an_action_ends_where_velocities_are_not_heard():
    with Setup(angles=poised()) as setup:
        setup.world.start()

        def mute():
            setup.robot.fingers[0].boards[1].sending.discard(Quantity.VELOCITY)

        done = setup.after(0.1, mute)
        with pytest.raises(HardwareError, match="no velocity is heard"):
            setup.world.execute(FREE)
        assert setup.robot.now() - done[0] < 0.11


# Torques and currents


def test_torques_beyond_the_bound_of_currents_are_refused_at_construction():
    bench = Bench(simulated_rig("optoforce_can"), max_current=0.3)
    with pytest.raises(LimitError, match=r"gains\.torque.*0\.18 N m/A") as refused:
        RobotWorld(bench)
    assert "max_current = 0.3 A" in str(refused.value)
    RobotWorld(bench, Gains(torque=0.3 * 0.18))


def test_the_strongest_torque_is_that_of_the_largest_current():
    assert pytest.approx(JointMap().newton_metres * LARGEST_CURRENT) == STRONGEST
    with pytest.raises(LimitError):
        Gains(torque=0.4)
