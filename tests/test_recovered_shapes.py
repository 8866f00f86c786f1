"""Shipped classes and the README's own class, from definition to recovered body."""

import re
import types
from dataclasses import replace
from xml.etree import ElementTree

import casadi as ca
import numpy as np
import pytest
import trimesh
from conftest import ROOT
from pushes import line

from formulations import quasi_static
from tactilenlp import (
    CUBOID,
    CYLINDER,
    ELLIPSOID,
    Guess,
    Scene,
    World,
    gradient_normal,
    prism,
    problem_of,
    solve_estimate,
)
from tactilenlp.errors import OptionError, StartError
from tactilenlp.local.comparison import same_body
from tactilenlp.output.summary import named_size
from tactilenlp.problem.hypothesis import Hypothesis
from tactilenlp.problem.pages import shape_of
from tactilenlp.search.proposals_floating import search_plane
from tactilenlp.tracking.geometry import geometry_of
from tactilenlp.tracking.initial_states import from_guess
from tactilenlp.tracking.surface import body_surface

SCENE = Scene(mass=0.5, friction_ground=0.3, friction_finger=0.5)


def own_class():
    """The class of shapes of formulations/README.md, and how many lines it takes."""
    text = (ROOT / "formulations/README.md").read_text(encoding="utf-8")
    code = re.findall(r"^```python\n(.*?)^```", text, re.S | re.M)[-1]
    page = types.ModuleType("own")
    exec(code.partition("data = ")[0], page.__dict__)
    return page.TABLET, len(code.splitlines())


def touched(shape, theta):
    """A world whose body was pushed from two sides and touched on the top."""
    world = World(vertices=body_surface(shape, theta), position=(0.004, -0.003))
    away = [-0.2, 0.0, 0.1]
    for angle in (0.4, 2.3):
        out = np.array([np.cos(angle), np.sin(angle)])
        ends = ([*(world.pose[:2] + way * out), 0.02] for way in (0.075, 0.012))
        world.execute(line(tuple(ends), (away, away)))
    top = [*world.pose[:2], 2 * world.pose[2] + 0.0095]
    world.execute(line(([*top[:2], 0.1], top), (away, away)))
    return world


@pytest.mark.slow
@pytest.mark.parametrize("shape", [CYLINDER, prism(6)], ids=lambda s: s.name)
def test_a_body_is_recovered_from_simulated_touches_with_default_options(
    shape, tmp_path
):
    theta = np.array([0.045, 0.038])
    world = touched(shape, theta)
    estimate = solve_estimate(world.measurements, SCENE, shape=shape)
    sigma = np.sqrt(np.diag(estimate.information.covariance_matrix))[:2]
    # 24 random bodies: across within 1.7 mm and two sigma, height within 0.1 mm.
    assert (np.abs(estimate.theta - theta) < [2e-3, 0.3e-3]).all()
    assert (np.abs(estimate.theta - theta) < 3 * sigma).all()
    off = estimate.position[-1] - world.truth.object_position[-1]
    assert np.linalg.norm(off) < 1.5e-3
    assert f"{shape.words[0]} {1e3 * estimate.theta[0]:.2f} ±" in estimate.summary()
    estimate.export(tmp_path / "body.urdf")
    told = ElementTree.parse(tmp_path / "body.urdf").find(".//inertia").attrib
    exact = SCENE.mass * np.diag(shape.inertia(ca.DM(estimate.theta)).full())
    # 96 points of a rim lack 0.07 % of the area.
    assert float(told["izz"]) == pytest.approx(exact[2], rel=2e-3)
    assert float(told["ixx"]) == pytest.approx(exact[0], rel=2e-3)


def test_a_class_of_ones_own_takes_forty_lines_to_a_right_mesh():
    tablet, lines = own_class()
    assert lines <= 40
    assert tablet.check().good
    theta = np.array([0.055, 0.03])
    mesh = trimesh.convex.convex_hull(body_surface(tablet, theta))
    r, h = (theta[0] - theta[1]) / 2, theta[1] / 2
    volume = 2 * np.pi * (h * r**2 + np.pi * h**2 * r / 2 + 2 * h**3 / 3)
    # Facets between the points of the surface cut off about 1 %.
    assert 0.98 * volume < mesh.volume < volume
    inertia = np.diag(tablet.inertia(ca.DM(theta)).full())
    np.testing.assert_allclose(
        np.diag(mesh.moment_inertia) / mesh.volume, inertia, rtol=0.015
    )


def as_cylinder(theta):
    return ca.vertcat(theta[0], theta[0] * theta[1])


ASPECT = replace(
    CYLINDER, name="disc", words=("diameter", "aspect"), units=("m", "1"),
    bounds=((4e-3, 0.1), (0.4, 5.0)), size_prior=((0.045, 1.0), (0.02, 0.5)),
    distance=lambda theta, q, s: CYLINDER.distance(as_cylinder(theta), q, s),
    normal=lambda theta, q, s: CYLINDER.normal(as_cylinder(theta), q, s),
    corner=lambda theta, signs: CYLINDER.corner(as_cylinder(theta), signs),
    rest_height=lambda theta: theta[0] * theta[1] / 2,
    inertia=lambda theta: CYLINDER.inertia(as_cylinder(theta)),
    reach=lambda theta: CYLINDER.reach(as_cylinder(ca.DM(theta))),
    mesh=None, rounded=None, quantities=(),
)  # fmt: skip


def test_sizes_have_names_units_bounds_and_priors_of_their_own(recorded):
    data, scene, _ = recorded
    assert ASPECT.check(1).good, str(ASPECT.check(1))
    problem = problem_of(data.select([0]), scene, quasi_static, shape=ASPECT)
    theta = problem.variables["theta"]
    assert theta.unit == "m, 1"
    assert theta.guess.ravel().tolist() == [0.045, 1.0]
    assert theta.lower.ravel().tolist() == [4e-3, 0.1]
    assert theta.scale.tolist() == [1e-3, 1e-2]
    assert ASPECT.names == ("diameter", "aspect [1]")
    assert " ".join(named_size("aspect [1]", 1.2, 0.02)) == "aspect 1.20 ± 0.02 1"
    assert " ".join(named_size("diameter", 0.04, 1e-3)) == "diameter 40.00 ± 1.00 mm"


def test_a_page_of_planar_motion_refuses_a_body_that_rolls(recorded):
    data, scene, _ = recorded
    with pytest.raises(OptionError, match="rolls"):
        problem_of(data, scene, "shooting", shape=ELLIPSOID)


def test_a_floating_body_of_two_sizes_is_searched_below_its_guess(recorded):
    job = types.SimpleNamespace(shape=CYLINDER, data=recorded[0])
    plane = search_plane(job, Guess((0.05, 0.04), (0.0, 0.0, 0.1)))
    assert plane.height == pytest.approx(0.08)


def test_a_guess_is_as_uncertain_as_the_units_of_its_class_say():
    """Three sizes need not be sides: an angle of a prior of 1 rad is not off by mm."""
    wedge = replace(
        ELLIPSOID,
        name="wedge",
        units=("m", "m", "rad"),
        size_prior=(0.045, (0.02, 0.02, 1.0)),
    )
    guess = np.array([0.05, 0.04, 0.5, 0.0, 0.0, 0.0])
    z, P = from_guess(guess, geometry_of(wedge), np.random.default_rng(0))
    assert np.sqrt(P[2, 2, 0]) == pytest.approx(50 * np.sqrt(P[0, 0, 0]))
    assert z[2].std() == pytest.approx(0.3, rel=0.1)


def test_shipped_classes_are_found_by_the_name_of_their_estimates():
    for shape in (CYLINDER, ELLIPSOID, prism(7)):
        assert shape_of(shape.name) is shape


@pytest.mark.parametrize("shape", [CYLINDER, prism(6), ELLIPSOID], ids=lambda s: s.name)
def test_two_hypotheses_are_one_body_whatever_its_axes_are_called(shape):
    theta = np.array([0.05, 0.04, 0.045])[: shape.theta]
    x = np.tile([[0.01], [0.02], [0.3]], 5)
    one = Hypothesis(theta, x, 0.0, ())
    turn = {2: np.pi / 3, 3: np.pi}[shape.theta]
    again = Hypothesis(theta, np.add(x, [[0], [0], [turn]]), 0.0, ())
    assert same_body(shape, one, again)
    other = Hypothesis(theta, np.add(x, [[0.002], [0], [0]]), 0.0, ())
    assert not same_body(shape, one, other)
    w = np.outer([0, 0, 1], x[2])
    height = np.full(5, float(shape.rest_height(theta)))
    free = Hypothesis(theta, np.vstack([x[:2], height, w]), 0.0, ())
    assert same_body(shape, one, free)


EDGE = 3e-3  # [m] radius of the edges of a box


def rounded_distance(theta, q, small):
    return CUBOID.distance(theta - 2 * EDGE, q, small) - EDGE


@pytest.mark.slow
def test_a_box_with_rounded_edges_is_named_and_told_by_its_faces_as_a_cuboid(recorded):
    rounded = replace(
        CUBOID, name="rounded box", distance=rounded_distance, opposite_faces=True,
        normal=gradient_normal(rounded_distance), rounded=None,
        corner=lambda theta, s: CUBOID.corner(theta - 2 * EDGE * ca.DM([1, 1, 0]), s),
    )  # fmt: skip
    assert rounded.check(1).good, str(rounded.check(1))
    data, scene, _ = recorded
    estimate = solve_estimate(data.select([0, 1, 2]), scene, shape=rounded)
    assert estimate.side_lengths[0] > estimate.side_lengths[1]
    assert estimate.rotation(0)[0, 0] > 0
    assert estimate.origin.path[0] in ("track", "middle")
    told = estimate.information.unobserved
    assert told
    assert all("face" in words for words in told)


@pytest.mark.slow
def test_a_class_with_bounds_and_priors_of_its_own_is_estimated(recorded):
    data, scene, _ = recorded
    estimate = solve_estimate(data.select([0, 1]), scene, shape=ASPECT, throw=False)
    assert estimate.success
    low, high = np.array(ASPECT.bounds)
    assert ((low <= estimate.theta) & (estimate.theta <= high)).all()
    sigma = np.sqrt(np.diag(estimate.information.covariance_matrix))[: ASPECT.theta]
    assert (sigma < np.array(ASPECT.size_prior[1])).all()
    with pytest.raises(StartError, match="too large"):
        solve_estimate(data, scene, shape=ASPECT, start=Guess((0.05, 6.0), (0, 0)))
