"""How many vertices a polytope has is told by the evidence."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
from programmes import octahedron
from scipy.spatial import ConvexHull
from scipy.special import gammaln

import tactilenlp
from formulations import polytope_violation_implicit
from formulations.page_contract import contract_of
from formulations.polytope import COUNTS, polytope
from tactilenlp import Options, Scene, solve_estimate, surface_distance
from tactilenlp.common.deadline import NEVER, Deadline
from tactilenlp.geometry.simplification import with_counts
from tactilenlp.information.mixture import (
    occam_factor,
    occam_of_hull,
    occam_of_vertices,
)
from tactilenlp.interface.request import make_job
from tactilenlp.local.local_solve import built_page
from tactilenlp.local.solved import Solves
from tactilenlp.nlp.diagnostics import check
from tactilenlp.problem.hypothesis import Hypothesis
from tactilenlp.problem.polytope_window import VERTICES_READ
from tactilenlp.problem.reductions import Reductions
from tactilenlp.refinement import refinement
from tactilenlp.search import vertex_number
from tactilenlp.search.polytope_init import search_polytope
from tactilenlp.search.vertex_number import likeliest_fits

CUBE = 0.02 * np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
PRIOR = 1 / 0.005**2  # [1/m^2]


def kkt_of(shares) -> SimpleNamespace:
    """Return what is known of vertices of which these shares of the variance are left.

    shares (V,): of all three coordinates of a vertex.
    """
    each = np.repeat(shares, 3)
    prior = sp.diags(np.full(len(each), PRIOR)).tocsc()
    costs = {"ball prior": "prior"}
    theta = SimpleNamespace(span=slice(0, len(each)))
    return SimpleNamespace(
        problem=SimpleNamespace(
            costs_of=lambda *roles: [name for name in costs if costs[name] in roles],
            variables={"theta": theta},
        ),
        hessian=lambda names: len([*names]) * prior,
        marginal=lambda _: np.diag(each / PRIOR),
    )


def orders(coordinates: int, told: bool) -> float:
    """Return what evidence gains by the orders of vertices, all told or none [nats]."""
    prior = PRIOR * np.eye(coordinates)
    covariance = (1e-12 if told else 1.0) * np.linalg.inv(prior)
    lost, _ = occam_factor(covariance, prior)
    return lost - occam_of_vertices(covariance, prior)


def test_vertices_that_no_touch_tells_cost_nothing():
    assert occam_of_hull(kkt_of([1.0] * 20)) == pytest.approx(0.0, abs=1e-9)
    few, many = kkt_of([1e-4] * 4), kkt_of([1e-4] * 4 + [1.0] * 16)
    # More vertices can take the places of those that are told.
    more = gammaln(21) - gammaln(17) - gammaln(5)
    gain = occam_of_hull(few) - occam_of_hull(many)
    assert gain == pytest.approx(more, abs=0.01)


def test_a_vertex_costs_its_volume_and_gains_the_orders_of_the_list():
    # Ten times as exact along each axis; 6 of 6 vertices can be listed in 720 ways.
    six = kkt_of([1e-2] * 6)
    assert occam_of_hull(six) == pytest.approx(18 * np.log(10) - np.log(720), abs=1)
    assert orders(18, told=True) == pytest.approx(np.log(720))
    assert orders(60, told=False) == 0.0


def test_hulls_of_fewer_vertices_lie_in_those_of_more():
    rng = np.random.default_rng(3)
    points = rng.normal(size=(60, 3))
    points /= 50 * np.linalg.norm(points, axis=1, keepdims=True)
    hulls = with_counts(points, sorted(COUNTS, reverse=True))
    assert [len(V) for V in hulls] == sorted(COUNTS, reverse=True)
    volume = [ConvexHull(V).volume for V in hulls]
    assert volume == sorted(volume, reverse=True)
    for more, fewer in pairwise(hulls):
        assert (np.linalg.norm(fewer[:, None] - more, axis=2).min(axis=1) < 1e-12).all()


def test_each_tried_hull_has_fewer_vertices_than_the_one_before():
    counts = sorted(COUNTS, reverse=True)
    assert [len(V) for V in with_counts(CUBE, counts)] == [8, 6, 4]
    assert [len(V) for V in with_counts(CUBE[:7], counts)] == [8, 6, 4]


def fitted_by(monkeypatch, fit):
    """Let fit(count) replace the fits of hulls by the quasi-static page."""
    start = fit_of(0.0, 0.0).at
    monkeypatch.setattr(vertex_number, "starts_of", lambda *_: [start])
    fits = "with_fewer_vertices"
    monkeypatch.setattr(vertex_number, fits, lambda job, _, counts: map(fit, counts))


def fit_of(cost: float, occam: float, count: int = 4) -> SimpleNamespace:
    """Return a fit of a hull, as far as evidence reads it."""
    at = Hypothesis(np.zeros(3 * count), np.zeros((3, 1)), cost, ())
    return SimpleNamespace(cost=cost, occam=occam, at=at)


def job_of(counts, deadline=NEVER) -> SimpleNamespace:
    """Return a job of which counts, a deadline and one sample's action are told."""
    shape, data = replace(polytope(), counts=(*counts,)), SimpleNamespace(action=[0])
    return SimpleNamespace(deadline=deadline, shape=shape, data=data)


def test_fewer_vertices_than_fit_are_not_tried(monkeypatch):
    asked = []

    def fit(count):
        asked.append(count)
        return fit_of(5.0 if count >= 8 else 900.0, 4.0 * count, count)

    fitted_by(monkeypatch, fit)
    best, *_ = likeliest_fits(job_of(COUNTS), ["hull"])
    assert best.objective == 5.0 + 4.0 * 8
    assert asked == [20, 16, 12, 10, 8, 6]


def test_time_that_ends_leaves_the_bodies_fitted_by_then(monkeypatch):
    asked = []

    def fit(count):
        asked.append(count)
        return fit_of(cost=5.0, occam=1.0)

    fitted_by(monkeypatch, fit)
    over = Deadline.within(0.0)
    assert len(likeliest_fits(job_of(COUNTS, over), ["hull"])) == 1
    assert asked == [20]
    assert over.omitted == ["other numbers of vertices"]


def test_a_fit_that_diverged_is_the_last_and_is_not_linearised(monkeypatch):
    class Diverged:
        cost, at = np.nan, fit_of(np.nan, 0.0, 20).at

        @property
        def occam(self):
            raise np.linalg.LinAlgError

    def fit(count):
        return Diverged() if count == 20 else fit_of(5.0, float(count), count)

    fitted_by(monkeypatch, fit)
    found = likeliest_fits(job_of([20, 8, 6]), ["hull"])
    assert [h.theta.size // 3 for h in found] == [6, 8]
    assert len(likeliest_fits(job_of([20]), ["hull"])) == 1


def test_the_page_is_solved_from_a_body_that_gains_more_evidence_than_it_fits_worse(
    monkeypatch,
):
    """Six vertices fit 20 nats worse than sixteen, whose volume costs 30 more."""
    fits = {16: fit_of(200.0, 50.0, 16), 6: fit_of(220.0, 20.0, 6)}
    fitted_by(monkeypatch, fits.get)
    bodies = likeliest_fits(job_of([16, 6]), ["hull"])
    assert [h.theta.size // 3 for h in bodies] == [6, 16]
    solved, page = [], polytope_violation_implicit
    given = {"reductions": Reductions(), "contract": contract_of(page), "page": page}
    job = SimpleNamespace(shape=polytope(), scene=Scene(), **given)

    def multistart(job, hypotheses, *_):
        solved.extend(hypotheses)
        raise KeyboardInterrupt

    monkeypatch.setattr(refinement, "multistart", multistart)
    with pytest.raises(KeyboardInterrupt):
        refinement.solve_from_hypotheses(job, bodies, Solves())
    assert [h.theta.size // 3 for h in solved] == [6, 16]


def test_a_start_that_touches_contradict_more_than_a_fit_costs_is_left_out(monkeypatch):
    asked = []

    def fits(job, start, counts):
        asked.append(start.objective)
        return [fit_of(5.0, 1.0)]

    starts = [replace(fit_of(0.0, 0.0).at, objective=c) for c in (0.0, 5.9, 6.1)]
    monkeypatch.setattr(vertex_number, "starts_of", lambda *_: starts)
    monkeypatch.setattr(vertex_number, "with_fewer_vertices", fits)
    likeliest_fits(job_of([4]), ["hull"])
    assert asked == [0.0, 5.9]


def test_fits_end_where_they_come_to_a_known_body(monkeypatch):
    """A second hull leads to the cube as well, a third one to another body."""
    asked, bodies = [], (CUBE, CUBE.copy(), 1.1 * CUBE)

    def fits(job, start, counts):
        for corners in (start.theta, CUBE[:4]):
            asked.append(start)
            fit = fit_of(5.0, 1.0)
            fit.at = replace(fit.at, theta=corners.ravel())
            yield fit

    starts = [replace(fit_of(0.0, 0.0).at, theta=V) for V in bodies]
    monkeypatch.setattr(vertex_number, "starts_of", lambda *_: starts)
    monkeypatch.setattr(vertex_number, "with_fewer_vertices", fits)
    likeliest_fits(job_of([8, 4]), ["hull"])
    assert [starts.index(one) for one in asked] == [0, 0, 1, 2, 2]


def test_a_fixed_number_of_vertices_is_kept_and_none_is_compared_afloat():
    assert polytope(30).counts == ()
    assert polytope(30).theta == 90
    assert polytope().counts == COUNTS
    assert max(COUNTS) == polytope().theta // 3
    assert tactilenlp.polytope() == polytope()
    assert tactilenlp.polytope(4) == polytope(4)


@pytest.fixture(scope="module")
def shipped():
    return octahedron(9)  # all of its actions


@pytest.mark.slow
def test_an_octahedron_has_six_vertices(shipped):
    data, scene, body = shipped
    estimate = solve_estimate(data, scene, shape="polytope")
    assert estimate.success
    assert len(estimate.vertices) in (6, 8)
    twenty = solve_estimate(data, scene, shape=polytope(20))
    near, far = (surface_distance(e.mesh(), body).mean for e in (estimate, twenty))
    assert near < min(0.8e-3, far)  # 0.61 and 0.76 mm
    assert estimate.vertices.size == len(estimate.information.names)
    first = data.select(np.unique(data.action)[:-1])
    early = solve_estimate(first, scene, shape="polytope")
    later = solve_estimate(data, scene, shape="polytope", start=early)
    assert later.objective < estimate.objective + 3.0  # [nats]


@pytest.mark.slow
def test_a_tetrahedron_has_the_derivatives_of_every_polytope(shipped):
    data, scene = shipped[0].select([0, 1]), shipped[1]
    job = make_job(
        data, scene, polytope(4), Options(), 0.0, polytope_violation_implicit
    )
    job = replace(job, deadline=NEVER)
    h, *_ = search_polytope(replace(job, reductions=Reductions()), [])
    built = built_page(job, h)
    assert built.window.near_touch.shape[1] == VERTICES_READ
    report = check(built.problem, built.values_at(h))
    # Kinks of the nearest point leave 1e-4; what counts doubled vertices wrong is off
    # by its own size.
    assert max(max(pair) for pair in report.derivatives.values()) < 1e-3
