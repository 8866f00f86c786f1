"""What widens a hull's sigma, and which fingers it does not ask: by hand."""

from dataclasses import dataclass
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import nnls

from tactilenlp.geometry.convex_hull import SIGMA_INSIDE, Ball
from tactilenlp.information.error_budget_terms import (
    STICKING,
    shape_prior_error,
    slips,
    stick_slip,
)
from tactilenlp.nlp.kkt import kkt_system_of
from tactilenlp.nlp.problem import Problem
from tactilenlp.problem.polytope_window import (
    CLEAR_LENGTHS,
    vertices_near,
    without_clear,
)
from tactilenlp.problem.window import Pushes, Samples, Steps
from tactilenlp.solvers.solve import solve

RADIUS = 0.01


@dataclass(frozen=True)
class Free:
    """As much of a window as free fingers need."""

    free: Samples
    sigma_position: float = 0.0


def felt(p_wf, normal, finger=0):
    """Return one touch a sample of a finger at p_wf (n, 3)."""
    n = len(p_wf)
    normal = np.broadcast_to(np.asarray(normal, float), (n, 3))
    own = np.full(n, finger)
    radius, still = np.full(n, RADIUS), np.zeros(n)
    return Samples(np.arange(n), own, np.arange(n), p_wf, radius, normal, still)


def test_a_finger_that_slides_may_have_taken_the_body_along():
    slip = 3e-3
    problem = Problem()
    theta = problem.variable("theta", 1, guess=0.0, unit="m", scale=1.0)
    x = problem.variable("x", 3, columns=2, guess=0.0, unit="m, m, rad", scale=1.0)
    problem.minimize(  # a face is touched before the slide, and never again
        "touch", lambda t, x: 1e4 * ((t + x[0]) ** 2 + ca.sumsqr(x[1:])), theta,
        x[:, [0]], role="likelihood",
    )  # fmt: skip
    problem.minimize(
        "friction", lambda x, y: 1e3 * ca.sumsqr(x - y), x[:, [1]], x[:, [0]],
        role="physics",
    )  # fmt: skip
    problem.minimize("last", lambda x: 1e8 * ca.sumsqr(x), x[:, [1]], role="prior")
    at = np.array([[0.0, 0.0, 0.02]])
    push = Pushes(
        np.array([1]), np.array([0]), np.array([0]), np.array([0]),
        at + np.array([slip, 0, 0]), at, np.array([RADIUS]), np.array([[0, 1, 0]]),
    )  # fmt: skip
    one = np.array([1])
    step = Steps(one, one, 0 * one, 0 * one, np.ones(1), np.ones(1), np.zeros((1, 3)))
    window = SimpleNamespace(push=push, step=step, last=np.arange(2))
    kkt = kkt_system_of(problem, solve(problem))
    assert slips(kkt, window) == pytest.approx(np.array([[slip, 0]]))
    by_gradient, _ = kkt.sensitivity(np.array([0]))
    found = stick_slip(kkt, by_gradient, window, np.zeros(2, int)).item()
    assert found == pytest.approx(STICKING * slip**2, rel=1e-3)


def test_a_finger_far_from_the_hull_is_not_asked():
    cube = 0.02 * (np.indices((2, 2, 2)).reshape(3, 8).T - [0.5, 0.5, 0])
    reach = 0.01 + RADIUS + CLEAR_LENGTHS / 1500 * np.array([0.5, 0.99, 1.01, 3.0])
    p = np.stack([reach, 0 * reach, np.full(4, 0.01)], axis=1)
    free = felt(p, [0, 0, 0])
    whole = Free(free)
    left = without_clear(whole, cube, np.zeros((3, 4))).free
    assert left.sample.tolist() == [0, 1]
    assert np.log1p(np.exp(-1500 * (reach[2] - 0.01 - RADIUS))) < 1e-8


def test_a_finger_on_a_large_face_reads_the_corners_around_it():
    box = (np.indices((2, 2, 2)).reshape(3, 8).T - 0.5) * [0.1, 0.03, 0.03]
    crowd = box[4:] - [1e-3, 0, 0]  # at one end of the box, eight of its corners
    vertices = np.vstack([box, crowd, box[4:] - [2e-3, 0, 0]])
    touch = felt(np.array([[0.045, 0.015 + RADIUS, 0.0]]), [0, 1, 0])
    read = vertices[vertices_near(touch, vertices, np.zeros((3, 1)))[0]]
    point = [0.045, 0.015, 0.0]
    _, off = nnls(np.vstack([read.T, np.ones(len(read))]), [*point, 1])
    assert off < 1e-9  # it is a mean of what is read


def test_caps_of_a_ball_turn_with_the_points_that_were_felt():
    ball = Ball(np.array([0.01, 0.02, 0.03]), 0.04)
    points = np.random.default_rng(0).normal(size=(5, 3))
    c, s = np.cos(0.7), np.sin(0.7)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    turned = Ball(R @ ball.centre, ball.radius).caps(points @ R.T)
    caps = ball.caps(points)
    assert turned == pytest.approx(np.c_[caps[:, :3] @ R.T, caps[:, 3]])


@pytest.mark.parametrize("price", [0.0, 1e12], ids=["unseen", "touched"])
def test_a_vertex_that_nothing_holds_is_as_uncertain_as_the_ball(price):
    problem, ball = Problem(), np.array([0, 0, 0.03, 0.03])
    at = ball[:3] + 0.03 * np.array([[0, 0, 1], [1, 0, 0], [0, -1, 0]])
    theta = problem.variable("theta", 3, 3, guess=at.T, unit="m", scale=1e-3)
    held = problem.variable("ball", 4, guess=ball, unit="m", scale=1e-3)
    for name, cost, *of in (
        ("stay", lambda v, v_0: 1e4 * ca.sumsqr(v - v_0), theta, at),
        ("ball prior", lambda b: 1e4 * ca.sumsqr(b - ball), held),
        ("touch", lambda v: price * (v[2] - 0.06) ** 2, theta[:, [0]]),
    ):
        problem.minimize(name, cost, *of, role="prior")
    kkt = kkt_system_of(problem, solve(problem))
    by_gradient, _ = kkt.sensitivity(np.arange(9))
    C = shape_prior_error(kkt, by_gradient)
    top = 0.0 if price else SIGMA_INSIDE * 0.03
    assert np.sqrt(np.diag(C)[[2, 3, 7]]) == pytest.approx(
        [top, SIGMA_INSIDE * 0.03, SIGMA_INSIDE * 0.03], abs=1e-6
    )
    assert C[3, 7] < 0  # outward of both means x of one and -y of the other
