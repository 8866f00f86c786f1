"""The action space and the information of a sample, by hand and by counting."""

import casadi as ca
import numpy as np
import pytest

from formulations import exploration
from formulations.shape import CUBOID
from tactilenlp import Workspace
from tactilenlp.errors import OptionError
from tactilenlp.exploration import push_model as predict

SIZES = ca.DM([0.05, 0.04, 0.03])  # [m]
RHO = 0.01  # [m]


def test_two_directions_computed_by_hand():
    # +X finger, a quarter turn about +Z less 30 deg, then 30 deg up: by hand.
    a, b = np.radians([60, 30])
    expected = [np.sqrt(3) / 4, 3 / 4, 1 / 2]
    assert np.allclose(exploration.direction(0, a, b).full()[:, 0], expected)
    # -X finger, -45 deg about +Z brings -X towards +Y; 45 deg up.
    a, b = np.radians([-45, 45])
    expected = [-1 / 2, 1 / 2, 1 / np.sqrt(2)]
    assert np.allclose(exploration.direction(np.pi, a, b).full()[:, 0], expected)


def test_an_action_starts_on_the_sphere_and_points_at_the_target():
    space, target = Workspace(), np.array([0.01, -0.02, 0.025])
    action = space.action(np.radians([20, 40, -30, 10]))
    way = action.trajectory(target)
    start = way.finger_position[0] - target
    assert np.allclose(np.linalg.norm(start, axis=1), space.radius)
    assert np.allclose(start / space.radius, action.directions)
    assert way.time[-1] == pytest.approx(1.0)
    # far from the other finger and from the ground the way is straight
    early = way.finger_position[:40] - target
    off = np.cross(early, action.directions[None])
    assert np.abs(off).max() < 1e-12


@pytest.mark.parametrize("fingers", [2, 3])
def test_fingers_keep_their_gap_and_stay_above_the_ground(fingers):
    space, rng = Workspace(fingers=fingers), np.random.default_rng(0)
    for _ in range(50):
        p = space.random(rng).trajectory([0, 0, 0.02]).finger_position
        apart = np.linalg.norm(p[:, :, None] - p[:, None], axis=3)
        apart = apart[:, ~np.eye(fingers, dtype=bool)]
        assert apart.min() >= 2 * space.finger_radius + space.gap - 1e-12
        assert p[..., 2].min() >= space.finger_radius + space.clearance - 1e-12


def test_two_fingers_stay_in_their_half_spaces_one_goes_anywhere():
    space, rng = Workspace(), np.random.default_rng(1)
    p = space.random(rng).trajectory(np.zeros(3)).finger_position
    assert (p[:, 0, 0] > 0).all()
    assert (p[:, 1, 0] < 0).all()
    alone = Workspace(fingers=1)
    behind = alone.action([np.pi, 0.2]).trajectory([0, 0, 0.03]).finger_position
    assert behind[0, 0, 0] < -0.09
    assert np.allclose(behind[-1, 0], [0, 0, 0.03])


def test_presets_have_the_bounds_of_the_paper():
    assert np.allclose(Workspace.robot().upper, np.pi / 4)
    assert np.allclose(Workspace.simulation().upper, 2 * np.pi / 5)


def test_a_parked_finger_does_not_move():
    action = Workspace().action([0.1, 0.2, 0.3, 0.4], active=(True, False))
    p = action.trajectory([0, 0, 0.02]).finger_position
    assert np.ptp(p[:, 1], axis=0).max() == 0
    assert np.ptp(p[:, 0], axis=0).max() > 0.05


def test_the_action_space_lies_on_the_ground_wherever_that_is():
    from tactilenlp import Ground

    angles, high = [0.3, 0.2, 0.1, 0.5], Ground(height=0.1)
    level = Workspace().action(angles).trajectory([0, 0, 0.02]).finger_position
    lifted = Workspace(ground=high).action(angles).trajectory([0, 0, 0.12])
    assert np.allclose(lifted.finger_position, level + np.r_[0, 0, 0.1])
    tilt = Ground(normal=(0.0, np.sin(0.2), np.cos(0.2)))
    tilted = Workspace(ground=tilt).action(angles)
    target = tilt.from_ground(np.array([0, 0, 0.02]))
    assert np.allclose(tilt.to_ground(tilted.trajectory(target).finger_position), level)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"bound": 2.0}, "bound.*pi / 2"),
        ({"fingers": 0}, "fingers.*integer"),
        ({"radius": -1.0}, "radius.*above 0"),
        ({"radius": 0.01}, "radius.*above 0.0125"),
    ],
)
def test_a_workspace_that_cannot_be_says_what_is_wrong(given, words):
    with pytest.raises(OptionError, match=words):
        Workspace(**given)


def test_angles_out_of_bounds_are_refused_rounding_is_not():
    space = Workspace()
    with pytest.raises(OptionError, match="4 angles"):
        space.action([2.0, 0, 0, 0])
    just = space.upper + 1e-10
    assert np.array_equal(space.action(just).angles, space.upper)


def test_expected_information_is_the_mean_over_simulated_booleans_and_normals():
    """Of 400 000 draws, the mean squared score of eq:bool and eq:norm."""
    rng, alpha, sigma_n, phi = np.random.default_rng(0), 1500.0, 0.1, 0.4e-3
    J_phi, J_n = np.array([[1.0, -0.5]]), rng.normal(size=(3, 2)) * 30
    p = float(exploration.probability(phi, alpha))
    slopes = ca.DM(J_phi), ca.DM(J_n)
    F = exploration.sample_information(p, phi, *slopes, alpha, np.inf, sigma_n).full()
    c = rng.random(400_000) < p
    # d/d omega of -log p(c) is alpha (c - p) J_phi; of the normal, J_n' e / sigma^2
    score = alpha * (c - p)[:, None] * J_phi
    score = score + c[:, None] * rng.normal(size=(len(c), 3)) @ J_n / sigma_n
    counted = score.T @ score / len(c)
    # 400 000 draws know a second moment to 0.3 %, taken four times
    assert np.allclose(counted, F, rtol=0.012, atol=0.012 * np.abs(F).max())


def test_measurements_told_one_by_one_are_a_kalman_filter_of_the_way():
    """F of the marginal distribution: J' (R + H Q H')^-1 J, computed at once."""
    rng = np.random.default_rng(2)
    h, h_s = rng.normal(size=(5, 4)), rng.normal(size=(5, 3))
    weights, Q = rng.uniform(0.5, 2, 5), np.diag([0.4, 0.3, 0.2])
    slope = rng.normal(size=(3, 4))
    F, M, P = np.zeros((4, 4)), ca.DM(slope), ca.DM(Q)
    for i in range(5):
        e, M, P = exploration.measurement_update(
            M, P, ca.DM(h[i : i + 1]), ca.DM(h_s[i : i + 1]), weights[i]
        )
        F += e.full().T @ e.full()
    J = h + h_s @ slope
    S = np.diag(1 / weights) + h_s @ Q @ h_s.T
    assert np.allclose(F, J.T @ np.linalg.solve(S, J))


def pushed(start, goal, steps=40, max_force=8.0):
    """Return the way (3,) of a body that one finger pushes from start to goal."""
    goals = np.linspace(start, goal, steps + 1).T
    z = np.r_[SIZES.full()[:, 0], np.zeros(3)]
    none = np.zeros(3), np.zeros((3, 6)), np.zeros((3, 3))
    known, sensors = [0.3, 0.5, 4.905, 3125.0, max_force], [1500.0, 1e-4, 0.01]
    out = predict.push_function(CUBOID, False, 1, steps)(
        np.zeros(3), goals[:, 0], *none, z, goals[:, :-1], goals[:, 1:], RHO, known,
        sensors, 1,
    )  # fmt: skip
    return out[2].full()[:, -1]


def test_a_push_through_the_centre_moves_by_what_is_left_of_the_way():
    # touch at 35 mm, pushed to 25 mm; the spring holds mu m g / k = 0.47 mm back
    s = pushed([0.045, 0, 0.015], [0.025, 0, 0.015])
    assert s[0] == pytest.approx(-0.010 + 0.3 * 4.905 / 3125, abs=5e-5)
    assert np.abs(s[1:]).max() < 1e-6


def test_a_push_off_the_centre_turns_the_body_about_it():
    s = pushed([0.045, 0.012, 0.015], [0.025, 0.012, 0.015])
    assert s[0] < -0.004
    assert s[2] > 0.05  # pushed along -x at +y: counterclockwise
    mirrored = pushed([0.045, -0.012, 0.015], [0.025, -0.012, 0.015])
    assert np.allclose(mirrored, s * [1, -1, -1], atol=1e-6)


def test_a_finger_that_passes_by_moves_nothing():
    s = pushed([0.045, 0.05, 0.015], [-0.045, 0.05, 0.015])
    assert np.abs(s).max() < 1e-5  # the rounded onset of contact has a faint tail


def test_a_finger_weaker_than_friction_moves_nothing():
    # mu m g = 1.5 N
    s = pushed([0.045, 0, 0.015], [0.025, 0, 0.015], max_force=0.7)
    assert np.abs(s).max() < 1e-3
    assert pushed([0.045, 0, 0.015], [0.025, 0, 0.015], max_force=2.2)[0] < -5e-3


def test_a_finger_that_slides_down_a_side_presses_on_the_ground():
    # mu (m g + mu_f 1.7 N) = 1.7 N
    down = pushed([0.045, 0, 0.025], [0.025, 0, 0.005], max_force=1.7)
    up = pushed([0.045, 0, 0.005], [0.025, 0, 0.025], max_force=1.7)
    assert abs(down[0]) < 2e-3
    assert up[0] < -5e-3


@pytest.mark.parametrize(("x", "reach"), [(0.0346, 0.002), (0.0355, 0.003)])
def test_slopes_of_a_push_are_those_of_differences(x, reach):
    """One step of a finger that pushes a side, off the middle; sensors tell nothing."""
    step = predict.step_function(CUBOID, False, 1, False)
    z = np.r_[0.05, 0.04, 0.03, 0.0, 0.0, 0.2]
    p = np.array([x, 0.011, 0.015])  # it touches a side that is turned by 0.2 rad
    goal = p - [reach, 0, 0]
    none, still = np.array([0.0, np.inf, np.inf]), np.zeros(3)
    known = [0.3, 0.5, 4.9, 1000.0, 8.0]

    def moved(z, slopes=False):
        given = still, p, still, np.zeros((3, 6)), np.zeros((3, 3)), z, p, goal
        found = step(*given, [RHO], known, none, 1.0)
        return found[3].full() if slopes else found[2].full().ravel()

    h, M = 1e-7, moved(z, slopes=True)
    numeric = np.stack([(moved(z + e) - moved(z - e)) / (2 * h)
                        for e in h * np.eye(6)], axis=1)  # fmt: skip
    assert np.abs(moved(z)).max() > 1e-5
    assert pytest.approx(numeric, abs=0.03 * np.abs(numeric).max()) == M


WALL = (-np.inf, 0.03, -np.inf, np.inf, np.inf, np.inf)  # [m] beyond y = 0.03


def test_an_action_through_an_obstacle_is_refused_and_random_ones_avoid_it():
    space, target = Workspace(obstacles=[WALL]), np.array([0.0, 0.0, 0.02])
    through, past = ([a, 0.2, a, 0.2] for a in np.radians([60.0, -15.0]))
    through[2:] = past[2:]  # only the first finger comes from beyond the wall
    assert Workspace().action(through).trajectory(target).time[-1] == 1.0
    assert space.action(through).blocked(target)
    with pytest.raises(OptionError, match=r"obstacles.*avoids them"):
        space.action(through).trajectory(target)
    rng = np.random.default_rng(0)
    for _ in range(20):
        p = space.random(rng, target=target).trajectory(target).finger_position
        assert p[..., 1].max() <= 0.03 - space.finger_radius
    walled = Workspace(obstacles=[(-1, -1, -1, 1, 1, 1)])
    with pytest.raises(OptionError, match="obstacles"):
        walled.random(rng, target=target)


@pytest.mark.parametrize(
    "wrong", [(0, 0, 0, 1, 1, 1), [(0, 0, 0, 1, 1)], [(1, 0, 0, 0, 1, 1)], "wall"]
)
def test_obstacles_that_are_no_boxes_are_refused(wrong):
    with pytest.raises(OptionError, match=r"obstacles.*lower corner first"):
        Workspace(obstacles=wrong)
