r"""The joint programme of eq:vimp: shape, every pose and every contact impulse.

    min  sum_t L_t(theta, x_t)                                  what was felt, eq:loss
       + sum_k |impulse balance_k|^2 / (2 sigma^2)              x_{t+1} = f(x_t, lam, r)
       + sum   complementarity + dissipation + inelasticity     g(x_t, lam, r), in nats
    s.t. lam_n >= 0,  |lam_t| <= mu lam_n,  ground gap >= 0
    over theta, x_k, lam_k

An impulse is compared with the weight over its time step, w = m g dt, and an energy
with the work of lifting the object by a millimetre: KAPPA nats each, so that mass and
time step cancel.

Departures from the printed equations, named:
  touch, between actions   see quasi_static.py; an object that still slides when an
                           action ends comes to rest further on
  dissipation              v_s lam_n mu |v_s| instead of lam_n |v_s|^2: the printed form
                           is no power, and is not zero where friction opposes sliding
  depth                    felt fingers sit a common, unknown way inside the surface
  offset                   of a finger from where it says, unknown: see finger_offset.py
  |v_s|, cone apex         rounded (STILL, ROUND), else no second derivative at rest
  complementarity          of a felt finger is the touch cost; of the ground in planar
                           motion it holds by construction, else lam_n z is an exact
                           penalty beside the hard z >= 0
  non-penetration          of the ground is a hard constraint; of a finger it is part of
                           the likelihoods of touch and free samples
  unfelt                   a finger that feels nothing hardly pushes: UNFELT, linear,
                           in place of dissipation
  rest                     an action starts at rest: all low corners on the ground
  least impulse            pins what contact leaves open (four corners share a load)

The terms of g are in finger_contact.py and ground_contact.py, cones in friction.py.
"""

from __future__ import annotations

from functools import partial

from . import balance, finger_contact, ground_contact, quasi_static
from .balance import Balance
from .finger_contact import FingerContact
from .finger_offset import displaced
from .friction import Impulses, cone, friction, impulses
from .ground_contact import GroundContact
from .level import Level
from .rigid_body import G

OFFSETS = True  # of fingers may be unknown
ALIKE = True  # functions of terms depend on page, shape, scene and motion
LEVELS = (
    Level(
        "impulses",
        {"cone rounding": 0.01, "speed rounding": 6e-3},
        fixed=("theta", "x"),
        ipopt={"mu_init": 1e-1},
    ),
    Level(
        "joint", ipopt={"mu_init": 1e-3, "max_iter": 400}, warm_start={"mu_init": 1e-5}
    ),
)
ROUGH = (  # from poses that are guessed, not solved: centimetres off where it tumbles
    LEVELS[0],
    Level(
        "loose",
        {
            "touch scale": 2e-3,
            "normal scale": 0.2,
            "gap scale": 5e-3,
            "kappa": 2.0,
            "balance sigma": 0.3,
        },
    ),
    Level(
        "firm",
        {
            "touch scale": 0.5e-3,
            "normal scale": 0.05,
            "kappa": 4.0,
            "balance sigma": 0.1,
        },
    ),
    LEVELS[1],
)

TOUCH = 0.15e-3  # [m] model error of a touched gap: soft contact, rounded edges
DEPTH = 0.05e-3  # [m] compliance and radius error, the same for all touches
NORMAL = 0.010  # [rad] model error of a normal, likewise
COASTING = partial(quasi_static.sense, coasts=True)  # momentum tells how fast it is
WEIGHTS = {  # parameters, each with its unit
    "kappa": (5.0, "nats/mm"),  # for an energy that lifts the object by 1 mm
    "speed rounding": (
        3e-3,
        "m/s",
    ),  # rounds the sliding speed: 0.1 mm in a step of 1/30 s
    "balance sigma": (0.03, "weights"),  # deviation of an impulse from balance
    "cone rounding": (0.003, "weights"),  # rounds the apex of the friction cone
}


def build(nlp, window, scene, shape):
    """Fill `nlp` with eq:vimp: what was felt, then the physics of every step."""
    window = displaced(nlp, window, scene)
    theta, x = felt(nlp, window, shape)
    physics(nlp, window, scene, shape, theta, x)


def felt(nlp, window, shape, sense=COASTING):
    """Declare theta and x; add what was felt, with the common depth of felt fingers."""
    depth = nlp.variable("depth", 1, guess=0.0, unit="m", scale=DEPTH)
    theta, x = sense(nlp, window, shape, TOUCH, NORMAL, depth)
    nlp.minimize(
        "depth prior", lambda depth: (depth / DEPTH) ** 2 / 2, depth, role="prior"
    )
    return theta, x


def physics(nlp, window, scene, shape, theta, x):
    """Declare impulses and friction; add the balance of every step, and g."""
    for name, (value, unit) in WEIGHTS.items():
        nlp.parameter(name, value, unit)
    w = scene.mass * G * window.step.dt  # (steps,) [N s]
    pushes, corners = impulses_of(nlp, window, scene, shape, w)
    fingers = FingerContact(shape, window.motion, window.finger)
    ground = GroundContact(shape, window.motion)
    law = Balance(fingers, ground, scene.gravity)
    balance.add(nlp, window, law, theta, x, w, pushes, corners)
    finger_contact.add(nlp, window, fingers, theta, x, pushes)
    ground_contact.add(nlp, window, ground, theta, x, corners)
    cone(nlp, "finger", pushes)
    cone(nlp, "ground", corners)


def impulses_of(nlp, window, scene, shape, w, share=None):
    """Declare impulses and friction of fingers and of the ground (friction.Impulses).

    w: weights of the steps; share: of the weight, that each ground contact carries at
    the start; by default all corners carry the same.
    """
    w_f, w_g = w[window.push.step], w[window.corner.step]
    size = w.mean() if len(w) else scene.mass * G
    share = 1 / max(1, len(shape.corners)) if share is None else share
    slips = window.frictionless
    lam = impulses(nlp, "finger", w_f, size, frictionless=slips)
    lam_g = impulses(nlp, "ground", w_g, size, w_g * share, frictionless=slips)
    mu = friction(nlp, "finger friction", scene.friction_finger)
    mu_g = friction(nlp, "ground friction", scene.friction_ground if len(w_g) else 0)
    return Impulses(lam, mu, w_f), Impulses(lam_g, mu_g, w_g)
