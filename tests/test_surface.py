"""The surface of a class of shapes of one's own, from its distance."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from formulations.shape import CUBOID
from tactilenlp.errors import TactileError
from tactilenlp.problem.poses import body_corners
from tactilenlp.tracking.surface import body_surface

AXES = np.array([0.06, 0.04, 0.05])  # [m]


def distance(theta, q, small):
    h = theta / 2
    size, slope = ca.norm_2(q / h), ca.norm_2(q / h**2)
    return size * (size - 1) / slope


def foot(theta, signs):
    return signs * theta * ca.DM([0.05, 0.05, 0.5])


def round_distance(theta, q, small):
    """An upright cylinder, theta = diameter and height."""
    return ca.fmax(ca.norm_2(q[:2]) - theta[0] / 2, ca.fabs(q[2]) - theta[1] / 2)


# A copy of CUBOID with another distance keeps neither its corners nor its faces.
ELLIPSOID = replace(CUBOID, name="ellipsoid", distance=distance, corner=foot)
CYLINDER = replace(CUBOID, name="cylinder", theta=2, distance=round_distance)


def test_surface_of_ellipsoid_is_where_its_distance_is_zero():
    points = body_surface(ELLIPSOID, AXES)
    on = np.linalg.norm(points / (AXES / 2), axis=1)
    np.testing.assert_allclose(on, 1, atol=1e-9)
    # Facets of 642 points cut off about 1 % of a round body; its feet span 2 % of it.
    volume = np.pi / 6 * AXES.prod()
    assert 0.985 * volume < ConvexHull(points).volume < volume
    np.testing.assert_allclose(np.ptp(points, axis=0), AXES, rtol=0.01)


def test_surface_of_two_unknowns_is_the_cylinder():
    points = body_surface(CYLINDER, np.array([0.05, 0.08]))
    radius = np.hypot(*points.T[:2])
    flush = np.isclose(radius, 0.025, atol=1e-9)
    capped = np.isclose(abs(points[:, 2]), 0.04, atol=1e-9)
    assert (flush | capped).all()
    assert flush.any()
    assert capped.any()


def test_surface_of_cuboid_is_its_corners_to_the_last_digit():
    assert np.array_equal(body_surface(CUBOID, AXES), body_corners(CUBOID, AXES))


def test_distance_without_zero_is_refused_with_what_to_correct():
    outside = replace(ELLIPSOID, distance=lambda theta, q, small: 1 + ca.norm_2(q))
    with pytest.raises(TactileError, match="correct distance or reach"):
        body_surface(outside, AXES)


def test_a_copy_of_the_cuboid_with_another_distance_is_no_box():
    assert CUBOID.faced
    assert not ELLIPSOID.faced
    assert ELLIPSOID.mesh is None
    assert replace(CUBOID, size_prior=(0.05, 0.02)).faced
