"""Shape.check: functions of a shape that disagree are named, with the remedy."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from formulations.shape import gradient_normal
from tactilenlp import CUBOID, CYLINDER, ELLIPSOID, prism
from tactilenlp.tracking.surface import body_surface


def no_distance(theta, q, small):
    """Zero on the ellipsoid, but no length outside."""
    return (ca.norm_2(2 * q / theta) - 1) * 10e-3


def shifted(theta, q, small):
    return CYLINDER.distance(theta, q - ca.DM([0, 0, 5e-3]), small)


def larger(theta):
    return 1.2 * CYLINDER.inertia(theta)


def inward(theta, q, small):
    return -CYLINDER.normal(theta, q, small)


def doubled(theta, q, small):
    return 2 * CYLINDER.normal(theta, q, small)


def failing(theta):
    return theta[2]


QUARTER = (
    (0, -1, 0),
    (1, 0, 0),
    (0, 0, 1),
)  # a turn that leaves the sizes where they are


def planes(theta, q, small):
    """The largest distance from a plane of a face of a cuboid, rounded."""
    z = ca.sqrt(q * q + (small / 10) ** 2) - theta / 2
    return ca.logsumexp(z * 5 / small) * small / 5


BROKEN = {
    "beyond edges": (
        replace(CUBOID, distance=planes, normal=gradient_normal(planes)),
        "larger than that to any plane",
    ),
    "size_prior": (replace(CYLINDER, size_prior=(0.04, -1.0)), "a standard deviation"),
    "bounds": (replace(CYLINDER, bounds=(0.4, 4e-3)), "least sizes first"),
    "10 mm out": (replace(ELLIPSOID, distance=no_distance), "nearest point"),
    "centroid": (replace(CYLINDER, distance=shifted), "shift q_of"),
    "inertia": (replace(CYLINDER, inertia=larger), "correct inertia"),
    "slope": (replace(CYLINDER, normal=inward), "gradient_normal"),
    "length of the normal": (replace(CYLINDER, normal=doubled), "divide normal"),
    "mesh's points": (replace(CYLINDER, mesh=prism(3).mesh), "correct mesh"),
    "extent of the mesh": (
        replace(CYLINDER, mesh=lambda theta: CYLINDER.mesh(theta)[:96]), "whole body",
    ),
    "rest_height": (
        replace(CYLINDER, rest_height=lambda theta: theta[1]), "correct rest_height",
    ),
    "corner": (
        replace(CYLINDER, corner=lambda theta, signs: 2 * signs * theta[0]),
        "correct corner",
    ),
    "reach": (replace(CYLINDER, reach=lambda theta: 0.01), "enclose"),
    "rest_height(...)": (replace(CYLINDER, rest_height=failing), "documentation"),
    "inertia(...)": (replace(CYLINDER, inertia=lambda theta: theta), "documentation"),
    "symmetry": (replace(CUBOID, symmetries=(((0, 1, 2), QUARTER),)), "leave it out"),
    "words": (replace(CYLINDER, words=("diameter",)), "give 2 words"),
    "bound": (replace(CYLINDER, bounds=((0.01,) * 3, 0.1)), "one number"),
}  # fmt: skip


@pytest.mark.parametrize(
    "shape", [CUBOID, CYLINDER, prism(3), prism(8), ELLIPSOID], ids=lambda s: s.name
)
def test_functions_of_shipped_shapes_agree(shape):
    report = shape.check()
    assert report.good, str(report)
    assert str(report) == f"{shape.name}: all functions agree at 3 theta"


@pytest.mark.parametrize("what", BROKEN)
def test_what_disagrees_is_named_with_the_remedy(what):
    shape, remedy = BROKEN[what]
    found = [d for d in shape.check(1).found if what in d.what]
    assert found, str(shape.check(1))
    assert remedy in found[0].next
    assert f"{found[0].what}: got {found[0].got}" in str(shape.check(1))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("corners", np.ma.masked_array(np.zeros((2, 3)))), ("size_prior", (0.05, 1j)),
        ("theta", 10**9), ("bounds", (0.0, np.nan)), ("distance", "far"),
        ("of_vertices", memoryview(b"sizes")), ("name", None), ("mirrored", 1),
        ("opposite_faces", True),
    ],
)  # fmt: skip
def test_a_plain_field_of_another_kind_is_named_before_casadi_sees_it(field, value):
    report = replace(CYLINDER, **{field: value}).check()
    assert [d.what for d in report.found] == [field]


def test_a_list_that_contains_itself_does_not_end_the_process():
    endless = [1.0]
    endless.append(endless)
    report = replace(CYLINDER, corners=(endless,)).check()
    assert [d.what for d in report.found] == ["corners"]


def test_a_mesh_may_be_a_matrix_of_casadi_and_its_size_is_checked():
    theta = [0.05, 0.04]
    matrix = replace(CYLINDER, mesh=lambda theta: ca.DM(CYLINDER.mesh(theta)))
    assert matrix.check().good, str(matrix.check())
    assert (body_surface(matrix, theta) == body_surface(CYLINDER, theta)).all()
    turned = replace(CYLINDER, mesh=lambda theta: ca.DM(CYLINDER.mesh(theta)).T)
    (told,) = turned.check().found
    assert told.what == "mesh(...)"
    assert told.expected == "finite numbers, (points, 3)"
