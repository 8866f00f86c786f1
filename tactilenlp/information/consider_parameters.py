r"""Consider parameters: what a page fixes and sigma includes the uncertainty of.

Quantities r (d,) are held where the page takes them, mostly at zero; what the data tell
of them is read from the solution, without another solve (consider covariance: S. F.
Schmidt, Advances in Control Systems 3, 1966).  With b how the gradient moves with r,

    dx/dr = -K^{-1} b,      I = 1 / deviation^2 + L_rr + b' dx/dr,      m = -I^{-1} L_r

are the sensitivity of the estimate, the information on r, and its mode.  The prior of r
is a spike and slab, exactly zero with odds o : 1, else Gaussian, so that

    E[r r'] = (I^{-1} + m m') / (1 + o deviation^d sqrt(det I) exp(-m' I m / 2)).

    rounded edges     r >= 0: radius of edges; a finger of radius rho feels the body
                      `shape.rounded(theta, r)` with rho + r
    soft fingertips   r >= 0: compliance; a touch sits deeper by r times its push
    late touches      r: further latency of contacts and normals; poses are r earlier
    late normals      r: further lag of normals alone
    radius            r: error of one finger's, o = 50; that of all is not observable
    presses on top    r: by how much harder soft fingertips press down, in weights
    ground tilt       r (2,): rotation about the ground's horizontal axes
                      (linearisation.py)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from formulations.indentation import COMPLIANCE_SIGMA, PUSH, told
from formulations.names import (
    COMPLIANCE,
    DEPTH_OF_TOUCH,
    FREE_TERM,
    LATE_NORMALS,
    LATE_TOUCHES,
    PRESSES,
    RADIUS_OF,
    ROUNDED_EDGES,
    SOFT_FINGERTIPS,
    TOUCH_TERM,
)

from ..data.contact_segments import CONTACT_LATENCY
from ..data.sensor_noise import LATENCY, NORMAL_LAG, normal_rates
from ..nlp.kkt import gradient
from ..problem.fingertips import moved
from .measurement_noise import at_touches, fingers_earlier

if TYPE_CHECKING:
    from .linearisation import Linearisation

LAG_STEP = 1e-5  # [s] change of a lag, of differences
RADIUS_STEP = 1e-5  # [m] change of the radius of edges, of differences
TOLD_RADIUS = 0.5e-3  # [m] deviation of a radius that was told wrong
TOLD_RIGHT = 50.0  # [-] odds that a radius was told right
COMPLIANCE_STEP = 1e-5  # [m] under one weight: change of a compliance, of differences
PRESS_STEP = 1e-3  # [weights] change of a press, of differences
EDGE = 2e-3  # [m] deviation of r: machined, printed and card boxes have up to 3 mm


class Prior(NamedTuple):
    """What is known of r (d,) before any touch, from where the page takes it.

    deviation of each component about the mean, between least and most; odds: how many
    times as likely r is exactly as it is taken, 0: it is not.
    """

    deviation: float
    mean: float | np.ndarray = 0.0
    least: float = 0.0
    most: float = np.inf
    odds: float = 1.0


class Considered(NamedTuple):
    """What the touches tell of a quantity that the page takes as given.

    mean: where it is likeliest, against that; sigma: its standard deviation; [m] of
    edges, radii, and of fingertips under one weight, [s] of late sensors; probability
    [-] that it is not so, 1 of a lag that was estimated: mean is what is left of it.
    """

    mean: float
    sigma: float
    probability: float


@dataclass(frozen=True, eq=False)
class ConsiderParameter:
    """What is known of quantities r (d,) from where the page takes them.

    slope (unknowns, d): derivative of the gradient by r; mean (d,), information (d, d)
    of r by touches and prior; odds: how many times as likely r is exactly there, 0 once
    it was estimated; besides: deviation that no data reduce.
    """

    slope: np.ndarray
    mean: np.ndarray
    information: np.ndarray
    odds: float
    besides: float = 0.0

    @property
    def gain(self) -> float:
        """By how many nats the likeliest r lowers the objective."""
        return float(self.mean @ self.information @ self.mean) / 2

    @property
    def considered(self) -> Considered:
        """What the touches tell of r of one component."""
        (mean,), ((information,),) = self.mean, self.information
        return Considered(mean, information**-0.5, 1 / (1 + self.odds))

    @property
    def squared(self) -> np.ndarray:
        """E[r r'] (d, d)."""
        second = np.linalg.inv(self.information) + np.outer(self.mean, self.mean)
        return second / (1 + self.odds) + self.besides**2 * np.eye(len(self.mean))

    def covariance(self, by_gradient, moved=0.0) -> np.ndarray:
        """Return the covariance (k, k) by it.

        by_gradient: see KKTSystem.sensitivity; moved (k, d): how the k numbers move
        with r at fixed unknowns.
        """
        moves = moved - by_gradient.T @ self.slope
        return moves @ self.squared @ moves.T


def scalars_of(linearisation: Linearisation) -> dict[str, ConsiderParameter]:
    """Return all of one component, by name; none without touches."""
    problem, window = linearisation.kkt.problem, linearisation.window
    job = linearisation.job
    if TOUCH_TERM not in problem.costs:
        return {}
    found = {
        LATE_NORMALS: late_normals(linearisation),
        LATE_TOUCHES: late_touches(linearisation),
    }
    if window.shape.rounded is not None:
        found[ROUNDED_EDGES] = rounded_edges(linearisation)
    if window.compliant and job.scene.ground is not None:
        found[PRESSES] = presses_on_top(linearisation)
    rigid = job.scene.compliance is None and not window.compliant
    if rigid and DEPTH_OF_TOUCH in problem.variables:
        found[SOFT_FINGERTIPS] = soft_fingertips(linearisation)
    for f in np.unique(window.touch.finger).tolist():
        found[f"{RADIUS_OF}{f}"] = told_radius(linearisation, f)
    return found


def rounded_edges(linearisation: Linearisation) -> ConsiderParameter:
    """Return what is known of the radius of edges."""
    kkt, window = linearisation.kkt, linearisation.window
    shape, touch, values = window.shape, window.touch, linearisation.values
    less = values | {"theta": shape.rounded(values["theta"], RADIUS_STEP)}
    low, high = (
        at_touches(window, v, touch.p_wf.T, lambda *at: at[2][0])
        for v in (less, values)
    )  # a body that lies on the ground is as high as it is large: the finger follows
    p_wf, theta = moved(touch.p_wf, low - high), kkt.problem.variables["theta"].span
    touch = replace(touch, p_wf=p_wf, radius=touch.radius + RADIUS_STEP)
    ends = ends_of(linearisation, replace(window, touch=touch))
    for (x, _), side in zip(ends, (1, 0, -1), strict=True):
        x[theta] = shape.rounded(x[theta], side * RADIUS_STEP)
    return _of_one(kkt, ends, RADIUS_STEP, Prior(EDGE))


def late_normals(linearisation: Linearisation) -> ConsiderParameter:
    """Return what is known of how late normals are, against the lag of the page.

    Sensors average normals for longer than contacts: these may be in time.
    """
    window, job = linearisation.window, linearisation.job
    touch, lag = window.touch, job.precision.normal_lag
    prior = Prior(NORMAL_LAG, mean=-lag, least=-lag, odds=float(not lag))
    rate = normal_rates(job.data)[touch.sample, touch.finger]
    normal = touch.normal + LAG_STEP * rate
    ends = ends_of(linearisation, replace(window, touch=replace(touch, normal=normal)))
    return _of_one(linearisation.kkt, ends, LAG_STEP, prior)


def late_touches(linearisation: Linearisation) -> ConsiderParameter:
    """Return what is known of the latency of touches against the one of the page.

    Contacts and normals that are reported r later are those of fingers and of a body r
    earlier.  One that was estimated is known to CONTACT_LATENCY: contacts are averaged.
    """
    job, latency = linearisation.job, linearisation.job.precision.latency
    prior, estimated = Prior(LATENCY), False
    if job.scene.latency is not None:
        prior = Prior(CONTACT_LATENCY, least=-latency, most=CONTACT_LATENCY, odds=0.0)
    elif latency > 0:
        prior = Prior(LATENCY, mean=-latency, least=-latency, most=LATENCY, odds=0.0)
        estimated = True
    earlier = fingers_earlier(linearisation.window, job.data, LAG_STEP)
    kkt, costs = linearisation.kkt, tuple(linearisation.kkt.problem.costs)
    ends = ends_of(linearisation, earlier, costs)
    lag = _of_one(kkt, ends, LAG_STEP, prior, costs)
    return replace(lag, besides=CONTACT_LATENCY * estimated)


def told_radius(linearisation: Linearisation, finger: int) -> ConsiderParameter:
    """Return what is known of the error of the radius that was told of a finger.

    By what is felt alone: points at which impulses act would move by no more than r.
    """
    kkt, window = linearisation.kkt, linearisation.window
    touch, free = (
        replace(rows, radius=rows.radius + RADIUS_STEP * (rows.finger == finger))
        for rows in (window.touch, window.free)
    )
    felt = tuple(n for n in (TOUCH_TERM, FREE_TERM) if n in kkt.problem.costs)
    ends = ends_of(linearisation, replace(window, touch=touch, free=free), felt)
    prior = Prior(TOLD_RADIUS, least=-np.inf, odds=TOLD_RIGHT)
    return _of_one(kkt, ends, RADIUS_STEP, prior, felt)


def soft_fingertips(linearisation: Linearisation) -> ConsiderParameter:
    """Return what is known of the compliance of fingertips, [m] under one weight.

    By the gaps alone: how hard a finger presses stays as it was found.
    """
    prior = Prior(COMPLIANCE_SIGMA)
    return _deeper(linearisation, linearisation.presses, COMPLIANCE_STEP, prior)


def presses_on_top(linearisation: Linearisation) -> ConsiderParameter:
    """Return what is known of how much harder soft fingertips press down, in weights.

    The ground carries it: no motion tells, and a solve finds the least.
    """
    values, scene = linearisation.values, linearisation.job.scene
    c = values[COMPLIANCE].item() if COMPLIANCE in values else told(scene)
    by_press = c * np.maximum(linearisation.window.touch.normal[:, 2], 0.0)
    return _deeper(linearisation, by_press, PRESS_STEP, Prior(PUSH, odds=0.0))


def _deeper(linearisation, depths, step: float, prior: Prior) -> ConsiderParameter:
    """Return what is known of r, where touches (touches,) sit deeper by r depths."""
    window, touch = linearisation.window, linearisation.window.touch
    softer = replace(window, touch=replace(touch, radius=touch.radius - step * depths))
    return _of_one(linearisation.kkt, ends_of(linearisation, softer), step, prior)


def derivatives(problem, ends, step: float, names=(TOUCH_TERM,)) -> tuple:
    """Return the derivatives of the touch cost by r, at 0.

    Of its gradient (unknowns,), its negative first and its second derivative; ends:
    unknowns and data at r = step, 0, -step.
    """
    costs = [sum(problem.value(n, *end).sum() for n in names) for end in ends]
    slopes = [gradient(problem, *end, names) for end in (ends[0], ends[2])]
    pull = (costs[2] - costs[0]) / (2 * step)
    bend = (costs[0] - 2 * costs[1] + costs[2]) / step**2
    return (slopes[0] - slopes[1]) / (2 * step), pull, bend


def ends_of(linearisation: Linearisation, changed, names=(TOUCH_TERM,)) -> list:
    """Return unknowns and data at r = step, 0, -step; changed: the window at a step.

    names: of the costs whose data change.
    """
    kkt, data = linearisation.kkt, linearisation.kkt.problem.data()
    other, change = linearisation.job.build(changed, only=names), np.zeros_like(data)
    now = other.data()
    for name in names:
        places = kkt.problem.costs[name].data
        change[places] = now[other.costs[name].data] - data[places]
    return [(kkt.x.copy(), kkt.data + side * change) for side in (1, 0, -1)]


def _of_one(kkt, ends, step, prior: Prior, names=(TOUCH_TERM,)) -> ConsiderParameter:
    """Return what the touches tell of one quantity; ends: at r = step, 0, -step."""
    b, pull, bend = derivatives(kkt.problem, ends, step, names)
    return by_derivatives(kkt, b[:, None], np.array([pull]), bend, prior)


def by_derivatives(kkt, slope, pull, bend, prior: Prior) -> ConsiderParameter:
    """Return what the touches tell of r (d,).

    By derivatives of the touch cost by r: slope (unknowns, d) of its gradient, pull
    (d,) its negative first, bend (d, d) its second one.  Where the objective does not
    bend upwards, a step to its least value has no end: touches tell nothing.
    """
    of_prior = 1 / prior.deviation**2
    by_touches = bend + slope.T @ np.stack([kkt.moved(b) for b in slope.T], axis=1)
    values, vectors = np.linalg.eigh((by_touches + by_touches.T) / 2)
    told = vectors @ np.diag(values > 0) @ vectors.T
    values = np.maximum(values, 0.0) + of_prior
    information = (vectors * values) @ vectors.T
    mean = np.linalg.solve(information, told @ pull + of_prior * prior.mean)
    mean = np.clip(mean, prior.least, prior.most)
    known = ConsiderParameter(slope, mean, information, prior.odds)
    share = prior.deviation ** len(mean) * np.sqrt(np.prod(values))
    return replace(known, odds=float(share * np.exp(-known.gain) * prior.odds))
