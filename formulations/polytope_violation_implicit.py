r"""The joint problem of eq:vimp for a convex polytope of unknown vertices.

    min  eq:loss, way between actions, priors of v_j, m, r  (polytope_quasi_static.py)
       + prior of d; where unknown of mu, w_f, c, e_m          (violation_implicit.py)
       + pushes of soft fingertips, balance of every step,
         g(x_k, lam_k, r_k), least impulse                     (violation_implicit.py)
    s.t. lam_n >= 0,  |lam_t| <= mu lam_n,  v_z >= 0,  height of every contact >= 0
         vol = sum vol_i,  vol centroid = sum first_i,
         vol Sigma = sum second_i                              (`mass`, polytope.py)
    over v_j, m, r, x_k, lam_k, d, and vol, centroid, Sigma;
         where unknown also mu, w_f, c, e_m

It differs from violation_implicit.py in three things:
  vertices   every contact reads the vertices near it, not all
  mass       the body's centroid and its second moments Sigma are unknowns of their own,
             tied to the vertices by sums over the hull's triangles (mass known, density
             uniform): an impulse balance then reads nine numbers of the body, not all
             vertices
  last pose  is held, in free motion as in planar: the vertices lie in a frame that is
             upright at the last sample.  Without a ground there are no ground contacts,
             no legs and no v_z >= 0

Which vertices a contact reads and which triangles the hull has follows from the start.
Before the last level they are determined again (`rebuild`): vertices inside the hull,
which no term reads, are first moved onto it.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from . import centre_of_mass, indentation, violation_implicit
from .balance import Balance, Dynamics, contacts_of
from .between_actions import HEAVY, add_fixed_width
from .finger_turn import with_normals_turned_back
from .friction import contact_impulses
from .level import Level
from .likelihood import add_free, add_touches
from .polytope import inertia_about, whole_moments
from .polytope_quasi_static import add_ball_prior, declare_vertices
from .rigid_body import MassProperties, declare_poses
from .violation_implicit import NORMAL, TOUCH, add_physics, add_scales

EXTENDS = True  # an estimate is extended by one action: polytope_extension.py
FREED = violation_implicit.FREED
ALIKE = True  # functions of terms depend on page, shape, scene and motion
LEVELS = (
    Level("loose", {"touch scale": 0.5e-3, "normal scale": 0.05, "kappa": 2.0,
                    "balance sigma": 0.3, "cone rounding": 0.01,
                    "speed rounding": 6e-3},
          ipopt={"mu_init": 1e-1, "max_iter": 60, "tol": 1e-3}),
    Level("joint", rebuild=True, ipopt={"mu_init": 1e-2}),
)  # fmt: skip
MOMENTS = ca.DM([1e-6] + 3 * [1e-8] + 6 * [1e-10])  # [m^3, m^4, m^5] scale of each


def build(nlp, window, scene, shape, prior=add_ball_prior):
    """Fill `nlp` with eq:vimp: what was felt, then the physics of every step.

    prior(nlp, window, shape, theta): adds what was known of the vertices before.
    """
    window = with_normals_turned_back(nlp, window)
    add_scales(nlp)
    share = window.weight_share
    w, pushes, corners = contact_impulses(nlp, window, scene, shape, share)
    delta = indentation.declare(nlp, window, scene, pushes)
    theta, x = declare_vertices(nlp, window), declare_poses(nlp, window)
    near_touch, near_free = theta[:, window.near_touch], theta[:, window.near_free]
    add_touches(nlp, window, shape, near_touch, x, TOUCH, NORMAL, delta)
    add_free(nlp, window, shape, near_free, x)
    add_fixed_width(nlp, window, shape, 0.0, x, HEAVY)
    prior(nlp, window, shape, theta)
    indentation.add_prior(nlp, delta)
    pushes = replace(pushes, theta=theta[:, window.near_push])
    corners = replace(corners, theta=theta[:, window.corner_vertex])
    body = mass(nlp, window, theta)
    law = Balance(*contacts_of(window, shape), scene.gravity, hull_body)
    resting = theta[:, window.rest_vertex]
    centre = centre_of_mass.declare(nlp, window, scene, shape)
    dynamics = Dynamics(body, x, w, centre, pushes, corners)
    add_physics(nlp, window, law, dynamics, resting)


def mass(nlp, window, theta):
    """Declare the body (10,): volume, centroid, second moments; tie it to theta.

    The moments are per volume, about the body's origin.
    """
    body = nlp.variable(
        "body", 10, guess=window.body, unit="m^3, m, m^2",
        scale=(1e-6, *3 * (1e-3,), *6 * (1e-5,)),
    )  # fmt: skip

    def untied(body, triangles):
        claimed = ca.vertcat(body[0], body[0] * body[1:])
        return (whole_moments(triangles) - claimed) / MOMENTS

    surface = theta[:, window.triangles.reshape(1, -1)]
    nlp.subject_to("mass", untied, body, surface, lower=0, upper=0)
    return body


def hull_body(shape, body):
    """Return the MassProperties of volume, centroid and second moments (10,)."""
    return MassProperties(body[1:4], inertia_about(body[1:4], body[4:10]))
