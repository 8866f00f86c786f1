"""A cuboid page against brute force: distance, normal, inertia, corners."""

import itertools
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from solid import RHO, angle, around, solid_distance, solid_normal

from formulations.finger import SPHERE
from formulations.rigid_body import FREE, PLANAR
from formulations.shape import CUBOID

# The solid is rounded by a tenth of a fingertip: gaps are right to a thirtieth of a
# millimetre and normals to half a degree wherever a fingertip can be.
GAP, ANGLE = 0.03e-3, np.radians(0.5)


def cuboid_functions(small=RHO / 10):
    """Return distance and normal (theta, q) of the page, as numbers."""
    theta, q = ca.SX.sym("theta", 3), ca.SX.sym("q", 3)
    out = [CUBOID.distance(theta, q, small), CUBOID.normal(theta, q, small)]
    return ca.Function("cuboid", [theta, q], out)


@pytest.mark.parametrize("distance", [0.9 * RHO, 1.2 * RHO, 5 * RHO])
def test_gap_and_normal_are_those_of_the_solid_at_faces_edges_and_corners(distance):
    rng, half = np.random.default_rng(0), np.array([0.02, 0.03, 0.015])
    q = around(half, rng, distance)
    phi, n = cuboid_functions().map(len(q))(2 * half, q.T)
    exact = solid_distance(half, q)
    assert exact.min() > 0.7 * RHO
    assert np.abs(np.asarray(phi).ravel() - exact).max() < GAP
    assert angle(np.asarray(n).T, solid_normal(half, q)).max() < ANGLE


def test_a_finger_that_sank_in_reads_its_depth_and_the_nearest_face():
    rng, half = np.random.default_rng(1), np.array([0.02, 0.03, 0.015])
    q = half * rng.uniform(-1, 1, (2000, 3))
    d = np.sort(np.abs(q) - half, axis=1)
    inside, next_face = -d[:, 2], -d[:, 1]
    q = q[(inside > 2e-3) & (inside < 4e-3) & (next_face > 12e-3)]
    assert len(q) > 50
    phi, n = cuboid_functions().map(len(q))(2 * half, q.T)
    # Rounding takes S(d) - d = (small / 5)^2 / (4 d) from each of depths above 2 mm;
    # the log-sum-exp adds exp(-8) of a millimetre a face.
    exact = solid_distance(half, q)
    assert np.abs(np.asarray(phi).ravel() - exact).max() < 0.03e-3
    # S(d) ~ 1 / d of the next face turns the normal by (4 / 12)^3 at most.
    assert angle(np.asarray(n).T, solid_normal(half, q)).max() < np.radians(3)


def test_a_thin_plate_keeps_its_faces():
    half = np.array([0.03, 0.02, 0.002])
    q = np.array([[0, 0, 0.012], [0.01, -0.01, -0.012], [0.04, 0, 0.0]])
    phi, n = cuboid_functions().map(3)(2 * half, q.T)
    # |q| is rounded over a tenth of `small`, 0.1 mm: nothing is left of it at 2 mm.
    assert np.asarray(phi).ravel() == pytest.approx([0.01] * 3, abs=0.01e-3)
    np.testing.assert_allclose(
        np.asarray(n).T, [[0, 0, 1], [0, 0, -1], [1, 0, 0]], atol=2e-3
    )


@pytest.mark.parametrize("motion", [PLANAR, FREE], ids=["planar", "free"])
def test_gap_is_zero_when_a_fingertip_touches_a_face(motion):
    theta = np.array([0.04, 0.06, 0.05])
    x = np.array([0.1, -0.2, 0.7])
    R = Rotation.from_euler("z", 0.7)
    if motion is FREE:
        R = Rotation.from_rotvec([0.3, -0.5, 0.7])
        x = np.r_[0.1, -0.2, 0.3, R.as_rotvec()]
    centre = np.array([0.1, -0.2, 0.025 if motion is PLANAR else 0.3])
    for axis, side in itertools.product(range(3), (-1, 1)):
        out = side * np.eye(3)[axis]
        p_wf = centre + R.apply(out * (theta / 2 + RHO))
        pose = motion.pose(CUBOID, ca.DM(theta), ca.DM(x))
        gap = SPHERE.gap(CUBOID, ca.DM(theta), pose, ca.DM(p_wf), RHO)
        normal = SPHERE.normal(CUBOID, ca.DM(theta), pose, ca.DM(p_wf), RHO)
        assert float(gap) == pytest.approx(0, abs=5e-6)  # rounded by S(d) - d = 1 um
        np.testing.assert_allclose(np.asarray(normal).ravel(), R.apply(out), atol=1e-3)


def test_inertia_is_that_of_the_solid():
    theta = np.array([0.04, 0.06, 0.05])
    box = trimesh.creation.box(theta)
    exact = box.moment_inertia / box.volume
    inertia = np.asarray(ca.densify(CUBOID.inertia(ca.DM(theta))))
    np.testing.assert_allclose(inertia, exact, atol=1e-12)


def test_a_cuboid_at_rest_stands_on_its_corners():
    theta = ca.DM([0.04, 0.06, 0.05])
    p, R = PLANAR.pose(CUBOID, theta, ca.DM([0.1, 0.2, 0.3]))
    for signs in CUBOID.corners:
        corner = p + R @ CUBOID.corner(theta, ca.DM(signs))
        assert float(corner[2]) == pytest.approx(0, abs=1e-15)


def test_lists_and_arrays_of_a_shape_are_kept_as_tuples():
    """Functions are kept by shape, which has a hash therefore."""
    told = {"size_prior": (np.full(3, 0.05), [0.02] * 3), "bounds": [4e-3, 0.4]}
    shape = replace(CUBOID, **told, corners=[list(c) for c in CUBOID.corners])
    assert shape.size_prior == ((0.05,) * 3, (0.02,) * 3)
    assert hash(shape) != hash(CUBOID)
    assert shape.corners == CUBOID.corners
    assert shape.typical_size == pytest.approx(0.05)
