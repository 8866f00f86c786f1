"""Where the ground carries a pushed body, and which pushes are expected to tip it."""

from dataclasses import replace

import numpy as np
import pytest
from believed import SPACE, VAGUELY, actions, believed, informed, known
from conftest import benchmark
from scipy.spatial.transform import Rotation

from formulations.shape import CUBOID, cuboid_mesh
from tactilenlp import ExpectedInformation
from tactilenlp.geometry.support import Standing, settling
from tactilenlp.tracking.standing import standing_of

SIDES = np.array([0.06, 0.04, 0.03])
CORNERS = np.array(cuboid_mesh(SIDES)) + np.diag(SIDES)[2] / 2
CENTRE, WEIGHT = np.array([0.0, 0.0, SIDES[2] / 2]), 5.0
TALL = believed([0.03, 0.03, 0.09], [0.0, 0.0, 0.0], VAGUELY)
pushes = benchmark("predicted_pushes")


def wrench_of(force, point):
    """Return force and moment (1, 6) of a force (3,) [N] at a point (3,) [m]."""
    return np.r_[force, np.cross(point, force)][None]


def standing(corners=CORNERS, centre=CENTRE, mass=(0.0, 0.0), sigma=0.0):
    """Return a body of which each corner is known to sigma [m], horizontally."""
    count = len(corners)
    slopes = np.eye(2 * count).reshape(count, 2, -1)
    covariance = sigma**2 * np.eye(2 * count)
    return Standing(corners - centre, centre, np.array(mass), slopes, covariance)


def margin_of(force, point, motion=(0.0, 0.0, 0.0), body=None):
    body = standing() if body is None else body
    return body.margin(np.array(motion)[None], wrench_of(force, point), WEIGHT)[0][0]


def test_a_body_at_rest_is_carried_below_its_centre():
    assert margin_of([0, 0, 0], [0, 0, 0]) == pytest.approx(0.02, rel=2e-3)


def test_a_push_moves_the_centre_of_pressure_ahead_by_its_height():
    # F h / m g = 2 N * 25 mm / 5 N = 10 mm, of 20 mm to the edge ahead
    assert margin_of([0, 2, 0], [0, -0.02, 0.025]) == pytest.approx(0.01, rel=2e-3)
    # mu_g m g tips where mu_g h exceeds half the side
    assert margin_of([0, 5, 0], [0, -0.02, 0.025]) == pytest.approx(-0.005, rel=2e-3)


def test_what_presses_down_beyond_the_middle_is_carried_there():
    # 5 N at 18 mm beside the 5 N of the weight: in the middle of the two
    down = margin_of([0, 0, -5], [0, 0.018, 0.03])
    assert down == pytest.approx(0.02 - 0.009, rel=2e-3)


def test_a_margin_does_not_depend_on_where_the_body_lies_and_how_it_is_turned():
    force, point = np.array([0.5, 1.5, -1.0]), np.array([0.01, -0.02, 0.025])
    here = margin_of(force, point)
    moved = np.array([0.02, -0.01, 0.7])
    turn = Rotation.from_rotvec([0, 0, moved[2]])
    there = turn.apply(point) + np.array([*moved[:2], 0])
    assert margin_of(turn.apply(force), there, moved) == pytest.approx(here, abs=3e-5)
    shift = np.array([0.3, 0.1, -0.2])  # of all, the ground too
    shifted = standing(CORNERS + shift, CENTRE + shift)
    assert margin_of(force, point + shift, body=shifted) == pytest.approx(
        here, abs=1e-9
    )


def test_where_the_mass_is_the_body_is_carried():
    aside = standing(mass=[0.0, 0.012])
    assert margin_of([0, 0, 0], [0, 0, 0], body=aside) == pytest.approx(0.008, rel=2e-3)
    turned = margin_of([0, 0, 0], [0, 0, 0], (0.0, 0.0, 1.1), aside)
    assert turned == pytest.approx(0.008, rel=2e-3)


def test_a_margin_is_as_uncertain_as_the_edge_over_which_the_body_would_tip():
    body = standing(sigma=0.003)
    rest = np.zeros((1, 3)), np.zeros((1, 6)), WEIGHT
    assert body.margin(*rest)[1][0] == pytest.approx(0.003)
    assert standing().margin(*rest)[1][0] == 0


def test_a_body_on_an_edge_stands_by_what_holds_it_alone():
    turn = Rotation.from_rotvec([np.pi / 4, 0, 0])
    edge = standing(turn.apply(CORNERS - CENTRE), np.zeros(3))
    assert margin_of([0, 0, 0], [0, 0, 0], body=edge) == pytest.approx(0, abs=1e-9)
    assert margin_of([0, 1, 0], [0, 0, 0], body=edge) < 0


@pytest.mark.parametrize("lean", [0.05, -0.3, 0.6])
def test_a_body_that_leans_comes_to_lie_on_its_face(lean):
    turn = Rotation.from_rotvec([0, 0, 0.4]) * Rotation.from_rotvec([lean, 0, 0])
    corners = turn.apply(CORNERS - CENTRE)
    at = np.array([0.1, 0.2, -corners[:, 2].min()])
    fell, where = settling(corners, at)
    lies = corners @ fell.T + where
    assert np.sort(lies[:, 2]) == pytest.approx([0] * 4 + [SIDES[2]] * 4, abs=1e-6)
    below, low = corners[:, 2].argmin(), (corners + at)[:, 2].min()
    assert low == pytest.approx(0)
    # About the edge on which it leaned, which stays where it was:
    assert lies[below] == pytest.approx((corners + at)[below], abs=1e-6)


@pytest.mark.parametrize(("height", "slides"), [(0.012, True), (0.08, False)])
def test_a_finger_on_a_tall_box_tips_it_where_it_pushes_high(height, slides):
    at = known(**vars(TALL) | {"position": np.array([[0.0, 0.0, height]])})
    action = SPACE.action(np.zeros(4), active=[True, False])
    ahead = ExpectedInformation(at, SPACE).prospect(action)
    assert ahead.margin.shape == (len(ahead.motion),)
    assert ahead.margin[0] == np.inf  # not reached yet
    assert (ahead.chance_to_slide > 0.9) == slides
    assert (ahead.chance_to_slide < 0.01) != slides


def test_of_what_tips_nothing_is_expected():
    expected = ExpectedInformation(TALL, SPACE)
    some = actions(30)
    chances = np.array([expected.prospect(a).chance_to_slide for a in some])
    gains = np.array([expected.gain(a) for a in some])
    assert np.count_nonzero(chances < 0.01) > 10
    assert gains[chances < 0.01].max() < 0.1
    assert gains[chances > 0.8].min() > 1.0


def test_a_body_that_leans_on_a_finger_is_pushed_as_it_lies_when_let_go():
    """A box of 6 deg at the last sample, which stands on an edge alone."""
    flat, leans = (
        known(**vars(TALL) | {
            "unknowns": {"x": np.array([[0, 0, 0.045, angle, 0, 0]]).T},
            "information": informed(np.eye(9) / 2e-3**2),
        })
        for angle in (0.0, 0.1)
    )  # fmt: skip
    some = actions(20)
    lying, falls = (ExpectedInformation(one, SPACE) for one in (flat, leans))
    poses = np.array([e.beliefs[0].z[3:] for e in (lying, falls)])
    assert np.abs(poses[:, 3:]).max() < 1e-4  # upright, h sin 6 deg beside
    assert poses[1, :3] - poses[0, :3] == pytest.approx([0, 0.0045, 0], abs=2e-4)
    gains = np.array([[e.gain(a) for a in some] for e in (lying, falls)])
    assert gains.max(axis=1) == pytest.approx([gains[0].max()] * 2, rel=0.2)
    assert gains[0].max() > 3


def test_the_study_of_pushes_sees_solids_and_tall_boxes_tip(pushes):
    rows = [pushes.compared(2, 8.0, kind) for kind in ("tall", "solid")]
    assert all(np.isfinite(row["margin"]) for row in rows)
    assert "of 1 tip" in pushes.said(rows, 8.0)


def test_a_shape_without_a_mesh_stands_on_its_corners():
    """Rays, by which its surface is sampled, miss them."""
    own = replace(CUBOID, name="own", mesh=None)
    at = np.array([0.03, 0.03, 0.12, 0.0, 0.0, 0.0])
    for shape in (CUBOID, own):
        body = standing_of(shape, at, np.eye(6), np.zeros(3))
        margin, _ = body.margin(np.zeros((1, 3)), np.zeros((1, 6)), WEIGHT)
        assert margin[0] == pytest.approx(0.015, rel=2e-3)
