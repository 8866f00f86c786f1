"""One balance of impulse and momentum, for a box, for a hull, at rest and in motion."""

import casadi as ca
import numpy as np
import pytest
import trimesh

from formulations.balance import Balance
from formulations.finger import SPHERE
from formulations.finger_contact import FingerContact, Push
from formulations.ground_contact import Corner, GroundContact
from formulations.polytope import polytope, whole_moments
from formulations.polytope_violation_implicit import hull_body
from formulations.rigid_body import FREE, PLANAR, G, Step
from formulations.shape import CUBOID

SIDES, MASS, DT = np.array([0.05, 0.04, 0.03]), 0.4, 1 / 30
W = MASS * G * DT
SIGNS = 2.0 * np.indices((2, 2, 2)).reshape(3, 8).T - 1


def law(shape, motion=FREE, **body):
    fingers = FingerContact(shape, motion, SPHERE)
    return Balance(fingers, GroundContact(shape, motion), G, **body)


def unbalanced(law, theta, poses, contacts, centre=0.0):
    x, x_1, x_2 = poses
    out = law.unbalanced(Step(theta, x, x_1, DT, W, x_2), centre, contacts)
    return [np.asarray(ca.evalf(o)).ravel() for o in out]


def hull(offset):
    """Return the vertices of the box about `offset`, and its body (10,)."""
    vertices = SIGNS * SIDES / 2 + offset
    surface = trimesh.convex.convex_hull(vertices).triangles.ravel()
    moments = np.asarray(whole_moments(ca.DM(surface))).ravel()
    return vertices, np.r_[moments[0], moments[1:] / moments[0]]


def test_a_box_at_rest_on_its_corners_is_balanced():
    share = [Corner(None, ca.DM([W / 4, 0, 0]), ca.DM(s)) for s in CUBOID.corners]
    poses = [ca.DM([0.1, 0.2, 0.3])] * 3
    force, moment = unbalanced(law(CUBOID, PLANAR), ca.DM(SIDES), poses, share)
    np.testing.assert_allclose(force, 0, atol=1e-12 * W)
    np.testing.assert_allclose(moment, 0, atol=1e-12 * W)


def test_a_centre_of_mass_off_the_centroid_shifts_the_load_between_corners():
    off = np.array([0.2, -0.1, 0.3]) * SIDES
    share = [
        Corner(None, ca.DM([W / 4 * load, 0, 0]), ca.DM(s))
        for s in CUBOID.corners
        for load in [np.prod(1 + 4 * off[:2] / SIDES[:2] * np.array(s)[:2] / 2)]
    ]
    poses = [ca.DM([0.1, 0.2, 0.3])] * 3
    body = law(CUBOID, PLANAR)
    force, moment = unbalanced(body, ca.DM(SIDES), poses, share, ca.DM(off))
    np.testing.assert_allclose(force, 0, atol=1e-12 * W)
    np.testing.assert_allclose(moment, 0, atol=1e-12 * W)


def test_without_contacts_what_is_missing_is_the_weight():
    poses = [ca.DM([0, 0, 0.1, 0.1, 0.2, 0.3])] * 3
    force, moment = unbalanced(law(CUBOID), ca.DM(SIDES), poses, [])
    np.testing.assert_allclose(force, [0, 0, W], rtol=1e-12)
    np.testing.assert_allclose(moment, 0, atol=1e-15)


@pytest.mark.parametrize("offset", [[0, 0, 0], [0.01, -0.02, 0.03]])
def test_a_box_and_the_hull_of_its_corners_have_one_balance(offset):
    """The hull's origin lies elsewhere in the body: its pose makes up for that."""
    rng = np.random.default_rng(2)
    vertices, body = hull(offset)
    lam, push = (
        ca.DM(W * rng.normal(size=(8, 3)).T),
        ca.DM([0.7 * W, 0.1 * W, -0.2 * W]),
    )
    of_box = [Corner(None, lam[:, i], ca.DM(SIGNS[i])) for i in range(8)]
    of_hull = [Corner(ca.DM(vertices[i]), lam[:, i], None) for i in range(8)]
    at, t = ca.DM([0.06, 0.002, 0.101]), ca.DM([0, 0, 1])
    of_box.append(Push(None, push, at, 0.01, t))
    of_hull.append(Push(ca.DM(vertices.ravel()), push, at, 0.01, t))
    x = [np.r_[0, 0, 0.1, 0, 0, 0] + 2e-3 * rng.normal(size=6) for _ in range(3)]
    moved = [np.r_[v[:3] - rotated(v[3:], offset), v[3:]] for v in x]
    box = unbalanced(law(CUBOID), ca.DM(SIDES), [ca.DM(v) for v in x], of_box)
    shape = polytope(8)
    same = unbalanced(
        law(shape, body=hull_body), ca.DM(body), [ca.DM(v) for v in moved], of_hull
    )
    # Edges are rounded a little differently: the finger's contact is 0.1 mm off.
    np.testing.assert_allclose(same[0], box[0], atol=2e-3 * W)
    np.testing.assert_allclose(same[1], box[1], atol=2e-4 * W)
    without = [
        unbalanced(law(CUBOID), ca.DM(SIDES), [ca.DM(v) for v in x], of_box[:-1]),
        unbalanced(
            law(shape, body=hull_body), ca.DM(body), [ca.DM(v) for v in moved],
            of_hull[:-1],
        ),
    ]  # fmt: skip
    np.testing.assert_allclose(without[1][0], without[0][0], atol=1e-9 * W)
    np.testing.assert_allclose(without[1][1], without[0][1], atol=1e-9 * W)


def rotated(w, v):
    return np.asarray(FREE.pose(CUBOID, None, ca.DM(np.r_[0, 0, 0, w]))[1]) @ v
