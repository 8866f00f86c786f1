"""A primal-dual interior-point method for problems with few equations.

    min f(x)   s.t.  g_l <= g(x) <= g_u,  x_l <= x <= x_u

It is the algorithm of IPOPT (Waechter and Biegler, Math. Program. 106, 2006, numbers of
equations below are theirs; constants are IPOPT's defaults), without second-order
corrections, watchdog and restoration: monotone barrier parameter, inertia correction,
filter line search.  Multipliers of inequalities begin as those of their slacks.  A
Newton step factorises a matrix of the size of x, see condensed_kkt.
"""

from __future__ import annotations

import time

import numpy as np

from .line_search import Filter, Point, Stuck, longest_step
from .solution import ACCEPTED, SOLVED, TIME_EXCEEDED, TOO_MANY

INNER, OUTER = 10.0, 1e10  # kappa_eps of (7), kappa_Sigma of (16)
LINEAR, SUPERLINEAR = 0.2, 1.5  # of the barrier parameter, (7)
LEAST_TAU = 0.99  # of the rule by which a step stays off the bounds, (8)
FIRST, INCREASE, FIRST_INCREASE, DECREASE = 1e-4, 8.0, 100.0, 1 / 3  # algorithm IC
MOST_DAMPING, LEAST_DAMPING = 1e20, 1e-20  # damping, algorithm IC
SCALED_FROM = 100.0  # s_max of (6)
LARGEST_MULTIPLIER = 1000.0  # of equations at a start, else 0
SLACK_PUSH = 1e-2  # of slacks into their bounds, relative
# steps in a row that the filter shortens; of 480 solves that succeeded 25 was the most
MOST_SHORTENED = 30
MOST_RESETS = 5  # of a filter that accepts no step


class Run:
    """One solve: first and current point, multipliers y of g, z of the bounds of w.

    assembly: an nlp.assembly.Assembly; kkt: the CondensedKkt of its patterns.
    """

    def __init__(
        self, assembly, kkt, settings, *, p, x0, lbx, ubx, lbg, ubg, lam_g0=None,
        lam_x0=None,
    ):  # fmt: skip
        self.assembly, self.kkt, self.data = assembly, kkt, p
        self.settings, self.mu = settings, settings.mu_init
        self.began, self.n, self.fixed = time.monotonic(), len(x0), lbx >= ubx
        self.left_out = self.kkt.entries_of(self.fixed)
        self.equal = self.kkt.equal  # their slack is the number that they equal
        still = np.r_[self.fixed, self.equal]
        lower = np.where(still, -np.inf, np.r_[lbx, lbg])
        upper = np.where(still, np.inf, np.r_[ubx, ubg])
        self.lo, self.hi = (np.flatnonzero(np.isfinite(b)) for b in (lower, upper))
        self.lower, self.upper = bounds = lower[self.lo], upper[self.hi]
        self.least = [np.spacing(np.maximum(1.0, np.abs(b))) for b in bounds]
        self.iterations, self.evaluations, self.damping = 0, 1, 0.0
        self.accepted, self.shortened, self.resets = 0, 0, 0
        self.history: list[tuple] = []  # by iteration, as PROGRESS names
        warm = lam_g0 is not None
        push = np.full(len(lower), settings.bound_push)
        push[self.n :] = settings.bound_push if warm else SLACK_PUSH
        x = _inside(x0, lower[: self.n], upper[: self.n], push[: self.n])
        values = self.assembly.evaluated(x, p)
        w = np.r_[x, _inside(values[2], lbg, ubg, push[self.n :])]
        self.at = self.start = self._point(w, values)
        self.z_lo, self.z_hi = np.ones(len(self.lo)), np.ones(len(self.hi))
        if warm:
            self.y = np.array(lam_g0, float)
            both = np.r_[lam_x0, self.y]
            self.z_lo = np.maximum(-both[self.lo], settings.bound_push)
            self.z_hi = np.maximum(both[self.hi], settings.bound_push)
        else:
            self.y = self._first_multipliers()
        self.filter = Filter(self.at.violation)

    def diverged(self) -> bool:
        """Tell whether both primal and dual error grew since the start."""
        if not self.history:  # no number where it begins
            return False
        (_, *first, _), (_, *last, _) = self.history[0], self.history[-1]
        return all(now > then for now, then in zip(last, first, strict=True))

    def continue_counts(self, run: Run) -> None:
        """Count iterations, evaluations and time on from an earlier run."""
        self.began, self.history = run.began, run.history
        self.iterations, self.evaluations = run.iterations, run.evaluations + 1

    def evaluated(self, w: np.ndarray) -> Point:
        """Return the Point at w = (x, s); counts an evaluation."""
        self.evaluations += 1
        return self._point(w, self.assembly.evaluated(w[: self.n], self.data))

    def _point(self, w, values) -> Point:
        """Return the Point of values that were evaluated at w."""
        distances = w[self.lo] - self.lower, self.upper - w[self.hi]  # not rounded to 0
        return Point(w, *values, *map(np.maximum, distances, self.least))

    def bounds_of_x(self) -> np.ndarray:
        """Return the multipliers of the bounds of x, negative at lower ones."""
        return self._spread(-self.z_lo, self.z_hi)[: self.n]

    def _spread(self, at_lower, at_upper) -> np.ndarray:
        """Return the sum (n + m,) of values at lower and at upper bounds."""
        out = np.zeros(len(self.at.w))
        out[self.lo] += at_lower
        out[self.hi] += at_upper
        return out

    def _first_multipliers(self) -> np.ndarray:
        """Return y (m,): of inequalities that of the bounds of their slacks.

        Its sign is right: curved constraints do not make the first matrices indefinite.
        Of equations it makes the gradient of the Lagrangian smallest, (36).
        """
        slope = self._spread(-self.z_lo, self.z_hi)
        y, jacobian, kkt = slope[self.n :].copy(), self.at.jacobian, self.kkt
        slope = slope[: self.n] + self.at.gradient + kkt.transposed_times(jacobian, y)
        slope[self.fixed] = 0.0
        y_equal = kkt.least_squares(jacobian, slope, self.left_out)
        if _largest(y_equal) <= LARGEST_MULTIPLIER:
            y[self.equal] = y_equal
        return y

    # -- where to stop ----------------------------------------------------------------
    def _measure(self) -> None:
        """Set errors, products of z and distance, and the scales of (5)."""
        at = self.at
        dual = self._spread(-self.z_lo, self.z_hi)
        dual[: self.n] += at.gradient + self.kkt.transposed_times(at.jacobian, self.y)
        dual[self.n :] -= self.y
        dual[: self.n][self.fixed] = 0
        dual[self.n :][self.equal] = 0
        self.dual, self.primal = _largest(dual), _largest(at.residual)
        self.products = np.concatenate((at.below * self.z_lo, at.above * self.z_hi))
        bounds = self.z_lo.sum() + self.z_hi.sum()
        count = max(1, len(self.products))
        mean = (np.abs(self.y).sum() + bounds) / (len(self.y) + count)
        self.scales = tuple(max(1.0, k / SCALED_FROM) for k in (mean, bounds / count))

    def _error(self, mu: float) -> float:
        """Return E of (5): errors over the mean multipliers, where these are large."""
        of_dual, of_product = self.scales
        product = _largest(self.products - mu) / of_product
        return max(self.dual / of_dual, self.primal, product)

    def _status(self, before: float) -> str | None:
        """Return why the solve ends here, if it does; before: f of the last point."""
        self._measure()
        f, s, error = self.at.f, self.settings, self._error(0.0)
        product = _largest(self.products)
        self.history.append((f, self.primal, self.dual, self.mu))
        tight = self.dual <= s.dual_inf_tol and product <= s.compl_inf_tol
        if error <= s.tol and tight and self.primal <= s.constr_viol_tol:
            return SOLVED
        errors = error, abs(f - before) / max(1.0, abs(f)), self.primal, product
        limits = (s.acceptable_tol, s.acceptable_obj_change_tol,
                  s.acceptable_constr_viol_tol, s.acceptable_compl_inf_tol)  # fmt: skip
        acceptable = all(e <= k for e, k in zip(errors, limits, strict=True))
        self.accepted = self.accepted + 1 if acceptable else 0
        if 0 < s.acceptable_iter <= self.accepted:
            return ACCEPTED
        if self.iterations >= s.max_iter:
            return TOO_MANY
        late = time.monotonic() - self.began > s.max_wall_time
        return TIME_EXCEEDED if late else None

    # -- one iteration ----------------------------------------------------------------
    def minimise(self) -> str:
        """Iterate; return IPOPT's name of the reason for the end, or raise Stuck."""
        if not np.all(np.isfinite([self.at.f, *self.at.g])):
            raise Stuck
        before = np.inf
        while (status := self._status(before)) is None:
            before = self.at.f
            self._update_barrier()
            slope = self._slope()
            dx, ds, dy = self._newton_step(slope)
            dw = np.concatenate((dx, ds))
            self._take(dw, dy, float(slope @ dw), *self._bound_steps(dw))
            self.iterations += 1
        return status

    def _update_barrier(self) -> None:
        """Lower the barrier parameter while its problem is solved well enough, (7)."""
        least = min(self.settings.tol, self.settings.compl_inf_tol) / (INNER + 1)
        while (mu := self.mu) > least and self._error(mu) <= INNER * mu:
            self.mu = max(least, min(LINEAR * mu, mu**SUPERLINEAR))
            self.filter.entries.clear()

    def _slope(self) -> np.ndarray:
        """Return the gradient of the barrier function in w."""
        slope = self._spread(-self.mu / self.at.below, self.mu / self.at.above)
        slope[: self.n] += self.at.gradient
        return slope

    def _newton_step(self, slope) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the step in x, s and y, damped until the inertia is right."""
        at, kkt, n = self.at, self.kkt, self.n
        weights = self._spread(self.z_lo / at.below, self.z_hi / at.above)
        hessian = self.assembly.second(at.w[:n], self.data, 1.0, self.y)
        matrix = kkt.matrix(
            hessian, at.jacobian, weights[:n], weights[n:], self.left_out
        )
        unit, delta = None, 0.0
        while not kkt.factorise(matrix if unit is None else matrix + delta * unit):
            delta = self._next_damping(delta)
            unit = kkt.unit(at.jacobian, self.left_out) if unit is None else unit
        self.damping = delta or self.damping
        dx, ds, y = self._solved(slope, at.residual, weights[n:] + delta)
        return dx, ds, y - self.y

    def _solved(self, slope, residual, in_s) -> tuple[np.ndarray, ...]:
        """Return the step in x and s, and y after it, by the factors of the matrix."""
        kkt, jacobian, n = self.kkt, self.at.jacobian, self.n
        pull = np.where(self.equal, 0.0, in_s * residual + slope[n:])
        right = -slope[:n] - kkt.transposed_times(jacobian, pull)
        dx, y_equal = kkt.solve(np.where(self.fixed, 0.0, right), -residual[self.equal])
        ds = kkt.times(jacobian, dx) + residual
        y = in_s * ds + slope[n:]
        ds[self.equal], y[self.equal] = 0.0, y_equal
        return dx, ds, y

    def _next_damping(self, delta: float) -> float:
        """Return the damping to try after delta; Stuck where that was too large."""
        if delta == 0:
            known = self.damping > 0
            return max(LEAST_DAMPING, DECREASE * self.damping) if known else FIRST
        if delta > MOST_DAMPING:
            raise Stuck
        return delta * (INCREASE if self.damping > 0 else FIRST_INCREASE)

    def _bound_steps(self, dw) -> tuple[np.ndarray, np.ndarray]:
        """Return the steps of the multipliers of the bounds, (12)."""
        at, mu = self.at, self.mu
        lo = (mu - self.z_lo * dw[self.lo]) / at.below - self.z_lo
        hi = (mu + self.z_hi * dw[self.hi]) / at.above - self.z_hi
        return lo, hi

    def _take(self, dw, dy, slope: float, dz_lo, dz_hi) -> None:
        """Move to an acceptable point along the step, (14) to (16).

        slope: of the barrier function along dw.
        """
        at, mu = self.at, self.mu
        tau = max(LEAST_TAU, 1 - mu)
        distances, z = (at.below, at.above), (self.z_lo, self.z_hi)
        longest = longest_step(distances, (dw[self.lo], -dw[self.hi]), tau)
        of_z = longest_step(z, (dz_lo, dz_hi), tau)
        alpha, self.at = self._line_search(dw, slope, longest)
        self.shortened = self.shortened + 1 if alpha < longest else 0
        if self.shortened > MOST_SHORTENED:
            raise Stuck
        self.y = self.y + alpha * dy
        lo, hi = mu / self.at.below, mu / self.at.above
        self.z_lo = np.clip(self.z_lo + of_z * dz_lo, lo / OUTER, lo * OUTER)
        self.z_hi = np.clip(self.z_hi + of_z * dz_hi, hi / OUTER, hi * OUTER)

    def _line_search(self, dw, slope, longest: float) -> tuple[float, Point]:
        """Return step length and point; a filter that refuses all steps is emptied."""
        line = self.at, dw, slope, longest, self.mu, self.evaluated
        while True:
            try:
                return self.filter.first_accepted(*line)
            except Stuck:
                if not self.filter.entries or self.resets == MOST_RESETS:
                    raise
                self.filter.entries.clear()
                self.resets += 1


def _largest(values: np.ndarray) -> float:
    return np.abs(values).max(initial=0.0)


def _inside(w, lower, upper, push) -> np.ndarray:
    """Return w, moved inside its bounds by a relative distance, section 3.6."""
    width = upper - lower
    for bound, sign, closer in ((lower, 1, np.maximum), (upper, -1, np.minimum)):
        at = np.isfinite(bound)
        off = push[at] * np.minimum(np.maximum(1.0, np.abs(bound[at])), width[at])
        w = w.copy()
        w[at] = closer(w[at], bound[at] + sign * off)
    return w
