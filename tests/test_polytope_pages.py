"""The pages of polytopes: derivatives; the world moved; vertices and planes renamed."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from programmes import SENSORS, slid_octahedron, sums
from scipy.spatial.transform import Rotation

from formulations import (
    polytope_extension,
    polytope_planes,
    polytope_quasi_static,
    polytope_violation_implicit,
)
from formulations.polytope import polytope
from tactilenlp import Options
from tactilenlp.interface.request import make_job
from tactilenlp.nlp.problem import Problem
from tactilenlp.problem.hypothesis import Hypothesis
from tactilenlp.problem.polytope_window import hull_moments
from tactilenlp.search.plane_slam import Faces, as_measured, planes_window

SHAPE = polytope(8)
BUILDS = {
    "quasi_static": polytope_quasi_static.build,
    "violation_implicit": polytope_violation_implicit.build,
    "planes": polytope_planes.build,
    "extension": polytope_extension.build,
    "extension, pushed": polytope_extension.build_pushed,
}
PUSHED = "violation_implicit", "extension, pushed"
QUICK = [  # tracing the balance of a hull takes a second
    pytest.param(page, marks=pytest.mark.slow) if page in PUSHED else page
    for page in BUILDS
]
pytestmark = pytest.mark.usefixtures("not_compiled")


@pytest.fixture(scope="module")
def body():
    """An octahedron that slid: its poses are a little off, and so are its vertices.

    known (V, 3, V, 3): information about its vertices.
    """
    data, scene, vertices, x = slid_octahedron()
    rng = np.random.default_rng(4)
    x[:, :-1] += [[3e-4], [3e-4], [5e-3]] * rng.normal(size=(3, data.samples - 1))
    A = rng.normal(size=(24, 24)) / 1e-3
    return SimpleNamespace(
        data=data, scene=scene, vertices=vertices, x=x, renamed=np.arange,
        off=1e-4 * rng.normal(size=(8, 3)), known=(A @ A.T).reshape(8, 3, 8, 3),
    )  # fmt: skip


def posed(page, body, tangent=None):
    """Return the problem that a page makes of a body, its window, and the unknowns.

    body.renamed(n): order of vertices or planes; tangent: where t1 of pushes points.
    """
    job = make_job(body.data, body.scene, SHAPE, Options(), 0.0, polytope_quasi_static)
    job = replace(job, precision=SENSORS)
    if page == "planes":
        window = job.window()
        plane, n, b = as_measured(window, window.touch, body.x)
        order = body.renamed(len(b))
        faces = Faces(np.argsort(order)[plane], n[order], b[order], body.x)
        window, values = planes_window(window, faces), {"plane": np.c_[n, b][order].T}
    else:
        order = body.renamed(8)
        vertices = body.vertices[order]
        window = job.window((vertices.ravel(), body.x))
        values = {"theta": (vertices + body.off[order]).T}
    if page.startswith("extension"):
        first = np.count_nonzero(body.data.action == body.data.action[0])
        past = Hypothesis(vertices.ravel(), body.x[:, :first], 0.0, ())
        known = body.known[order][:, :, order]
        window = window.of_action(past, known.reshape(24, 24))
    if tangent is not None:
        window = replace(window, push=replace(window.push, tangent=tangent))
    problem = Problem()
    BUILDS[page](problem, window, body.scene, window.shape)
    if "body" in problem.variables:  # second moments that differ would turn with axes
        values["body"] = hull_moments(values["theta"].T, window.triangles)
    return problem, window, values | {"x": body.x[:, window.last]}


def with_impulses(problem, values):
    """Return unknowns with impulses inside the cone of friction, if there are any."""
    rng, values = np.random.default_rng(2), dict(values)
    for name in {"finger", "ground"} & {*problem.variables}:
        v = problem.variables[name]
        force = v.scale[:, None] * np.abs(rng.normal(size=v.columns))
        share = 0.1 * rng.normal(size=(2, v.columns))
        values[name] = np.vstack([force[:1], share * force[:1]])
    return values


def assert_same(here, there):
    for name in here:
        # Positions of 0.3 m, known to 1e-16 of that, are compared with 1e-4 m.
        assert there[name] == pytest.approx(here[name], rel=1e-8, abs=1e-8), name


@pytest.mark.slow
@pytest.mark.parametrize("page", BUILDS)
def test_every_term_has_the_derivatives_of_finite_differences(page, body):
    problem, _, values = posed(page, body)
    report = problem.check(with_impulses(problem, values))
    for name, errors in report.derivatives.items():
        # Edges are rounded over 0.03 mm, a thirtieth of the scale of which differences
        # take steps: their own error; a wrong derivative is off by its size.
        assert max(errors) < 1e-3, name
    assert report.assembled < 1e-3


@pytest.mark.parametrize("page", QUICK)
def test_moving_the_whole_world_over_the_ground_costs_nothing(page, body):
    spin, t = Rotation.from_euler("z", 0.8), np.array([0.3, -0.2, 0.0])
    S = spin.as_matrix()
    problem, window, values = posed(page, body)
    values = with_impulses(problem, values)
    there = SimpleNamespace(**vars(body))
    there.data = body.data.transformed(S, t)
    there.vertices, there.off = spin.apply(body.vertices), spin.apply(body.off)
    there.x = np.vstack([S[:2, :2] @ body.x[:2] + t[:2, None], body.x[2:]])
    there.known = np.einsum("ia,vawb,jb->viwj", S, body.known, S)
    moved, _, carried = posed(page, there, spin.apply(window.push.tangent))
    if "finger" in values:
        force = values["ground"][[1, 2, 0]]  # along x, y, z
        carried["ground"] = spin.apply(force.T).T[[2, 0, 1]]
        carried["finger"] = values["finger"]
    assert_same(sums(problem, values), sums(moved, carried))


@pytest.mark.parametrize("page", QUICK)
def test_the_order_of_vertices_and_planes_means_nothing(page, body):
    problem, window, values = posed(page, body)
    values, other = with_impulses(problem, values), SimpleNamespace(**vars(body))
    order = np.random.default_rng(6).permutation(8)
    other.renamed = lambda n: order if n == 8 else np.roll(np.arange(n), 1)
    renamed, window_2, there = posed(page, other)
    if "finger" in values:
        vertex = np.argsort(order)[window.corner_vertex]
        mine = np.lexsort((vertex, window.corner.step))
        its = np.lexsort((window_2.corner_vertex, window_2.corner.step))
        there["ground"] = np.empty_like(values["ground"])
        there["ground"][:, its] = values["ground"][:, mine]
        there["finger"] = values["finger"]
    assert_same(sums(problem, values), sums(renamed, there))
