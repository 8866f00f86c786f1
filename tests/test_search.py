"""Multi-hypothesis tracking: hypotheses are found, kept and continued."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from formulations.polytope import polytope
from formulations.shape import CUBOID
from tactilenlp import Guess, Options, Session, solve_estimate
from tactilenlp.errors import MotionError, StartError
from tactilenlp.estimation import optima
from tactilenlp.estimation.initial_search import initial_hypotheses
from tactilenlp.estimation.interrupted import Incumbents
from tactilenlp.geometry.tipping import planar_to_free
from tactilenlp.interface.request import read_request
from tactilenlp.local.comparison import diverse_starts, of_other_yaw, same_body
from tactilenlp.search.contact_frame import ContactFrame
from tactilenlp.search.least_motion import least_motion, unseen_optima
from tactilenlp.search.multi_hypothesis import TrackingSearch
from tactilenlp.tracking.geometry import geometry_of
from tactilenlp.tracking.initial_states import body_height
from tactilenlp.tracking.tracks import YAW_CELL, Tracks, diverse, split_tracks


@pytest.mark.slow
def test_a_guess_of_the_user_starts_the_search(recorded):
    data, scene, truth = recorded
    x, y, z = truth["object_position"][0]
    w, _, _, s = truth["object_quaternion"][0]
    guess = Guess(truth["side_lengths"], (x, y, z), 2 * np.arctan2(s, w))
    estimate = solve_estimate(data.select(range(2)), scene, start=guess)
    assert estimate.success
    assert estimate.hypotheses[0].path[0].startswith("guess")


@pytest.mark.parametrize(
    ("sides", "place"),
    [(np.ones(2), (0, 0)), (-np.ones(3), (0, 0)), (np.ones(3), (0, np.nan))],
)
def test_a_guess_that_fits_nothing_is_refused(recorded, sides, place):
    with pytest.raises(StartError):
        solve_estimate(recorded[0], start=Guess(sides, place))


@pytest.mark.slow
def test_a_start_with_a_lower_objective_of_the_same_data_is_kept(
    recorded, estimate, monkeypatch
):
    data, scene, _ = recorded
    data, found = data.select(range(3)), estimate.hypotheses[0]
    lost = replace(found, x=found.x + np.array([[0.0], [0.0], [np.pi / 4]]))
    monkeypatch.setattr(optima, "initial_hypotheses", lambda *_: ([lost], [lost]))
    turned = solve_estimate(data, scene, throw=False)
    assert turned.objective > estimate.objective + 10  # another optimum
    again = solve_estimate(data, scene, start=estimate)
    assert again.objective < estimate.objective + 1e-3


def test_hypotheses_are_distinct_best_first_and_cover_all_samples(estimate):
    assert len(estimate.hypotheses) <= Options().widths(precise=True)[0]
    for h in estimate.hypotheses:
        assert h.x.shape == (3, estimate.measurements.samples)
    assert np.allclose(estimate.hypotheses[0].theta, estimate.theta, atol=1e-6)


def test_an_action_without_contact_changes_nothing_that_was_known(recorded, estimate):
    data, scene, _ = recorded
    past, more = data.select(range(3)), data.select([3])
    away = more.finger_position + np.array([0, 0, 0.1])
    none = {"contact": 0 * more.contact, "normal": 0 * more.normal}
    free = replace(more, finger_position=away, **none)
    longer = solve_estimate(past.append(free), scene, start=estimate)
    # Nothing was felt: the same optimum, a lower one of a size that is open, or the
    # more probable of two that are almost as low.
    assert longer.objective < estimate.objective + 0.05
    off = longer.side_lengths - estimate.side_lengths
    assert np.all(np.abs(off) < 0.05 * estimate.information.sigma("side_lengths"))
    assert np.allclose(longer.position[-1], longer.position[92], atol=1e-4)


def test_tracks_of_every_yaw_are_kept_beside_the_best_ones():
    yaw = np.r_[np.zeros(900), np.full(60, 0.5), np.full(40, 1.0)]  # the best first
    cells = np.round(yaw / YAW_CELL)[None]
    kept = diverse(100, cells)
    assert np.array_equal(kept[:50], np.arange(50))
    assert len(kept) == len(np.unique(kept)) == 100
    assert min((yaw[kept] == 0.5).sum(), (yaw[kept] == 1.0).sum()) >= 20
    assert np.array_equal(diverse(100, cells[:, :99]), np.arange(99))
    place = np.r_[np.arange(990), np.zeros(10)][None]  # a cell each, but the last ones
    kept = diverse(100, cells, place)
    assert len(kept) == 100
    assert np.array_equal(kept[:34], np.arange(34))
    assert (yaw[kept] > 0).sum() == 33
    assert kept[66] == 66


def test_noisy_paths_without_a_touch_are_not_searched_from_scratch(estimate):
    scene = replace(estimate.scene, sigma_position=1e-3, sigma_normal=0.1)
    options = Options(check_mistakes=False)
    given = "cuboid", "violation_implicit", options, None, None, Session()
    request, _ = read_request(estimate.measurements, scene, *given)
    data = request.job.data
    job = replace(request.job, data=replace(data, valid=np.zeros_like(data.valid)))
    found = TrackingSearch(job, estimate.hypotheses, 2).starts()
    assert found
    assert np.allclose(found[0].theta, estimate.theta, atol=0.02)


def test_tracks_of_an_exact_state_are_kept_though_rounding_made_them_indefinite():
    count = 3
    P = np.repeat(np.diag([1e-4, 1e-4, 1e-4, 1e-6, 1e-6, -1e-20])[..., None], count, 2)
    z = np.tile(np.arange(count) * 0.1, (6, 1))
    none = np.zeros(count), np.ones((2, count)), np.zeros((3, count))
    boxes = SimpleNamespace(geometry=geometry_of(CUBOID))
    tracks, rows = split_tracks(boxes, Tracks(z, P, *none), True, None)
    assert sorted(rows) == [0, 1, 2]
    assert np.linalg.eigvalsh(np.moveaxis(tracks.P, -1, 0)).min() > 0
    assert np.allclose(tracks.P, P, atol=1e-15)
    with pytest.raises(MotionError, match="no track"):
        split_tracks(boxes, Tracks(z, P + np.nan, *none), True, None)


def test_noise_of_normals_is_no_rim():
    """Half of the touches of a side seem to look up by more than noise of 5 degrees."""
    T, up = 20, np.tile([0.0, 0.4], 10)
    normal = np.stack([np.sqrt(1 - up**2), np.zeros(T), up], axis=1)[:, None]
    data = SimpleNamespace(
        contact=np.ones((T, 1), bool), valid=np.ones((T, 1), bool), normal=normal,
        action=np.zeros(T, int), finger_radius=np.array([0.01]), fingers=1,
        finger_position=np.tile([0.05, 0.0, 0.024], (T, 1))[:, None],
    )  # fmt: skip
    precise = body_height(data, CUBOID, 0.045, np.radians(2))
    assert precise == pytest.approx(0.024 - 0.4 * 0.01)  # the rim that was touched
    assert body_height(data, CUBOID, 0.045, np.radians(15)) == 0.045


@pytest.mark.parametrize("shape", [CUBOID, polytope()], ids=["cuboid", "polytope"])
def test_a_search_does_not_depend_on_the_axes_of_the_world(recorded, shape):
    """Turned by a right angle, which is exact, and moved, the best start is the same.

    Others may differ along a side that is open: rounding decides between them.
    """
    data, scene, _ = recorded
    data, found = data.select([0, 1]), []
    R = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    for there in (data, data.transformed(R, np.array([0.5, -0.25, 0.0]))):
        request, _ = read_request(there, scene, shape)
        found.append(initial_hypotheses(request, Incumbents([]))[1])
    (best, *_), (moved, *_) = found
    back = ContactFrame(np.array([0.5, -0.25, np.pi / 2])).into(moved)
    assert same_body(shape, best, back)  # its sides may be named otherwise
    objectives = [[h.objective for h in starts] for starts in found]
    np.testing.assert_allclose(*objectives, atol=0.01)  # of solves to 1e-3


def test_hypotheses_come_back_out_of_the_frame_of_the_first_touch(estimate):
    h = estimate.hypotheses[0]
    h = replace(h, offset=np.arange(6.0).reshape(3, 2) / 1e3)
    frame = ContactFrame(np.array([0.3, -0.2, 2.0]))
    back = frame.out_of(frame.into(h))
    np.testing.assert_allclose(back.x, h.x, atol=1e-15)
    np.testing.assert_allclose(back.offset, h.offset, atol=1e-15)
    free = replace(h, x=planar_to_free(h.theta, h.x), offset=None)
    moved = frame.into(free)
    np.testing.assert_allclose(moved.x, planar_to_free(h.theta, frame.into(h).x))
    np.testing.assert_allclose(frame.out_of(moved).x, free.x, atol=1e-15)


def test_a_search_ends_where_no_optimum_is_expected_besides_those_seen():
    """By hand: w (w + 1) / (n - w - 2) of Boender and Rinnooy Kan, 1987."""
    assert unseen_optima(8, 1) == pytest.approx(2 / 5)
    assert unseen_optima(17, 2) == pytest.approx(6 / 13)
    assert unseen_optima(4, 2) == np.inf  # too few starts to expect anything
    assert unseen_optima(9, 1) < unseen_optima(8, 1) < unseen_optima(8, 2)


def test_least_motion_ends_early_where_all_starts_come_to_one_optimum(estimate, caplog):
    """Of 20 equal paths as many are solved as show that there is one optimum."""
    given = "cuboid", "violation_implicit", Options(), None, None, Session()
    request, _ = read_request(estimate.measurements, estimate.scene, *given)
    paths = [estimate.hypotheses[0]] * 20
    caplog.set_level("INFO", "tactilenlp")
    found = least_motion(request.job, paths, None, {})
    assert len(found) == 8
    assert "1 optima from 8 starts" in caplog.text


def test_every_second_start_is_of_another_yaw(estimate):
    """The first few tell whether other optima are to be expected."""
    h = estimate.hypotheses[0]

    def turned(yaw, objective):
        x = h.x + np.array([[0.0], [0.0], [yaw]])
        return replace(h, x=x, objective=objective)

    face = [turned(1e-3 * k, 0.01 * k) for k in range(30)]
    edges = [turned(0.4 * (k % 3 + 1) + 1e-3 * k, 20.0 + 0.1 * k) for k in range(9)]
    found = diverse_starts(CUBOID, [*face, *edges], 12)
    turns = np.array([one.x[2, -1] - h.x[2, -1] for one in found])
    assert found[0] is face[0]
    assert (turns[1:8:2] > 0.2).sum() >= 3
    assert (turns[::2] < 0.2).all()
    assert [len(diverse_starts(CUBOID, [*face, *edges], n)) for n in (0, 1, 2)] == [
        0, 1, 2
    ]  # fmt: skip


def test_a_yaw_is_another_one_up_to_quarter_turns_of_a_box(estimate):
    h, turns = estimate.hypotheses[0], (0.0, np.pi / 2 + 0.1, 0.2, -np.pi / 2 - 0.3)
    several = [replace(h, x=h.x + np.array([[0.0], [0.0], [yaw]])) for yaw in turns]
    found = of_other_yaw(CUBOID, several, [h])
    assert [several.index(one) for one in found] == [2, 3]
    assert of_other_yaw(CUBOID, several, several) == []
