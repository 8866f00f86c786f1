"""Classes of shapes compared by their evidence."""

import time
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from formulations.polytope import polytope
from formulations.shape import CUBOID
from tactilenlp import CYLINDER, ELLIPSOID, Estimate, Options, solve_estimate
from tactilenlp.errors import Interrupted, NoContactError, OptionError, StartError
from tactilenlp.estimation.solver import ClassSolver
from tactilenlp.information.mixture import occam_factor
from tactilenlp.interface.request import read_request
from tactilenlp.interface.session import Guess, Session
from tactilenlp.refinement import model_selection
from tactilenlp.search.proposals_poses import body_on_poses

LIMITED = Options(time_limit=60.0)


def line(degree, x, y, sigma, spread):
    """Return objective, covariance and prior information of a fitted polynomial."""
    J = np.vander(x, degree + 1)
    prior = np.eye(degree + 1) / spread**2
    C = np.linalg.inv(J.T @ J / sigma**2 + prior)
    z = C @ J.T @ y / sigma**2
    off = (y - J @ z) / sigma
    return (off @ off + z @ prior @ z) / 2, C, prior


def log_evidence(objective, covariance, prior):
    return -objective - occam_factor(covariance, prior)[0]


def test_evidence_is_that_of_linear_least_squares():
    rng = np.random.default_rng(4)
    x, sigma, spread = np.linspace(-1, 1, 20), 0.1, 2.0
    y = 0.7 - 0.3 * x + sigma * rng.normal(size=x.size)
    told, exact = [], []
    for degree in (0, 1, 3):
        told.append(log_evidence(*line(degree, x, y, sigma, spread)))
        J = np.vander(x, degree + 1)
        S = sigma**2 * np.eye(x.size) + spread**2 * J @ J.T
        exact.append(-(y @ np.linalg.solve(S, y) + np.linalg.slogdet(S)[1]) / 2)
    assert np.diff(told) == pytest.approx(np.diff(exact), abs=1e-6)
    assert np.argmax(told) == 1


def test_an_unobserved_unknown_does_not_change_the_evidence():
    one = log_evidence(1.0, np.diag([0.01]), np.eye(1))
    two = log_evidence(1.0, np.diag([0.01, 1.0]), np.eye(2))
    assert two == pytest.approx(one)


def test_classes_are_named_before_any_solve(recorded):
    data, scene, _ = recorded
    with pytest.raises(OptionError, match=r"unknown shape.*got sphere"):
        solve_estimate(data, scene, shape=["cuboid", "sphere"])
    with pytest.raises(OptionError, match="no class"):
        solve_estimate(data, scene, shape=[])
    nothing = replace(data, contact=0 * data.contact, normal=0 * data.normal)
    with pytest.raises(NoContactError):
        solve_estimate(nothing, scene, shape=["cuboid", "polytope"])


@pytest.mark.slow
def test_a_box_is_a_box_rather_than_a_hull(recorded, tmp_path):
    data, scene, _ = recorded
    estimate = solve_estimate(data, scene, shape=["polytope", "cuboid"])
    assert estimate.shape == "cuboid"
    best, other = estimate.classes
    assert (best.shape, other.shape) == ("cuboid", "polytope")
    assert best.probability > 0.95
    assert best.probability + other.probability == pytest.approx(1)
    assert not other.error
    assert "Of the classes compared, cuboid" in estimate.summary()
    estimate.save(tmp_path / "box.npz")
    assert Estimate.load(tmp_path / "box.npz").classes == estimate.classes


@dataclass(frozen=True)
class Fit:
    """A goodness of fit, as its verdict."""

    verdict: str


@dataclass(frozen=True)
class Known:
    """An estimate of a class with an objective, which is its evidence less the sign."""

    shape: str
    objective: float
    seconds: dict = field(default_factory=dict)
    classes: tuple = ()
    success: bool = True
    fit: object = None
    status: str = "Solve_Succeeded"


def test_the_poses_of_the_likeliest_class_start_those_that_were_lost(monkeypatch):
    asked = []
    monkeypatch.setattr(model_selection, "evidence_of", lambda e, _: -e.objective)
    first = {"polytope": 5.0, "cuboid": 20.0, "cylinder": 300.0, "ellipsoid": 7.0}

    class Solver:
        def of_class(self, shape, options, start, to_beat):
            return Known(shape.name, first[shape.name])

        def from_poses(self, shape, options, poses, most):
            asked.append((shape.name, poses.shape, most))
            return Known(shape.name, 1.0) if shape.name == "cuboid" else None

    classes = model_selection.classes_of(list(first))
    best = model_selection.likeliest_class(classes, Solver(), None, LIMITED)
    assert asked == [("cuboid", "polytope", 20.0), ("cylinder", "polytope", 20.0)]
    assert (best.shape, best.objective) == ("cuboid", 1.0)
    odds = {one.shape: one.probability for one in best.classes}
    assert odds["cuboid"] > 0.95
    assert sum(odds.values()) == pytest.approx(1)


@pytest.mark.parametrize("stage", ["of_class", "from_poses"])
def test_ctrl_c_among_classes_leaves_the_best_of_those_that_ended(monkeypatch, stage):
    monkeypatch.setattr(model_selection, "evidence_of", lambda e, _: -e.objective)
    ended = {"cuboid": 20.0, "cylinder": 5.0, "ellipsoid": 9.0}

    class Solver:
        def of_class(self, shape, *_):
            if stage == "of_class" and shape.name == "ellipsoid":
                raise Interrupted("stopped by Ctrl-C before anything was found")
            return Known(shape.name, ended[shape.name])

        def from_poses(self, *_):
            raise Interrupted("stopped by Ctrl-C before anything was found")

    classes = model_selection.classes_of(list(ended))
    with pytest.raises(Interrupted) as stop:
        model_selection.likeliest_class(classes, Solver(), None, LIMITED)
    assert stop.value.estimate.shape == "cylinder"


def test_later_classes_are_told_the_least_objective_of_a_good_fit(monkeypatch):
    monkeypatch.setattr(model_selection, "evidence_of", lambda e, _: -e.objective)
    objectives = {"cuboid": 3.0, "cylinder": 7.0, "ellipsoid": 5.0, "polytope": 6.0}
    told = {}

    class Solver:
        def of_class(self, shape, options, start, to_beat):
            told[shape.name] = to_beat
            fit = Fit("bad" if shape.name == "cuboid" else "good")
            return Known(shape.name, objectives[shape.name], fit=fit)

        def from_poses(self, *_):
            return None

    classes = model_selection.classes_of(list(objectives))
    model_selection.likeliest_class(classes, Solver(), None, LIMITED)
    expected = {"cuboid": np.inf, "cylinder": np.inf, "ellipsoid": 7.0, "polytope": 5.0}
    assert told == expected


def test_no_class_begins_after_the_time_limit_of_all(monkeypatch):
    monkeypatch.setattr(model_selection, "evidence_of", lambda e, _: -e.objective)

    class Solver:
        def of_class(self, shape, *_):
            time.sleep(0.15)
            return Known(shape.name, 5.0)

        def from_poses(self, *_):
            return None

    options = Options(time_limit=model_selection.MIN_CLASS_TIME + 0.1)
    classes = model_selection.classes_of(["cuboid", "cylinder", "ellipsoid"])
    best = model_selection.likeliest_class(classes, Solver(), None, options)
    assert best.status == (
        "Solve_Succeeded, time limit reached: without the class cylinder, "
        "the class ellipsoid"
    )
    tried, *others = best.classes
    assert (tried.shape, tried.error) == ("cuboid", "")
    assert all("no time was left" in one.error for one in others)


@pytest.mark.slow
def test_a_class_far_behind_is_not_refined(touched):
    data, scene = touched.measurements, touched.scene
    solver = ClassSolver(data, scene, "violation_implicit", None, Session(), False)
    refined = solver.of_class(CYLINDER, None, None)
    left = solver.of_class(CYLINDER, None, None, refined.objective - 100.0)
    assert left.objective >= refined.objective - 1e-6
    assert {"still", "planar"} <= {s.name for s in refined.skipped}
    assert {s.name for s in left.skipped} <= {"rigid", "central", "aligned"}
    near = solver.of_class(CYLINDER, None, None, refined.objective + 1.0)
    assert near.objective == refined.objective


def test_two_classes_of_one_name_are_both_compared(monkeypatch):
    monkeypatch.setattr(model_selection, "evidence_of", lambda e, _: -e.objective)

    class Solver:
        def of_class(self, shape, options, start, to_beat):
            return Known(shape.name, 1.0 if shape.theta == 36 else 50.0)

        def from_poses(self, *_):
            return None

    classes = model_selection.classes_of([polytope(12), polytope(30)])
    best = model_selection.likeliest_class(classes, Solver(), None, LIMITED)
    assert best.objective == 1.0
    assert len(best.classes) == 2


def test_sizes_are_fitted_to_the_poses_of_another_class(recorded, estimate):
    data, scene, _ = recorded
    data = data.select(np.unique(estimate.measurements.action))
    request, _ = read_request(
        data, scene, "cuboid", "violation_implicit", None, None, None, Session()
    )
    found = body_on_poses(request.job, estimate)
    sides, known = np.sort(found.theta[:2]), np.sort(estimate.side_lengths[:2])
    sigma = estimate.information.sigma("side_lengths")[np.argsort(estimate.theta[:2])]
    assert (np.abs(sides - known) < np.maximum(0.5e-3, 1.1 * sigma)).all()
    assert found.objective < 10
    request, _ = read_request(
        data, scene, ELLIPSOID, "violation_implicit", None, None, None, Session()
    )
    assert body_on_poses(request.job, estimate).objective > 3 * found.objective


@pytest.mark.slow
def test_a_box_starts_from_the_poses_of_a_hull(touched):
    data, scene = touched.measurements, touched.scene
    hull = solve_estimate(data, scene, shape="polytope")
    solver = ClassSolver(data, scene, "violation_implicit", None, Session(), False)
    box = solver.from_poses(CUBOID, None, hull, np.inf)
    assert box.objective < touched.objective + 0.1
    assert box.origin.path == ("poses of a polytope",)
    assert solver.from_poses(CUBOID, None, hull, -1.0) is None


def test_a_start_is_given_to_every_class_that_it_fits(monkeypatch):
    monkeypatch.setattr(model_selection, "evidence_of", lambda e, _: -e.objective)
    given = {}

    class Solver:
        def of_class(self, shape, options, start, to_beat):
            given.setdefault(shape.name, start)
            return Known(shape.name, 1.0)

    guess = Guess(side_lengths=[0.04, 0.03, 0.05], position=[0.0, 0.0])
    classes = model_selection.classes_of(["cuboid", "cylinder", "polytope"])
    model_selection.likeliest_class(classes, Solver(), guess, LIMITED)
    assert given == {"cuboid": guess, "cylinder": None, "polytope": None}
    with pytest.raises(StartError, match="no class can start"):
        model_selection.likeliest_class(classes[1:], Solver(), guess, LIMITED)
    with pytest.raises(OptionError, match="start"):
        model_selection.likeliest_class(classes, Solver(), "nonsense", LIMITED)
