r"""Poses and shape with minimal motion, no impulses: the cheap first stage.

    min  sum_touch  -log( exp(-touch(phi) - |n - n_m|^2 / 2 sigma_n^2) + exp(-c_o) )
       + sum_free   -log( exp(-log(1 + exp(-alpha phi)))               + exp(-c_o) )
       + sum_gaps   2 log(1 + way^2 / gap^2)                (between actions)
       + sum_sizes  2 log(1 + (theta - mean)^2 / (2 deviation)^2)      (size prior)
       + sum_steps  weight (sqrt(way^2 + WAY_EPS^2) - WAY_EPS)  (least motion)
    over theta, x_k

The first four are what was felt and what was known: every page has them (`sense`).  The
last stands for quasi-static dissipation: an object that is pushed moves no more than it
must.

Departures from eq:loss, named: the touch cost is two-sided (a felt finger is on the
surface, not somewhere inside it), every sample's cost is bounded (a flipped boolean),
and a Cauchy link between actions stands for the unrecorded retraction of the fingers,
which mostly moves nothing and sometimes centimetres: its density in x, y and yaw.  A
finger that feels nothing at the next sample may have parted already: sigma of its gap
is wider by that way, that of its normal by the angle that it makes of the radius.
"""

from __future__ import annotations

import casadi as ca

from . import sensing
from .finger_offset import displaced
from .level import Level
from .rigid_body import ARM

OFFSETS = True  # of fingers may be unknown
ALIKE = True  # functions of terms depend on page, shape, scene and motion
LEVELS = (
    Level(
        "coarse",
        {
            "touch scale": 2e-3,
            "normal scale": 0.4,
            "alpha": 500.0,
            "gap scale": 5e-3,
            "motion weight": 100.0,
        },
    ),
    Level("fine"),
)

TOUCH = 0.3e-3  # [m] model error of a touched gap where motion is only least motion
NORMAL = 0.1  # [rad] model error of a normal, likewise
ALPHA = 1500.0  # [1/m] steepness of eq:bool
GAP = 0.5e-3  # [m] way of the object between actions
CAUCHY = 2  # power of its density in x, y and yaw
HEAVY = 1  # of a hull's, whose shape follows a wrong path: a heavier tail lets it leave
WAY_EPS = 0.3e-3  # [m] below this, motion is quadratic
WEIGHT = 300.0  # [nats / m] price of motion


def build(nlp, window, scene, shape):
    """Fill `nlp` with what was felt, and least motion."""
    window = displaced(nlp, window, scene)
    theta, x = sense(nlp, window, shape)
    least_motion(nlp, window, shape, theta, x)


def sense(nlp, window, shape, touch=TOUCH, normal=NORMAL, depth=0.0, coasts=False):
    """Declare theta and x; add what the fingers felt (eq:loss) and what was known.

    touch [m], normal [rad]: model errors of a sample, added to the sensors' own;
    depth [m], number or unknown: how deep every felt finger sits in the surface;
    coasts: whether poses tell how fast the object is when an action ends.
    """
    mean, deviation = shape.size_prior
    theta, x = declare(nlp, window, shape)
    likelihood(nlp, window, shape, (theta, theta), x, touch, normal, depth)
    link = coasting if coasts else between_actions
    link(nlp, window, shape, theta, x)
    nlp.minimize(
        "size prior",
        lambda theta: ca.sum1(sensing.heavy_tailed((theta - mean) / deviation)),
        theta,
        role="prior",
    )
    return theta, x


def likelihood(nlp, window, shape, theta, x, touch, normal, depth):
    """Add eq:loss of every sample.

    theta: of the body, or of the parts that (touches, free samples) see; the others as
    for `sense`.
    """
    motion, finger = window.motion, window.finger
    sigma_p, sigma_n = window.sigma_position, window.sigma_normal
    touch_scale = nlp.parameter("touch scale", ca.hypot(touch, sigma_p), "m")
    normal_scale = nlp.parameter("normal scale", ca.hypot(normal, sigma_n), "rad")
    alpha = nlp.parameter("alpha", 1 / ca.hypot(1 / ALPHA, sigma_p / 1.7), "1/m")

    def touching(theta, x, depth, p_wf, rho, n_m, latency, sigma, sigma_n):
        pose = motion.pose(shape, theta, x)
        phi = finger.gap(shape, theta, pose, p_wf, rho) + depth
        n = finger.felt(finger.normal(shape, theta, pose, p_wf, rho), p_wf)
        off, turned = ca.hypot(sigma, latency), ca.hypot(sigma_n, latency / rho)
        cost = sensing.touch(phi, off) + sensing.normal(n, n_m, turned)
        return sensing.mixture(cost, window.outlier_cost)

    def free(theta, x, p_wf, rho, alpha):
        pose = motion.pose(shape, theta, x)
        phi = finger.gap(shape, theta, pose, p_wf, rho)
        return sensing.mixture(sensing.free(phi, alpha), window.outlier_cost)

    t, f = window.touch, window.free
    nlp.minimize(
        "touch", touching, theta[0], x[:, t.pose], depth, t.p_wf, t.radius, t.normal,
        t.latency, touch_scale, normal_scale, role="likelihood",
    )  # fmt: skip
    nlp.minimize(
        "free", free, theta[1], x[:, f.pose], f.p_wf, f.radius, alpha,
        role="likelihood",
    )  # fmt: skip


def between_actions(nlp, window, shape, theta, x, power=CAUCHY):
    """Add the Cauchy link over the unrecorded retraction of the fingers."""
    motion, g = window.motion, window.gap
    gap_scale = nlp.parameter("gap scale", GAP, "m")

    def jumped(theta, x, x_1, gap):
        return power * ca.log(1 + way_squared(motion, shape, theta, x, x_1) / gap**2)

    nlp.minimize(
        "between actions", jumped, theta, x[:, g.pose], x[:, g.before], gap_scale,
        role="prior",
    )  # fmt: skip


def coasting(nlp, window, shape, theta, x):
    """Add the same link, of an object that slides on where it is not at rest.

    One that still slides at v when an action ends comes to rest v^2 / (2 mu g) further
    on: that much wider is the density.  Poses of least motion follow noisy fingers, and
    tell of no speed.
    """
    motion, g = window.motion, window.gap
    gap_scale = nlp.parameter("gap scale", GAP, "m")
    braking = window.braking + 0 * g.dt  # [m/s^2] of every gap

    def jumped(theta, x, x_1, x_2, dt, gap, braking):
        v_squared = way_squared(motion, shape, theta, x_1, x_2) / dt**2
        width_squared = gap**2 + (v_squared / (2 * braking)) ** 2
        way = way_squared(motion, shape, theta, x, x_1) / width_squared
        return CAUCHY * ca.log(1 + way) + 1.5 * ca.log(width_squared / gap**2)

    nlp.minimize(
        "between actions", jumped, theta, x[:, g.pose], x[:, g.before],
        x[:, g.before_2], g.dt, gap_scale, braking, role="prior",
    )  # fmt: skip


def least_motion(nlp, window, shape, theta, x):
    """Add the price of motion: an object that is pushed moves no more than it must."""
    weight = nlp.parameter("motion weight", WEIGHT, "nats/m")
    step = window.step

    def moved(theta, x, x_1, weight):
        way = way_squared(window.motion, shape, theta, x, x_1)
        return weight * (ca.sqrt(way + WAY_EPS**2) - WAY_EPS)

    nlp.minimize(
        "least motion", moved, theta, x[:, step.pose], x[:, step.before], weight,
        role="regulariser",
    )  # fmt: skip


def declare(nlp, window, shape):
    """Declare shape and poses: theta (n,) [m], x (unknowns, poses)."""
    motion, (low, high) = window.motion, shape.bounds
    theta = nlp.variable(
        "theta", shape.theta, lower=low, upper=high, guess=shape.size_prior[0],
        unit="m", scale=1e-3,
    )  # fmt: skip
    x = nlp.variable(
        "x", motion.unknowns, window.poses, guess=0.0, unit=motion.unit,
        scale=motion.scale,
    )  # fmt: skip
    return theta, x


def way_squared(motion, shape, theta, x, x_1):
    """Squared way of the body between two poses [m^2], a turn counted over ARM."""
    (p, R), (p_1, R_1) = (motion.pose(shape, theta, c) for c in (x, x_1))
    return ca.sumsqr(p - p_1) + ARM**2 * ca.sumsqr(R - R_1) / 2
