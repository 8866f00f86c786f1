"""The benchmark of sigma: it must find a sigma that is too small, or a bias."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import RECORDED, benchmark
from scipy.spatial.transform import Rotation

from tactilenlp import Measurements, Scene
from tactilenlp.errors import TactileError

NAMES = ["side x", "position x", "rotation z"]
C = np.array([[4.0, 1.0, 0.0], [1.0, 1.0, 0.2], [0.0, 0.2, 9.0]]) * 1e-6
KINDS = ("user", "exact", "sandwich", "gauss_newton", "paper")


report = benchmark("report_monte_carlo")


def rows(count=400, bias=0.0, **covariances):
    """Return re-measurements with errors of covariance C, as the benchmark has them."""
    noise = np.random.default_rng(0).multivariate_normal(np.zeros(3), C, count)
    told = {kind: covariances.get(kind, C).tolist() for kind in KINDS}
    return [
        {"scene": "made", "success": True, "number": k, "names": NAMES,
         "error": (bias + error).tolist()} | told
        for k, error in enumerate(noise)
    ]  # fmt: skip


def test_a_true_sigma_is_found_true_and_half_of_it_is_not(report):
    lines = report.compare("made", rows(user=C / 4, sandwich=C / 5))
    low, high = report.told_by(400)
    assert (
        0.93 < low < 1 < high < 1.08
    )  # of a scatter of 400 runs: 1 -+ 1.96 / sqrt(800)
    for line in lines:
        assert low < line["exact"] < high
        assert line["user"] == pytest.approx(line["exact"] / 2)
        assert line["observed"]


def test_squared_errors_are_one_a_dimension_where_the_covariance_is_true(report):
    found = {"made": rows(user=C / 4)}
    mean, low, high = report.pooled(found, "exact", truth=False)
    assert low < mean < high
    assert report.pooled(found, "user", truth=False)[0] == pytest.approx(4 * mean)


def test_a_bias_shows_about_the_truth_and_not_about_the_mean(report):
    found = {"made": rows(bias=np.array([2e-3, 0, 0]))}
    mean, low, high = report.pooled(found, "exact", truth=False)
    assert low < mean < high
    assert report.pooled(found, "exact", truth=True)[0] > high


def test_what_is_known_exactly_counts_as_no_dimension(report):
    flat = C.copy()
    flat[2] = flat[:, 2] = 0
    squares = report.nees(rows(5, exact=flat), "exact", np.zeros(3))
    assert squares[:, 1].tolist() == [2] * 5


def test_a_report_is_a_table_a_file_and_a_picture(report, tmp_path, capsys):
    header = {"format": "tactilenlp study", "version": 1, "study": "monte carlo"}
    lines = [header] + [{"case": [k], "result": r} for k, r in enumerate(rows(20))]
    lines.append({"case": [20], "result": {"scene": "made", "success": False}})
    text = "".join(json.dumps(line) + "\n" for line in lines)
    (tmp_path / report.FILE).write_text(text)
    report.report(tmp_path)
    said = capsys.readouterr().out
    assert "made: 1 of 21 failed" in said
    assert "as far as the runs can tell" in said
    assert (tmp_path / "monte_carlo.png").stat().st_size > 1000
    assert (tmp_path / "monte_carlo.csv").read_text().count("\n") == 4


def test_covariances_of_sizes_are_moved_to_the_true_axes(report):
    import monte_carlo

    names = ["side x", "side y", "side z", "position x"]
    order = monte_carlo.on_true_axes(names, np.array([1, 0, 2]))
    assert np.diag(np.diag([1.0, 2, 3, 4])[order]).tolist() == [2, 1, 3, 4]


def test_a_report_says_where_nothing_is_observed(report):
    assert report.of_observed([], "user") == "none observed"


@pytest.fixture
def refused(report, monkeypatch):
    """Return a function: the row of a refused re-measurement, and how it was solved.

    without: the reductions that the recording is solved without.
    """
    import monte_carlo

    given, data = {}, Measurements.load(RECORDED)

    def refuses(*_, **options):
        given.update(options)
        raise TactileError("too late", where="contact", next="-")

    def measured(*without):
        truth = SimpleNamespace(start=lambda estimate: "the true motion")
        options = SimpleNamespace(without=without)
        known = data, Scene(), truth, options, SimpleNamespace()
        monkeypatch.setattr(monte_carlo, "known", lambda *_: known)
        return monte_carlo.measure(str(RECORDED), 6, 0, monte_carlo.NOISE), given

    monkeypatch.setattr(monte_carlo, "replace", lambda one, **_: one)
    monkeypatch.setattr("judging.solve_estimate", refuses)
    return measured


def test_a_re_measurement_that_is_refused_is_a_failure(refused):
    row, given = refused()
    assert not row["success"]
    assert "too late" in row["refused"]
    assert given["start"] == "the true motion"


def test_a_body_that_tumbles_does_not_start_in_the_plane(refused):
    assert refused("planar")[1]["start"] is None


@pytest.mark.slow
def test_errors_are_modulo_the_symmetry_of_a_box_whose_y_is_longer(report, tmp_path):
    """Estimates have axes x >= y, and the truth here has not."""
    import monte_carlo

    with np.load(RECORDED) as file:
        arrays = dict(file)
    sides, turn = arrays["side_lengths"], arrays["object_quaternion"]
    assert sides[0] > sides[1]
    arrays["side_lengths"] = sides[[1, 0, 2]]
    quarter = Rotation.from_euler("z", 90, degrees=True)
    turned = Rotation.from_quat(turn, scalar_first=True) * quarter
    arrays["object_quaternion"] = turned.as_quat(scalar_first=True)
    np.savez(tmp_path / "turned.npz", **arrays)
    file = str(tmp_path / "turned.npz")
    row = monte_carlo.measure(file, 6, 0, monte_carlo.NOISE)
    error = dict(zip(row["names"], row["error"], strict=True))
    sides = [error[f"side {axis}"] for axis in "xyz"]
    assert np.abs(sides).max() < 5e-3
    assert abs(error["rotation z"]) < np.radians(5)


@pytest.mark.slow
def test_a_re_measurement_of_several_actions_is_solved_from_the_true_motion(report):
    import monte_carlo

    row = monte_carlo.measure(str(RECORDED), 2, 0, monte_carlo.NOISE)
    assert row["success"]
    assert row.keys() >= {*KINDS}
