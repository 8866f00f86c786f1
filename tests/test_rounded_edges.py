"""Edges that are not sharp: how a cuboid grows, and what an estimate says of it."""

from dataclasses import replace

import numpy as np
import pytest

from formulations import indentation, violation_implicit
from formulations.balance import Dynamics, contacts_of
from formulations.between_actions import add_moved_on
from formulations.friction import contact_impulses
from formulations.likelihood import add_free, add_touches
from formulations.rigid_body import declare_poses
from formulations.shape import CUBOID
from formulations.size_prior import add_size_prior, declare_sizes
from tactilenlp import Problem, SolverOptions
from tactilenlp.information.linearisation import Linearisation
from tactilenlp.nlp.kkt import kkt_system_of
from tactilenlp.solvers.solve import solve

SIDES = np.array([0.04, 0.05, 0.06])
SMALL = 1e-5  # [m] rounding of the distance itself


def rounded(r):
    """Return the cuboid whose edges have the radius r [m]."""
    return replace(
        CUBOID,
        distance=lambda theta, q, s: CUBOID.distance(theta - 2 * r, q, s) - r,
        normal=lambda theta, q, s: CUBOID.normal(theta - 2 * r, q, s),
    )


def test_a_cuboid_with_rounded_edges_has_the_same_faces_and_is_smaller_at_edges():
    r = 2e-3
    inner = CUBOID.rounded(SIDES, r)
    face, edge = np.array([0.03, 0.0, 0.0]), np.array([0.03, 0.035, 0.0])

    def gap(theta, q, grown):
        return float(CUBOID.distance(theta, q, SMALL)) - grown

    assert gap(inner, face, r) == pytest.approx(gap(SIDES, face, 0), abs=1e-5)
    further = (np.sqrt(2) - 1) * r
    assert gap(inner, edge, r) - gap(SIDES, edge, 0) == pytest.approx(further, abs=1e-5)


@pytest.mark.slow
def test_the_error_by_edges_is_how_the_optimum_moves_with_their_radius(
    estimate, programme
):
    scene, window = estimate.scene, programme.window
    kkt = kkt_system_of(programme.problem, programme.solution)
    at = Linearisation(kkt, programme.job, window)
    theta = kkt.problem.variables["theta"].span
    chosen = np.arange(theta.start, theta.stop)
    by_gradient, _ = kkt.sensitivity(chosen)
    told = at.consider_parameters["rounded edges"].covariance(by_gradient)
    told = np.sqrt(np.diag(told))

    def optimum(r):
        """Return theta where fingers feel rounded edges; physics as it was."""
        problem = Problem()
        shape = rounded(r)
        violation_implicit.add_scales(problem)
        w, pushes, corners = contact_impulses(problem, window, scene, CUBOID)
        delta = indentation.declare(problem, window, scene, pushes)
        x = declare_sizes(problem, shape), declare_poses(problem, window)
        noise = violation_implicit.TOUCH, violation_implicit.NORMAL
        add_touches(problem, window, shape, *x, *noise, delta)
        add_free(problem, window, shape, *x)
        add_moved_on(problem, window, shape, *x)
        add_size_prior(problem, shape, x[0])
        indentation.add_prior(problem, delta)
        fingers, ground = contacts_of(window, CUBOID)
        law = violation_implicit.Balance(fingers, ground, scene.gravity)
        dynamics = Dynamics(*x, w, 0.0, pushes, corners)
        violation_implicit.add_physics(problem, window, law, dynamics)
        values = kkt.problem.unpack(kkt.x)
        found = solve(problem, SolverOptions(ipopt={"mu_init": 1e-7}), start=values)
        assert found.success
        return found.values["theta"][:, 0]

    step = 2e-5
    moved = np.abs(optimum(step) - optimum(0.0)) / step
    assert np.abs(optimum(0.0) - estimate.side_lengths).max() < 1e-6
    assert told / told.max() == pytest.approx(moved / moved.max(), abs=0.05)
