"""A ground that leans against the frame in which it is told to be level."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from formulations.shape import CUBOID
from tactilenlp import Estimate, Ground, Guess, Options, Scene, solve_estimate
from tactilenlp.estimation import optima
from tactilenlp.evaluation.metrics import cuboid_errors
from tactilenlp.information.goodness_of_fit import Misfit
from tactilenlp.interface.request import first_guess
from tactilenlp.refinement.ground_tilt import estimate_ground_tilt, moved_to
from tactilenlp.tracking.surface import body_surface, pose_of

LEAN = np.radians((0.7, -0.5, 0.0))  # [rad] rotation vector of the world


def test_a_turned_ground_keeps_a_point_and_remembers_the_given_one():
    told = Ground(0.1, tuple(Rotation.from_rotvec([0.3, 0.1, 0]).apply([0, 0, 1.0])))
    about = np.array([0.2, -0.1, 0.0])
    turned = told.turned((0.01, -0.02), about)
    place = told.from_ground(about)
    assert turned.distance(place) == pytest.approx(0.0, abs=1e-12)
    tilt = told.rotation @ turned.tilt
    assert tilt == pytest.approx([0.01, -0.02, 0.0], abs=1e-5)
    assert turned.told == told
    again = turned.turned((-0.01, 0.02), turned.to_ground(place))
    assert again.told == told
    assert again.normal == pytest.approx(told.normal, abs=1e-4)
    assert Scene(ground=turned).as_told == Scene(ground=told)
    assert (told.tilt == 0).all()


def leaning(data):
    """Return the measurements in a world that is turned by LEAN about its origin."""
    return data.transformed(Rotation.from_rotvec(LEAN).as_matrix(), np.zeros(3))


@pytest.fixture(scope="module")
def estimates(recorded):
    data, scene, _ = recorded
    data = data.select([0, 1, 2])
    exact = replace(scene, sigma_tilt=0.0)
    return (
        solve_estimate(data, exact), solve_estimate(data, scene),
        solve_estimate(leaning(data), scene),
    )  # fmt: skip


@pytest.mark.slow
def test_a_level_ground_stays_level_and_tells_how_well_that_is_known(estimates):
    exact, level, _ = estimates
    assert level.scene.ground == exact.scene.ground == Ground()
    assert level.objective == exact.objective
    assert (level.position == exact.position).all()
    assert np.isnan(exact.information.sigma("rotation")[:2]).all()
    assert np.isnan(exact.information.along_path("rotation")[:, :2]).all()
    tilts = level.information.sigma("rotation")[:2]
    assert tilts.max() < np.radians(0.3)
    for name in ("side_lengths", "position"):
        ratio = level.information.sigma(name) / exact.information.sigma(name)
        assert ratio.min() >= 1 - 1e-6
        assert ratio.max() < 1.05
    path = level.information.along_path("rotation")
    assert path[-1, :2] == pytest.approx(tilts, rel=0.05)


@pytest.mark.slow
def test_a_ground_that_leans_is_found(estimates, recorded, tmp_path):
    _, level, lean = estimates
    truth = recorded[2]
    assert lean.fit.verdict == "good"
    assert lean.objective == pytest.approx(level.objective, abs=0.5)
    assert lean.scene.ground.tilt == pytest.approx(LEAN, abs=np.radians(0.1))
    assert lean.scene.as_told.ground == Ground()
    turn, last = Rotation.from_rotvec(LEAN), lean.measurements.samples - 1
    q = turn * Rotation.from_quat(truth["object_quaternion"][last], scalar_first=True)
    error = cuboid_errors(
        lean.side_lengths, lean.position[-1], lean.quaternion[-1],
        truth["side_lengths"], turn.apply(truth["object_position"][last]),
        q.as_quat(scalar_first=True),
    )  # fmt: skip
    sigma = lean.information.sigma("rotation")
    assert (np.abs(error.rotation_vector) < 3 * sigma).all()
    assert np.abs(error.rotation_vector[:2]).max() < np.radians(0.1)
    file = tmp_path / "lean.npz"
    lean.save(file)
    assert Estimate.load(file) == lean
    assert "The ground leans" in lean.summary()


@pytest.mark.slow
def test_an_update_goes_on_on_the_ground_that_was_found(estimates, recorded):
    data, scene, _ = recorded
    before = estimates[2]
    after = solve_estimate(leaning(data.select([0, 1, 2, 3])), scene, start=before)
    assert after.scene.ground.tilt == pytest.approx(LEAN, abs=np.radians(0.1))
    assert after.scene.as_told == scene
    assert after.fit.verdict == "good"


def test_without_excess_the_ground_is_not_turned(monkeypatch):
    class Solution:
        success = True

    class Solved:
        solution = Solution()
        job = SimpleNamespace(fixes=lambda name: name == "level")

    where = "tactilenlp.refinement.ground_tilt.misfit_of"
    monkeypatch.setattr(where, lambda solved: Misfit(1.0, 0.0, 3.0))
    kept = [Solved()]
    assert estimate_ground_tilt(kept) is kept


def test_a_guess_of_the_world_is_one_of_the_ground_that_leans():
    ground = Ground(0.01, (0.0, -np.sin(0.5), np.cos(0.5)))
    place = ground.from_ground(np.array([0.1, 0.3, 0.02]))
    for position in (place, ground.from_ground(np.array([0.1, 0.3, 0.0]))[:2]):
        guess = Guess((0.05, 0.04, 0.04), position, yaw=0.2)
        h = first_guess(guess, CUBOID, ground)
        assert h.theta.tolist() == [0.05, 0.04, 0.04]
        assert h.x[:, 0] == pytest.approx([0.1, 0.3, 0.2])


@pytest.mark.slow
@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.0, 0.866025403784, 0.5)])
def test_a_lean_is_found_however_far_away_the_origin_of_the_world_is(
    estimates, recorded, normal
):
    """A table 0.8 m above the origin, level as told or steep: its frame is far away."""
    data, scene, _ = recorded
    table = Ground(0.8, normal)
    moved = leaning(data.select([0, 1, 2]))
    moved = moved.transformed(table.rotation.T, table.origin)
    given = Options(check_mistakes=False)
    high = solve_estimate(moved, replace(scene, ground=table), options=given)
    low = estimates[2]
    assert high.objective == pytest.approx(low.objective, abs=0.01)
    assert high.side_lengths == pytest.approx(low.side_lengths, abs=1e-5)
    tilts = [np.linalg.norm(e.scene.ground.tilt) for e in (high, low)]
    assert tilts[0] == pytest.approx(tilts[1], abs=1e-4)
    assert tilts[0] > 0.01


@pytest.mark.slow
@pytest.mark.parametrize("without", [(), "planar"])
@pytest.mark.parametrize("shape", ["cuboid", "polytope"])
def test_a_body_stays_where_it_is_in_the_world_when_the_grounds_frame_moves(
    recorded, monkeypatch, shape, without
):
    """A milliradian about the body: the frame, 0.8 m away, moves by 0.8 mm."""
    data, scene, _ = recorded
    table, solves = Ground(0.8, (0.0, 0.6, 0.8)), []
    data = data.select([0, 1]).transformed(table.rotation.T, table.origin)

    def kept(found):
        solves.append(found[0])
        return found

    monkeypatch.setattr(optima, "estimate_ground_tilt", kept)
    options = Options(check_mistakes=False, without=without)
    given = {"shape": shape, "options": options, "throw": False}
    solve_estimate(data, replace(scene, ground=table), **given)
    before, ground = solves[-1], solves[-1].job.scene.ground
    turned = ground.turned((1e-3, -0.7e-3), np.r_[before.at.x[:2, -1], 0.0])
    after = moved_to(turned, before)
    assert len(after.at.x) == (6 if without else 3)
    off = [places(one.at, one.job) for one in (before, after)]
    assert np.abs(off[1] - off[0]).max() < 0.15e-3
    assert after.job.scene.ground == turned


def places(h, job):
    """Return the points (T, V, 3) [m] of a body, in the world."""
    body, out = body_surface(job.shape, h.theta), []
    for x in h.x.T:
        p, R = pose_of(job.shape, h.theta, x)
        out.append(job.scene.ground.from_ground(body @ R.T + p))
    return np.array(out)
