r"""Consider parameters: what a page takes as given, and sigma covers all the same.

A quantity r is held where the page takes it, mostly at zero; what the data tell of it
is read from the solution, without another solve (consider covariance: S. F. Schmidt,
Advances in Control Systems 3, 1966).  With b the derivative by r of the gradient,

    dx/dr = -K^{-1} b,      I = 1 / deviation^2 + L_rr + b . dx/dr,      m = -L_r / I

are how the estimate moves with r, what is known of r, and where it is likeliest.  r is
o times as likely none as Gaussian before any touch, so that

    E[r^2] = (1 / I + m^2) / (1 + o deviation sqrt(I) exp(-I m^2 / 2)).

Edges are assumed to be sharp.  With a radius r, common to all of them, what a finger of
radius rho feels is the body `shape.rounded(theta, r)`, grown by r: the touch cost of
that theta and of rho + r; r >= 0.  Touches of both edges and faces of a side tell
whether edges are sharp.  In the same way touches, and normals alone, are taken as of
their instant, or of a latency that was estimated before (newton_steps.py); r is
a lag of sensors.  Fingers r earlier give poses r earlier, which then move on with their
velocities.  The radius of a finger is mostly as it was told, o = 50; sigma allows for
another one where no body fits the touches of this finger and of the others as well.  A
radius that is wrong for all fingers alike, no touch tells.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from formulations.names import (
    FREE_TERM,
    LATE_NORMALS,
    LATE_TOUCHES,
    RADIUS_OF,
    ROUNDED_EDGES,
    TOUCH_TERM,
)

from ..data.contact_segments import consecutive_contacts, rate_of
from ..data.sensor_noise import CONTACT_LATENCY, LATENCY
from ..nlp.kkt import gradient
from .measurement_noise import at_touches

if TYPE_CHECKING:
    from .linearisation import Linearisation

LAG_STEP = 1e-5  # [s] change of a lag, of differences
AVERAGED = 10e-3  # [s] deviation of r of normals alone: means of up to 20 ms
RADIUS_STEP = 1e-5  # [m] change of the radius of edges, of differences
TOLD_RADIUS = 0.5e-3  # [m] deviation of a radius that was told wrong
TOLD_RIGHT = 50.0  # [-] odds that a radius was told right
EDGE = 2e-3  # [m] deviation of r: machined, printed and card boxes have up to 3 mm


class Prior(NamedTuple):
    """What is known of a quantity r before any touch, from where the page takes it.

    deviation about the mean, between least and most; none: how many times as likely r
    is exactly as it is taken, 0: it is not.
    """

    deviation: float
    mean: float = 0.0
    least: float = 0.0
    most: float = np.inf
    none: float = 1.0


class Considered(NamedTuple):
    """What the touches tell of a quantity that the page takes as given.

    mean: where it is likeliest, against that; sigma: its standard deviation; both in
    [m] of edges and radii, in [s] of late sensors; probability [-] that it is not as
    given.
    """

    mean: float
    sigma: float
    probability: float


@dataclass(frozen=True, eq=False)
class Doubt:
    """What is known of a quantity r from where the page takes it, mostly from zero.

    slope (unknowns,): derivative of the gradient by r; mean, information of r by data
    and prior; none: odds that r is exactly there, 0 once it was estimated; besides:
    deviation that no data reduce.
    """

    slope: np.ndarray
    mean: float
    information: float
    none: float
    besides: float = 0.0

    @property
    def gain(self) -> float:
        """By how many nats the likeliest r lowers the objective."""
        return self.information * self.mean**2 / 2

    @property
    def considered(self) -> Considered:
        """What the touches tell of r."""
        return Considered(self.mean, self.information**-0.5, 1 / (1 + self.none))

    @property
    def squared(self) -> float:
        """E[r^2]."""
        second = (1 / self.information + self.mean**2) / (1 + self.none)
        return second + self.besides**2

    def covariance(self, by_gradient, velocities=0.0) -> np.ndarray:
        """Return the covariance (k, k) by it.

        by_gradient: see KKTSystem.sensitivity; velocities (k,): how the k numbers move
        with r at fixed unknowns.
        """
        moves = velocities - by_gradient.T @ self.slope
        return self.squared * np.outer(moves, moves)


def doubts_of(linearisation: Linearisation) -> dict[str, Doubt]:
    """Return the doubts about consider parameters, by name; none without touches."""
    if TOUCH_TERM not in linearisation.kkt.problem.costs:
        return {}
    doubts = {
        LATE_NORMALS: late_normals(linearisation),
        LATE_TOUCHES: late_touches(linearisation),
    }
    if linearisation.window.shape.rounded is not None:
        doubts[ROUNDED_EDGES] = rounded_edges(linearisation)
    for f in np.unique(linearisation.window.touch.finger).tolist():
        doubts[f"{RADIUS_OF}{f}"] = told_radius(linearisation, f)
    return doubts


def rounded_edges(linearisation: Linearisation) -> Doubt:
    """Return the doubt about sharp edges."""
    kkt, window = linearisation.kkt, linearisation.window
    problem, shape, touch = kkt.problem, window.shape, window.touch
    values = linearisation.values
    less = values | {"theta": shape.rounded(values["theta"], RADIUS_STEP)}
    low, high = (
        at_touches(window, v, touch.p_wf.T, lambda *at: at[2][0])
        for v in (less, values)
    )  # a body that lies on the ground is as high as it is large: the finger follows
    p_wf = touch.p_wf.copy()
    p_wf[:, :3] += low - high
    touch = replace(touch, p_wf=p_wf, radius=touch.radius + RADIUS_STEP)
    grown = linearisation.job.build(replace(window, touch=touch)).data()
    grown = grown - problem.data()
    theta, ends = problem.variables["theta"].span, []
    for side in (1, 0, -1):
        x = kkt.x.copy()
        x[theta] = shape.rounded(x[theta], side * RADIUS_STEP)
        ends.append((x, kkt.data + side * grown))
    return _doubt_by(kkt, ends, RADIUS_STEP, Prior(EDGE))


def late_normals(linearisation: Linearisation) -> Doubt:
    """Return the doubt about normals of the instant.

    Sensors average normals for longer than contacts: these may be in time.
    """
    window, data = linearisation.window, linearisation.job.data
    touch = window.touch
    rate = rate_of(data, data.normal)
    rate[1:][~consecutive_contacts(data)] = 0.0
    normal = touch.normal + LAG_STEP * rate[touch.sample, touch.finger]
    later = replace(window, touch=replace(touch, normal=normal))
    ends = ends_of(linearisation, later)
    return _doubt_by(linearisation.kkt, ends, LAG_STEP, Prior(AVERAGED))


def late_touches(linearisation: Linearisation) -> Doubt:
    """Return the doubt about the latency of touches, told by the scene or estimated.

    Contacts and normals that are reported r later are those of fingers and of a body r
    earlier.  One that was estimated is known to CONTACT_LATENCY: contacts are averaged.
    """
    kkt, job = linearisation.kkt, linearisation.job
    latency = job.precision.latency
    prior, estimated = Prior(LATENCY), False
    if job.scene.latency is not None:
        prior = Prior(CONTACT_LATENCY, least=-latency, most=CONTACT_LATENCY, none=0.0)
    elif latency > 0:
        prior = Prior(LATENCY, mean=-latency, least=-latency, most=LATENCY, none=0.0)
        estimated = True
    shifted = fingers_earlier(linearisation.window, job.data, LAG_STEP)
    ends = ends_of(linearisation, shifted)
    doubt = _doubt_by(kkt, ends, LAG_STEP, prior, list(kkt.problem.costs))
    return replace(doubt, besides=CONTACT_LATENCY * estimated)


def told_radius(linearisation: Linearisation, finger: int) -> Doubt:
    """Return the doubt about the radius that was told of a finger.

    By what is felt alone: points at which impulses act would move by no more than r.
    """
    kkt, window = linearisation.kkt, linearisation.window

    def grown(rows):
        return replace(rows, radius=rows.radius + RADIUS_STEP * (rows.finger == finger))

    larger = replace(window, touch=grown(window.touch), free=grown(window.free))
    ends = ends_of(linearisation, larger)
    prior = Prior(TOLD_RADIUS, least=-np.inf, none=TOLD_RIGHT)
    felt = [n for n in (TOUCH_TERM, FREE_TERM) if n in kkt.problem.costs]
    return _doubt_by(kkt, ends, RADIUS_STEP, prior, felt)


def fingers_earlier(window, data, lag: float):
    """Return the window with all fingers where they were a lag [s] earlier.

    Ways within a sample stay: with slopes of slips by accelerations, which change where
    a finger sticks or slides, Newton steps on the latency end too early (21 of 33 ms).
    """
    rate = rate_of(data, data.finger_position)

    def earlier(rows, p_wf):
        p_wf = p_wf.copy()
        p_wf[:, :3] -= lag * rate[rows.sample, rows.finger]
        return p_wf

    return window.with_fingers(earlier)


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


def ends_of(linearisation: Linearisation, changed) -> list:
    """Return unknowns and data at r = step, 0, -step; changed: the window at a step."""
    kkt = linearisation.kkt
    change = linearisation.job.build(changed).data() - kkt.problem.data()
    return [(kkt.x, kkt.data + side * change) for side in (1, 0, -1)]


def _doubt_by(kkt, ends, step, prior: Prior, names=(TOUCH_TERM,)) -> Doubt:
    """Return what the touches tell of a quantity r; ends: at r = step, 0, -step."""
    b, pull, bend = derivatives(kkt.problem, ends, step, names)
    of_prior = 1 / prior.deviation**2
    information = of_prior + max(0.0, bend + b @ kkt.moved(b))
    mean = (pull + of_prior * prior.mean) / information
    mean = min(max(prior.least, mean), prior.most)
    odds = prior.deviation * np.sqrt(information)
    odds *= np.exp(-information * mean**2 / 2) * prior.none
    return Doubt(b, mean, information, odds)
