r"""The joint problem of eq:vimp: shape, every pose and every contact impulse.

    min  sum_t L_t(theta, x_t)                     eq:loss (likelihood.py)
       + sum   way between actions                 between_actions.py
       + priors of theta, d                        size_prior.py, indentation.py
       + priors of mu, e_f, w_f, c, e_m            friction.py, finger_offset.py,
         (where unknown)                           finger_turn.py, indentation.py,
                                                   centre_of_mass.py
       + sum   (lam_n / w)^2 / (2 PUSH^2)          soft fingertips (indentation.py)
       + sum_k |x_{k+1} - f(x_k, lam_k, r_k)|^2    balance of every step (balance.py)
       + sum   g(x_k, lam_k, r_k)                  finger_contact.py, ground_contact.py
       + sum   LEAST |lam / w|^2                   least impulse (friction.py)
    s.t. lam_n >= 0,  |lam_t| <= mu lam_n          friction.py
         height of every corner >= 0               ground_contact.py
    over theta, x_k, lam_k, d; where unknown also mu, e_f, w_f, c, e_m

`add_physics` adds what follows the priors.  An impulse is compared with the weight over
its time step, w = m g dt, and an energy with the work of lifting the object by a
millimetre, which costs kappa nats: mass and time step cancel.

Departures from the printed equations:
  eq:loss, sliding on      see likelihood.py and between_actions.py
  dissipation              D of contact.py, zero where the rounded law of Coulomb holds,
                           instead of |v_s|^2 lam_n + v_s . lam_t: this is no power,
                           and not zero where friction opposes sliding
  inelasticity             no term: without it optima gain no energy either
  indentation              felt fingers sit inside the surface, the deeper the harder
                           they push where fingertips are soft: see indentation.py
  e_f, w_f                 offset of a finger, turn of its normals
  |v_s|, apex of the cone  rounded, or there is no second derivative at rest
  complementarity          of a felt finger is the touch cost; of the ground in planar
                           motion it holds by construction, else lam_n z is an exact
                           penalty beside the hard constraint z >= 0
  non-penetration          of the ground is a hard constraint; of a finger it is part of
                           the likelihoods of touch and free samples
  unfelt                   a finger that feels nothing has a linear cost on its impulse
                           (UNFELT) in place of dissipation
  unseen                   a finger whose sample is missing may push: dissipation,
                           complementarity of its gap, non-penetration; as hard as
                           before and after, where a change has a cost
  rest                     an action starts at rest: all low corners on the ground
  least impulse            makes unique how four corners share a load
"""

from __future__ import annotations

from . import balance, centre_of_mass, finger_contact, ground_contact, indentation
from .balance import Balance, Dynamics, contacts_of
from .between_actions import add_moved_on
from .finger_offset import displaced
from .finger_turn import with_normals_turned_back
from .friction import add_cone, contact_impulses
from .level import Level
from .likelihood import add_free, add_touches
from .names import FINGER, GROUND
from .rigid_body import declare_poses
from .size_prior import add_size_prior, declare_sizes

FREED = ("rigid", "central", "aligned", "planar", "level", "prompt")  # by evidence
OFFSETS = True  # of fingers may be unknown
ALIKE = True  # functions of terms depend on page, shape, scene and motion
LEVELS = (
    Level("impulses", {"cone rounding": 0.01, "speed rounding": 6e-3},
          fixed=("theta", "x"), ipopt={"mu_init": 1e-1}),
    Level("joint", ipopt={"mu_init": 1e-3, "max_iter": 1500},
          warm_start={"mu_init": 1e-5}),
)  # fmt: skip
ROUGH = (  # from guessed poses, which are centimetres off where the object tumbles
    LEVELS[0],
    Level("loose", {"touch scale": 2e-3, "normal scale": 0.2, "gap scale": 5e-3,
                    "kappa": 2.0, "balance sigma": 0.3}),
    Level("firm", {"touch scale": 0.5e-3, "normal scale": 0.05, "kappa": 4.0,
                   "balance sigma": 0.1}),
    LEVELS[1],
)  # fmt: skip

TOUCH = 0.15e-3  # [m] model error of a touched gap: soft contact, rounded edges
NORMAL = 0.010  # [rad] model error of a normal, likewise
WORK_COST = 5.0  # [nats/mm] kappa, for an energy that lifts the object by 1 mm
SPEED_ROUNDING = 3e-3  # [m/s] v_eps, of |v_s|: 0.1 mm in a step of 1/30 s
BALANCE_SIGMA = 0.03  # [weights] deviation of a step from balance
APEX_ROUNDING = 0.003  # [weights] rounds the apex of the friction cone


def build(nlp, window, scene, shape, law=Balance):
    """Fill `nlp` with eq:vimp: what was felt, then the physics of every step.

    law: the balance of a step, balance.Balance or a subclass of it.
    """
    window = displaced(nlp, window, scene)
    window = with_normals_turned_back(nlp, window)
    add_scales(nlp)
    w, pushes, corners = contact_impulses(nlp, window, scene, shape)
    delta = indentation.declare(nlp, window, scene, pushes)
    theta, x = declare_sizes(nlp, shape), declare_poses(nlp, window)
    add_touches(nlp, window, shape, theta, x, TOUCH, NORMAL, delta)
    add_free(nlp, window, shape, theta, x)
    add_moved_on(nlp, window, shape, theta, x)
    add_size_prior(nlp, shape, theta)
    indentation.add_prior(nlp, delta)
    centre = centre_of_mass.declare(nlp, window, scene, shape)
    law = law(*contacts_of(window, shape), scene.gravity)
    add_physics(nlp, window, law, Dynamics(theta, x, w, centre, pushes, corners))


def add_scales(nlp):
    """Declare the parameters of the physics: costs, deviations and roundings."""
    nlp.parameter("kappa", WORK_COST, "nats/mm")
    nlp.parameter("speed rounding", SPEED_ROUNDING, "m/s")
    nlp.parameter("balance sigma", BALANCE_SIGMA, "weights")
    nlp.parameter("cone rounding", APEX_ROUNDING, "weights")


def add_physics(nlp, window, law, dynamics, resting=None):
    """Add the balance of every step, g of fingers and ground, and the friction cones.

    law: a balance.Balance, dynamics: the balance.Dynamics that it reads; resting: see
    ground_contact.
    """
    theta, x, _, _, pushes, corners = dynamics
    balance.add(nlp, window, law, dynamics)
    finger_contact.add(nlp, window, law.fingers, theta, x, pushes)
    finger_contact.add_unseen(nlp, window, law.fingers, theta, x, pushes)
    ground_contact.add(nlp, window, law.ground, theta, x, corners, resting)
    add_cone(nlp, FINGER, pushes)
    add_cone(nlp, GROUND, corners)
