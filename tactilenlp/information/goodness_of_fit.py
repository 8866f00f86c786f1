r"""Goodness of fit: what the likelihood terms cost at the solution, and should cost.

A touched sample costs touch(phi / sigma) + |n - n_m|^2 / (2 sigma_n^2), bounded by the
outlier cost (likelihood.py of the pages).  Under the noise model its gap and the two
components of its normal are Gaussian; mean and variance of the cost follow by Gauss
quadrature.  Where sensors are noisy, a touched sample without a touched neighbour in
time is most likely a wrong boolean, and costs the bound.  Where the noise of normals is
estimated, its error is common to all touches.  A finger that comes straight to a touch,
or leaves one, has a gap between how far it is from where it was felt, and how far it is
at the sample next to that, d_2 and d_1:

    E = (Phi(d_2) - Phi(d_1)) / (d_2 - d_1),      Phi' = log(1 + exp(-alpha d)).

How late a touch is noticed is not modelled: the spread is at least this expected cost.

Between actions the page's density of the way u, in x, y and yaw and in units of a
scale, is (1 + u^2)^-2, so that the cost 2 log(1 + u^2) has

    E = 2 (psi(2) - psi(1/2)) = 4.77,      Var = 4 (psi'(1/2) - psi'(2)) = 17.2  nats

and here the scale is the geometric mean of the page's own and of all other ways, and as
far as the body may have moved on (`moved_between`).  Two rows are judged that are no
part of the total, and make a fit "poor" at most: "between actions", the largest of
these costs, and "physics", all terms of that role.  On the true path physics costs what
steps make in which a touch begins or ends, 1 +- 1 nat for each finger in an action;
soft contacts creep, with them it is not judged.  A body that moved by more than LOST
between two actions, farther than that, was carried or its path is lost: at most "poor".

The verdict is "good" up to POOR spreads and MARGIN nats of excess, "bad" beyond BAD
times the sum of spread and MARGIN, else "poor".  Where it is not good, deviations are
multiplied by the Birge ratio

    B = max over total and rows of sqrt(actual / max(expected + spread, MARGIN))

(Birge, Phys. Rev. 40, 1932), at least 1.

Touches of a rigid world are off by RIGID_MISFIT of the page's own scales: those of 28
boxes that slid flat in our simulator cost 0.003 nats, RIGID_MISFIT^2 (1/2 + 1).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from scipy.special import polygamma, psi

from formulations import sensing
from formulations.between_actions import CAUCHY, GAP
from formulations.names import (
    BETWEEN_ACTIONS,
    FREE_TERM,
    TOUCH_SCALE,
    TOUCH_TERM,
)

from ..data.contact_segments import gaps_near_touches, lone_touches
from ..problem.fingertips import touch_scales
from .measurement_noise import touches
from .trajectory import moved_between, moved_farther

PHYSICS_ROW = "physics"  # the row of all terms of that role
BESIDES = {  # the rows that are no part of the total, in words
    PHYSICS_ROW: "balance and friction cost",
    BETWEEN_ACTIONS: "the largest motion between actions costs",
}
OF_MOTION = (  # expected cost of such a motion, and its spread [nats]
    float(CAUCHY * (psi(2) - psi(0.5))),
    float(CAUCHY * np.sqrt(polygamma(1, 0.5) - polygamma(1, 2))),
)
LOST = 0.01  # [m] no retraction moves a body so far: it was carried, or lost
POOR, BAD = 3.0, 10.0  # [spreads] of excess; [spreads and MARGIN]
MARGIN = 3.0  # [nats] odds of 20 to 1
RIGID_MISFIT = 0.045  # [scales] deviation of rigid gaps and normals from the page
NODES = 24  # of each quadrature
CLEAR = 30.0  # [1 / alpha] a free finger so far from a touch costs nothing


@dataclass(frozen=True)
class Misfit:
    """The cost of some samples: actual and expected with its spread [nats]."""

    actual: float
    expected: float
    spread: float

    @property
    def excess(self) -> float:
        """How much more it costs than expected [nats]."""
        return self.actual - self.expected

    @property
    def limit(self) -> float:
        """The excess [nats] up to which a fit is good."""
        return POOR * self.spread + MARGIN

    def __add__(self, other: Misfit) -> Misfit:
        actual, expected = self.actual + other.actual, self.expected + other.expected
        return Misfit(actual, expected, float(np.hypot(self.spread, other.spread)))


NOTHING = Misfit(0.0, 0.0, 0.0)


@dataclass(frozen=True)
class TouchMisfit:
    """The misfit of the touched samples of a finger in an action."""

    action: int
    finger: int
    misfit: Misfit


@dataclass(frozen=True)
class Fit:
    """How well the model explains the measurements.

    verdict: "good", "poor" or "bad"; terms: the Misfit of each likelihood term by name,
    of physics and of the largest motion between two actions; touches: of each finger in
    each action, the worst first; widening: the Birge ratio, by which all standard
    deviations are multiplied; doubt: what else makes it "poor"; suspected: a mistake in
    the data that may be why.  actual, expected, spread [nats]: of the likelihood.
    """

    verdict: str
    terms: dict[str, Misfit]
    touches: tuple[TouchMisfit, ...]
    widening: float
    doubt: str = ""
    suspected: str = ""

    def doubted(self, why: str) -> Fit:
        """Return the fit, "poor" for a reason in words if it is good else."""
        good = self.verdict == "good"
        return replace(self, verdict="poor", doubt=why) if good else self

    @property
    def total(self) -> Misfit:
        """The Misfit of touches and free samples."""
        return sum((m for n, m in self.terms.items() if n not in BESIDES), NOTHING)

    @property
    def actual(self) -> float:
        """What touches and free samples cost [nats]."""
        return self.total.actual

    @property
    def expected(self) -> float:
        """What they should cost under the noise model [nats]."""
        return self.total.expected

    @property
    def spread(self) -> float:
        """The standard deviation of that [nats]."""
        return self.total.spread

    @property
    def text(self) -> str:
        """The verdict in words; where it is not good, where the misfit is, and why."""
        why = f"  A mistake in the data may be why: {self.suspected}."
        return self._verdict_in_words() + (why if self.suspected else "")

    def _verdict_in_words(self) -> str:
        if self.doubt:  # the costs are good
            return f"The fit is {self.verdict}: {self.doubt}."
        besides = [(w, self.terms.get(n, NOTHING)) for n, w in BESIDES.items()]
        off = [f"; {w} {_in_words(m)}" for w, m in besides if m.excess > m.limit]
        words = f"The fit is {self.verdict}: touches and free samples cost "
        words += _in_words(self.total) + "".join(off)
        if self.verdict == "good" or not self.touches:
            return f"{words}."
        worst, factor = self.touches[0], f"{self.widening:.1f}"
        words += f"; touches of finger {worst.finger} in action {worst.action} cost "
        words += _in_words(worst.misfit)
        if self.widening > 1:
            words += f".  Standard deviations are multiplied by {factor}"
        no = ", and the estimate is not to be trusted" if self.verdict == "bad" else ""
        return f"{words}{no}."


def _in_words(m: Misfit) -> str:
    return f"{m.actual:.0f} nats where {m.expected:.0f} ± {m.spread:.0f} are expected"


def fit_of(problem, solution, window, measurements, smoothing: float) -> Fit | None:
    """Return the fit of a solved page; None for one of another touch likelihood.

    smoothing [1]: share of the noise variance that smoothing of the paths leaves.
    """
    if TOUCH_TERM not in problem.costs or TOUCH_SCALE not in problem.parameters:
        return None
    x, data = solution.at(problem)
    terms, misfits = {}, ()
    if len(window.touch):
        costs, terms[TOUCH_TERM] = _of_touches(problem, x, data, window, smoothing)
        misfits = _by_touch(*costs, window, measurements)
    stated = {FREE_TERM, "alpha"} <= {*problem.costs, *problem.parameters}
    if stated and len(window.free):
        (alpha,) = data[problem.parameters["alpha"].span]
        moments = free_moments(alpha * gaps_near_touches(measurements))
        free = _misfit(problem.value(FREE_TERM, x, data), *moments)
        terms[FREE_TERM] = free + Misfit(0.0, 0.0, free.expected)
    poses, total = problem.unpack(x)["x"], sum(terms.values(), start=NOTHING)
    if len(window.gap):
        terms[BETWEEN_ACTIONS] = _largest_motion(poses, window)
    if not window.compliant and (n := len(misfits)):
        laws = problem.costs_of(PHYSICS_ROW)
        cost = sum(float(problem.value(name, x, data).sum()) for name in laws)
        terms[PHYSICS_ROW] = Misfit(cost, n, n**0.5)
    verdict, widening = verdict_of(total, *(terms[n] for n in BESIDES if n in terms))
    fit = Fit(verdict, terms, misfits, widening)
    lost = f"the body moved {1e3 * LOST:g} mm between actions"
    return fit.doubted(lost) if moved_farther(poses, window, LOST) else fit


def verdict_of(total: Misfit, *others: Misfit) -> tuple[str, float]:
    """Return verdict and widening of a fit: at most "poor" because of the others."""
    each = total, *others
    if all(m.excess <= m.limit for m in each):
        return "good", 1.0
    ratios = (m.actual / max(m.expected + m.spread, MARGIN) for m in each)
    bad = total.excess > BAD * (total.spread + MARGIN)
    return "bad" if bad else "poor", float(np.sqrt(max(1.0, *ratios)))


def _largest_motion(x, window) -> Misfit:
    """Return the largest cost of a motion between two actions; x (unknowns, poses)."""
    way, on = moved_between(x, window)
    others = (np.log(way).sum() - np.log(way) + np.log(GAP)) / len(way)
    u = way / np.hypot(np.exp(others), on)
    return Misfit(float((CAUCHY * np.log1p(u**2)).max()), *OF_MOTION)


def _by_touch(cost, mean, variance, window, measurements) -> tuple:
    """Return the TouchMisfit of every finger in every action, the worst first."""
    misfits = [
        TouchMisfit(*of, _misfit(cost[rows], mean[rows], variance[rows]))
        for of, rows in touches(window, measurements).items()
    ]
    return tuple(sorted(misfits, key=lambda t: -t.misfit.excess))


def _of_touches(problem, x, data, window, smoothing: float) -> tuple[tuple, Misfit]:
    """Return cost, its mean and variance of every touch (touches,), and their Misfit.

    x (unknowns,) SI and data of the solved problem; smoothing [1]: as in `fit_of`.
    """
    cost = problem.value(TOUCH_TERM, x, data)[:, 0]
    costs = cost, *touch_moments(problem, data, window, smoothing)
    misfit, sigma = _misfit(*costs), window.sigma_normal * (1 + window.normal_error)
    noisier = replace(window, sigma_normal=sigma)
    common = touch_moments(problem, data, noisier, smoothing)[0].sum() - misfit.expected
    return costs, misfit + Misfit(0.0, 0.0, common)


def touch_moments(problem, data, window, smoothing: float):
    """Return mean and variance [nats, nats^2] of the cost of every touch (touches,).

    Most touches have the same deviations: of 60 to 90 there are one to six pairs.
    """
    sigma, sigma_n = touch_scales(problem, data)
    scale = np.hypot(sigma, window.touch.late_gap)
    scale_n = np.hypot(sigma_n, window.touch.late_gap / window.touch.radius)
    sigma_p = window.sigma_position * np.sqrt(smoothing)
    gap = np.hypot(sigma_p, RIGID_MISFIT * sigma) / scale
    normal = np.hypot(window.sigma_normal, RIGID_MISFIT * sigma_n) / scale_n
    z, weight_z = np.polynomial.hermite_e.hermegauss(NODES)
    e, weight_e = np.polynomial.laguerre.laggauss(NODES)
    weight = np.outer(weight_z / weight_z.sum(), weight_e).ravel()
    pairs, of_touch = np.unique(np.c_[gap, normal], axis=0, return_inverse=True)
    of_gap = sensing.touch(ca.DM(pairs[:, :1] * z), 1.0).full()
    cost = of_gap[:, :, None] + pairs[:, 1, None, None] ** 2 * e
    most = window.outlier_cost
    cost = sensing.mixture(ca.DM(cost.reshape(-1, len(weight))), most).full()
    mean, of_touch = cost @ weight, of_touch.ravel()
    variance = cost**2 @ weight - mean**2
    lone = lone_touches(window.touch) & (smoothing < 1)
    mean, variance = mean[of_touch], variance[of_touch]
    return np.where(lone, most, mean), np.where(lone, 1.0, variance)


def free_moments(gaps) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and variance [nats, nats^2] of the cost of free samples (n,).

    gaps (n, 2): in units of 1 / alpha, uniformly between which each is.
    """
    low, high = gaps[(gaps[:, 0] < CLEAR)].T
    node, weight = np.polynomial.legendre.leggauss(NODES)
    at = (low + high)[:, None] / 2 + (high - low)[:, None] / 2 * node
    cost, weight = sensing.free(ca.DM(at), 1.0).full(), weight / 2
    mean = cost @ weight
    return mean, cost**2 @ weight - mean**2


def _misfit(cost, mean, variance) -> Misfit:
    return Misfit(float(cost.sum()), float(mean.sum()), float(np.sqrt(variance.sum())))
