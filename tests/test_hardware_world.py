"""The robot's world: what it measures, what it refuses, how it waits."""

from types import SimpleNamespace

import numpy as np
import pytest
from bench import wait_for
from bench_robot import (
    AWAY,
    BEYOND,
    BOX,
    FREE,
    PUSH,
    SQUEEZE,
    Patient,
    Setup,
    poised,
    stop_a_board,
    trajectory,
)

from hardware import world
from hardware.assemble import assemble
from hardware.errors import (
    LimitError,
    ReachError,
    StaleStreamError,
)
from hardware.kinematics import finger
from hardware.simulated_robot import NOON
from hardware.streams import CONTACT
from tactilenlp import Workspace, explore
from tactilenlp.exploration.sweep import check_reach


@pytest.fixture(scope="module")
def session():
    """Two actions with rendered pictures; the truth along the way."""
    with Setup("densetact", angles=poised(PUSH)) as setup:
        data = [setup.world.execute(action) for action in (PUSH, SQUEEZE)]
        now = [setup.robot.now(), setup.robot.pose]
    return setup, data, now


# What is measured


def test_the_end_of_a_with_block_leaves_no_current():
    with Setup() as setup:
        with setup.world as world:
            world.start()  # finds the zeros first, and commands no current yet
            world._follow(world._here(), 0.1)
            assert any(board.reference.any() for board in setup.boards)
        assert setup.left_in_peace()


@pytest.mark.slow
def test_an_action_comes_back_at_30_hz_and_the_next_one_goes_on(session):
    setup, (first, second), _ = session
    assert 22 <= first.samples <= 23
    assert first.dt == pytest.approx(1 / 30)
    assert (first.action[0], second.action[0]) == (0, 1)
    assert second.time[0] > first.time[-1]
    assert setup.world.measurements == first.append(second)


@pytest.mark.slow
def test_the_measured_tips_are_where_the_simulated_ones_were(session):
    setup, data, _ = session
    times = np.array([now for now, _ in setup.trace])
    truth = np.array([tips for _, tips in setup.trace])
    origin = setup.world.origin
    for one in data:
        true = [
            np.interp(origin + one.time, times, truth[:, k, i])
            for k in range(2)
            for i in range(3)
        ]
        off = np.array(true).T.reshape(-1, 2, 3) - one.finger_position
        assert np.abs(off[one.valid]).max() < 2e-5  # straight lines between 2 ms


@pytest.mark.slow
def test_a_parked_finger_stays_and_is_not_valid(session):
    _, (first, _), _ = session
    assert not first.valid[:, 1].any()
    assert first.valid[:, 0].all()
    assert np.ptp(first.finger_position[:, 1], axis=0).max() < 1e-3


@pytest.mark.slow
def test_pictures_of_a_push_give_contact_and_the_faces_normal(session):
    _, (first, second), _ = session
    assert 3 < first.contact[:, 0].sum() < 20
    # once felt, it is felt until the end
    begin = np.flatnonzero(first.contact[:, 0])[0]
    assert first.contact[begin:, 0].all()
    for data, k, face in ((first, 0, 1.0), (second, 0, 1.0), (second, 1, -1.0)):
        touched = data.normal[data.contact[:, k], k]
        assert len(touched) >= 3
        assert np.degrees(np.arccos(face * touched[:, 0])).max() < 8.0
    # the tip was its radius and half the box away when the first touch was felt
    gap = first.finger_position[begin, 0, 0] - 0.01575 - BOX[0] / 2
    assert abs(gap) < 3e-3


@pytest.mark.slow
def test_an_action_has_the_touches_nearest_in_time(monkeypatch):
    came = []

    def assembled(streams, **given):
        came.append(streams)
        return assemble(streams, **given)

    monkeypatch.setattr(world, "assemble", assembled)
    with Setup("densetact", angles=poised(PUSH)) as setup:
        data = setup.world.execute(PUSH)
        touch, origin = came[0][0].touch, setup.world.origin
    row = abs(touch.time - origin - data.time[:, None]).argmin(axis=1)
    assert np.array_equal(data.contact[:, 0], touch.values[row, CONTACT] > 0)


@pytest.mark.slow
def test_the_object_moved_as_the_papers_did(session):
    _, _, (_, pose) = session
    assert 2e-3 < np.linalg.norm(pose[:2]) < 0.02


def test_a_world_tells_the_radii_of_its_fingertips():
    assert Setup().world.finger_radius.tolist() == [0.01575] * 2


def test_a_zero_error_of_one_degree_moves_the_measured_tip_by_millimetres():
    error = np.zeros((2, 3))
    error[0, 0] = np.deg2rad(1.0)
    with Setup(zero_error=error) as setup:
        data = setup.world.execute(FREE)
        tips = setup.robot.tips
    last = data.finger_position[-1]
    J = setup.rig.fingers[0].geometry
    lever = np.linalg.norm(J.jacobian(J.inverse(last[0]))[:, 0])
    ends = [p for now, p in setup.trace if now <= setup.world.origin + data.time[-1]]
    off = np.linalg.norm(ends[-1] - last, axis=1)
    assert off[0] == pytest.approx(np.deg2rad(1.0) * lever, rel=0.05)
    assert 2e-3 < off[0] < 5e-3
    assert off[1] < 2e-4  # 2 ms of motion
    assert tips.shape == (2, 3)


def test_a_run_repeats_to_the_last_digit():
    runs = []
    for _ in range(2):
        with Setup() as setup:
            runs.append(setup.world.execute(FREE))
    assert runs[0] == runs[1]


# What is refused, before anything moves


@pytest.mark.parametrize(
    ("error", "word", "line"),
    [
        (LimitError, "too fast", [(0.1, 0, 0.06), (0.0, 0.05, 0.1)]),
        (LimitError, "ground", [(0.1, 0, 0.06), (0.08, 0, 0.01)]),
        (LimitError, "leave its limits", [(0.2, 0.0, 0.1), BEYOND]),
        (ReachError, "too far", [(0.1, 0.0, 0.06), (0.5, 0.0, 0.06)]),
    ],
)
def test_what_the_robot_cannot_do_is_refused_at_rest(error, word, line):
    with Setup() as setup:
        wanted = trajectory(line, AWAY, duration=0.2 if word == "too fast" else 3.0)
        before = setup.robot.tips
        with pytest.raises(error, match=word):
            setup.world.execute(wanted)
        assert np.linalg.norm(setup.robot.tips - before, axis=1).max() < 2e-3
        assert setup.left_in_peace()


@pytest.mark.parametrize(
    "wrong",
    [
        SimpleNamespace(time=[0, 1], finger_position=np.zeros((2, 3, 3))),
        SimpleNamespace(time=[1, 0], finger_position=np.zeros((2, 2, 3))),
        SimpleNamespace(time=[0, 1], finger_position=np.full((2, 2, 3), np.nan)),
        SimpleNamespace(),
    ],
)
def test_what_is_no_trajectory_is_refused(wrong):
    with Setup() as setup, pytest.raises(LimitError, match="no trajectory"):
        setup.world.execute(wrong)


@pytest.mark.parametrize(
    ("error", "word", "space", "centre"),
    [
        (ReachError, "too far", {"radius": 0.2}, (0.0, 0.0)),
        (ReachError, "too far", {"radius": 0.2}, None),  # of the sweep
        (ReachError, "too far", {}, (0.2, 0.0)),
        (LimitError, "too fast", {"duration": 0.1}, (0.0, 0.0)),
    ],
)
def test_a_workspace_beyond_the_robot_is_refused_at_rest(error, word, space, centre):
    with Setup() as setup:
        radius = float(setup.world.finger_radius[0])
        wanted = Workspace.robot(finger_radius=radius, **space)
        before = setup.robot.now()
        with pytest.raises(error, match=word):
            next(explore(setup.world, workspace=wanted, centre=centre))
        assert setup.robot.now() == before  # no step of control
        assert not any(board.received for board in setup.boards)


def test_actions_that_are_within_reach_are_not_refused():
    with Setup() as setup:
        radius = float(setup.world.finger_radius[0])
        space = Workspace.robot(finger_radius=radius)
        check_reach(setup.world, space, (0.01, -0.01), None)
        check_reach(setup.world, space, None, None)


# Between actions


def test_fingers_are_kept_up_between_actions():
    with Setup(make=Patient) as setup:
        setup.world.execute(FREE)
        there, then = setup.robot.tips, setup.robot.now()
        wait_for(lambda: setup.robot.now() > then + 0.3)  # longer than the time-out
        assert np.abs(setup.robot.tips - there).max() < 2e-3
        stop_a_board(setup)
        wait_for(lambda: setup.world._failed is not None)
        assert setup.left_in_peace()
        with pytest.raises(StaleStreamError, match="finger 1, board 0"):
            setup.world.execute(FREE)
        setup.world.stop()


def test_stopping_ends_the_thread_too():
    with Setup(make=Patient) as setup:
        setup.world.execute(FREE)
        setup.world.stop()
        assert setup.left_in_peace()


def test_the_simulation_begins_at_noon():
    with Setup() as setup:
        assert setup.robot.now() == NOON
        assert finger("edu_dair").tip_radius == 0.01575
