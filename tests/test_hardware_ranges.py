"""Every number that guards or reaches a motor is finite and in range."""

from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest
from bench_board import driven
from bench_robot import FREE, Setup, poised

from hardware.bench import Bench
from hardware.errors import HardwareError, LimitError, RigError, StaleStreamError
from hardware.impedance import Gains, Limits
from hardware.kinematics import finger
from hardware.motor_joints import JointMap, start_motors
from hardware.ranges import check_ranges, rotation
from hardware.rig import Tactile
from hardware.simulated_robot import simulated_rig
from hardware.world import RobotWorld

NO_NUMBERS = [np.nan, np.inf, -np.inf, "1", None, True, [1.0], 1e300]
FINGER = finger("edu_dair")
HERE = np.array([0.0, 0.9, -1.7])


@pytest.mark.parametrize("wrong", [*NO_NUMBERS, -1.0])
def test_limits_and_gains_are_finite_numbers_in_range(wrong):
    for name in (f.name for f in fields(Limits)):
        with pytest.raises(LimitError, match=f"Limits.{name}: out of range"):
            Limits(**{name: wrong})
    for name in ("torque", "weight"):
        with pytest.raises(LimitError, match=f"^Gains.{name}: out of range"):
            Gains(**{name: wrong})
    for name in ("stiffness", "damping"):
        with pytest.raises(LimitError, match=f"^Gains.{name}"):
            Gains(**{name: (1.0, wrong, 1.0)})
        with pytest.raises(LimitError, match=f"^Gains.{name}"):
            Gains(**{name: wrong})


@pytest.mark.parametrize("wrong", [*NO_NUMBERS, -1.0])
def test_bounds_of_currents_and_time_outs_are_finite_numbers_in_range(wrong):
    with pytest.raises(LimitError, match="max_current: out of range"):
        Bench(simulated_rig("optoforce_can"), max_current=wrong)
    with driven() as wired:
        for action in (wired.board.start, wired.board.watch):
            with pytest.raises(LimitError, match="time-out"):
                action(wrong)
        with pytest.raises(LimitError, match="time-out"):
            wired.board.watch(1e-4)  # would round to 0 ms: never
        with pytest.raises(LimitError, match="patience"):
            start_motors([wired.board], wired.clock, patience=wrong)
        wired.firmware.listen(wired.clock.now())
        assert wired.firmware.received == []
    bench = Setup().bench
    with pytest.raises(LimitError, match=r"RobotWorld.control"):
        RobotWorld(bench, control=wrong)
    with pytest.raises(LimitError, match=r"RobotWorld.complete"):
        RobotWorld(bench, complete=wrong)


@pytest.mark.parametrize("wrong", [*NO_NUMBERS, -1e3])
def test_numbers_of_a_robot_are_finite_and_in_range(wrong):
    for name in ("height", "link", "tip_radius", "angle"):
        with pytest.raises(RigError, match=f"{name}: out of range"):
            replace(FINGER, **{name: wrong})
    with pytest.raises(RigError, match="lower"):
        replace(FINGER, lower=(0.0, wrong, 0.0))
    with pytest.raises(RigError, match="zero"):
        JointMap(zero=(wrong, 0.0, 0.0))
    for name in ("gear", "torque_constant"):
        with pytest.raises(RigError, match=f"{name}: out of range"):
            JointMap(**{name: wrong})
    with pytest.raises(RigError, match="latency"):
        Tactile("anyskin", latency=wrong)
    one = simulated_rig("optoforce_can").fingers[0]
    with pytest.raises(RigError, match="degrees"):
        replace(one, degrees=wrong).geometry.forward(HERE)
    if wrong is not None:  # that of the robot
        with pytest.raises(RigError, match="tip_radius"):
            replace(one, tip_radius=wrong).geometry.forward(HERE)


def test_limits_of_joints_are_in_order():
    with pytest.raises(RigError, match="lower below upper"):
        replace(FINGER, lower=FINGER.upper, upper=FINGER.lower)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_a_state_that_is_not_finite_is_refused(wrong):
    bad, still = HERE.copy(), np.zeros(3)
    bad[1] = wrong
    for check in (Limits().check_state, Limits().check_target):
        check("finger", FINGER, HERE, still)
        with pytest.raises(LimitError, match="limits"):
            check("finger", FINGER, bad, still)
        with pytest.raises(LimitError, match=r"runs away|too fast"):
            check("finger", FINGER, HERE, np.array([0.0, wrong, 0.0]))
    with pytest.raises(LimitError, match="limits"):
        Limits().check_path("finger", FINGER, np.array([HERE, bad]), 0.01)
    with pytest.raises(LimitError, match="sample interval"):
        Limits().check_path("finger", FINGER, np.array([HERE, HERE]), wrong)
    for k in range(4):
        given = [HERE, still, HERE, still]
        given[k] = bad
        with pytest.raises(LimitError, match="no torque"):
            Gains().torques(*given)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf, 0.5, -0.5])
@pytest.mark.parametrize("joint", range(3))
def test_a_wrong_torque_reaches_no_board_of_the_finger(wrong, joint):
    with Setup() as setup:
        torques = np.zeros(3)
        torques[joint] = wrong  # [N m]: 0.5 is 2.8 A
        with pytest.raises(LimitError, match="too much current"):
            setup.bench.fingers[0].apply(torques)
        assert not any(board.received for board in setup.boards)


@pytest.mark.parametrize("current", ["1", None, True, 1j, [0.0]])
def test_a_current_that_is_no_number_is_refused(current):
    with driven() as wired, pytest.raises(LimitError, match="too much current"):
        wired.board.command(0.0, current)


def test_an_age_limit_that_is_no_number_does_not_switch_the_watchdog_off():
    with Setup() as setup:
        setup.robot.sleep(0.01)
        setup.bench.poll()
        with pytest.raises(StaleStreamError):
            setup.bench.check(stale=np.nan)
        with pytest.raises(StaleStreamError):
            setup.bench.fingers[0].skin.check(np.nan)


TRAJECTORIES = [
    SimpleNamespace(time=FREE.time * 1e3, finger_position=FREE.finger_position),
    SimpleNamespace(time=[-1e308, 1e308], finger_position=np.zeros((2, 2, 3))),
    SimpleNamespace(time=[0.0, np.nan], finger_position=np.zeros((2, 2, 3))),
    SimpleNamespace(time=[0.0, 1.0], finger_position=np.full((2, 2, 3), 1e300)),
    SimpleNamespace(time=["a", "b"], finger_position="c"),
    SimpleNamespace(time=[0.0, 1.0], finger_position=[[1.0], [1.0, 2.0]]),
]


@pytest.mark.parametrize("wrong", TRAJECTORIES)
def test_a_wrong_trajectory_is_refused_before_a_motor_is_enabled(wrong):
    with Setup() as setup:
        with pytest.raises(LimitError, match=r"too long|no trajectory"):
            setup.world.execute(wrong)
        assert not setup.motors_enabled()


def test_commands_are_in_range_though_someone_else_s_path_is_not():
    with Setup(angles=poised()) as setup:
        setup.world.start()
        far = [np.repeat(np.array([[0.0, 0.9, 9.0]]), 2, axis=0)] * 2
        with pytest.raises(HardwareError, match="beyond the limits"):
            setup.world._follow(far, 0.1)
        setup.world.stop()
        for said in setup.references():
            assert np.isfinite(said).all()


@pytest.mark.parametrize("wrong", [*NO_NUMBERS, False, 1.1])
def test_a_wrong_entry_of_a_rotation_is_named(wrong):
    with pytest.raises(RigError, match=r"mount\[0\]\[1\]: out of range"):
        rotation("mount", [[1.0, wrong, 0.0], [0, 1, 0], [0, 0, 1]], RigError)


@pytest.mark.parametrize("wrong", [None, 1.0, np.array(1.0), [], -np.eye(3)])
def test_what_is_no_rotation_is_refused(wrong):
    with pytest.raises(RigError, match="mount: no "):
        rotation("mount", wrong, RigError)


def test_a_single_number_in_an_array_is_no_pair():
    with pytest.raises(LimitError, match="wrong shape"):
        check_ranges("pair", np.array(3.0), 2, -1, 1, "m")
