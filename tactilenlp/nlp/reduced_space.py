r"""A programme in its free unknowns: the others follow from them, step after step.

A constraint made by `Problem.follow`, y = F(x, y before it, d), gives some columns of
the unknowns.  Split all unknowns into free ones u and given ones y(u).  With the whole
programme's f, g and the residuals D(u, y) of what is followed,

    a:  D_y' a = -(s f_y + g_y' l)                 the multipliers of D (adjoint sweep)
    Z = [1; -D_y^-1 D_u]                                                 how y follows u
    gradient  Z' grad f,   Jacobian  Z' grad g,   Hessian  Z' (s f + l g + a D)'' Z

are exact, from the derivatives of the terms: no chain of steps is differentiated.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from ..errors import PageError
from .assembly import nlpsol_functions


class Eliminated:
    """What a solver needs of a problem in its free unknowns.

    free, given: indices into the vector of all unknowns; kept: rows of the constraints
    that remain; functions: as Problem.functions, in the free unknowns, scaled.
    """

    def __init__(self, problem):
        self.problem = problem
        self.given = np.concatenate(
            [np.zeros(0, int), *(columns.ravel() for columns in problem.given.values())]
        )
        if not len(self.given):
            raise PageError("nothing to eliminate", next="call nlp.follow on the page")
        if len(np.unique(self.given)) < len(self.given):
            raise PageError("an unknown is given twice", where=str([*problem.given]))
        rows = np.zeros(problem.rows, bool)
        for name in problem.given:
            rows[problem.constraints[name].span] = True
        self.kept, self.followed = np.nonzero(~rows)[0], np.nonzero(rows)[0]
        self.free = np.setdiff1d(np.arange(problem.size), self.given)
        self.rounds = self._rounds()
        self._at = None
        self.functions = self._functions()

    def complete(self, x: np.ndarray, data: np.ndarray) -> np.ndarray:
        """Return all unknowns: those that are given computed from those that are free.

        x (unknowns,) SI, of which the given ones are only where computing begins.
        """
        x, scale = x.copy(), self.problem.scale
        for name, rows in self.rounds:
            term = self.problem.constraints[name]
            z, d = x[term.unknowns[rows]], data[term.data[rows]]
            residual = term.function.mapped("first", len(rows))(z.T, d.T)[0]
            given = self.problem.given[name][rows]
            x[given] += np.asarray(residual).T * scale[given]
        return x

    def multipliers(self, x, data, lam_g) -> np.ndarray:
        """Return the multipliers of all constraints, given those that are kept."""
        at = self._look(x[self.free] / self.problem.scale[self.free], data)
        lam = np.zeros(self.problem.rows)
        lam[self.kept] = lam_g
        return self._adjoint(at, 1.0, lam)

    def lagrangian(self, u, data, lam_g: np.ndarray) -> tuple:
        """Return the gradient of f + lam_g' g by u, scaled, and g, of what is kept."""
        at = self._slopes(self._look(u, data))
        return at["Z"].T @ (at["grad"] + at["rest"].T @ lam_g), at["g"]

    def _rounds(self) -> list[tuple[str, np.ndarray]]:
        """Return (constraint, instances) in an order in which each can be computed."""
        problem = self.problem
        known = np.ones(problem.size, bool)
        known[self.given] = False
        left = {name: np.arange(len(g)) for name, g in problem.given.items()}
        rounds = []
        while any(map(len, left.values())):
            ready = {}
            for name, rows in left.items():
                # Its own columns come last: a residual also reads what it gives.
                own = problem.given[name].shape[1]
                inputs = problem.constraints[name].unknowns[rows, :-own]
                ready[name] = known[inputs].all(axis=1)
            if not any(r.any() for r in ready.values()):
                raise PageError("unknowns follow from each other", where=str([*left]))
            for name, now in ready.items():
                rows = left[name][now]
                left[name] = left[name][~now]
                if len(rows):
                    rounds.append((name, rows))
                    known[problem.given[name][rows]] = True
        return rounds

    # -- derivatives ------------------------------------------------------------------
    def _look(self, u, data) -> dict:
        """Return value, gradient, Jacobian and sensitivities at u (scaled), cached."""
        key = u.tobytes() + data.tobytes()
        if self._at is not None and self._at["key"] == key:
            return self._at
        problem, scale = self.problem, self.problem.scale
        x = problem.pack({}) if self._at is None else self._at["x"].copy()
        x[self.free] = u * scale[self.free]
        x = self.complete(x, data)
        values = {n: problem.value(n, x, data) for n in problem.terms}
        g = [np.zeros(0), *(values[n].ravel() for n in problem.constraints)]
        at = {"key": key, "x": x, "data": data, "g": np.concatenate(g)[self.kept]}
        at["f"] = sum(float(values[n].sum()) for n in problem.costs)
        self._at = at
        return at

    def _slopes(self, at) -> dict:
        """Add first derivatives, in scaled unknowns."""
        if "Z" in at:
            return at
        problem, x, data = self.problem, at["x"], at["data"]
        scaling = sp.diags(problem.scale)
        costs = [problem.jacobian(n, x, data).sum(axis=0) for n in problem.costs]
        at["grad"] = np.asarray(sum(costs)).ravel() * problem.scale
        blocks = [problem.jacobian(n, x, data) for n in problem.constraints]
        J = sp.vstack(blocks, format="csr") @ scaling
        at["rest"], D = J[self.kept], J[self.followed].tocsc()
        at["factor"] = splu(D[:, self.given].tocsc())
        Z = np.zeros((problem.size, len(self.free)))
        Z[self.free, np.arange(len(self.free))] = 1.0
        Z[self.given] = -at["factor"].solve(D[:, self.free].toarray())
        at["Z"] = Z
        return at

    def _adjoint(self, at, weight, lam) -> np.ndarray:
        """Return the multipliers `lam` with those of what is followed filled in."""
        at = self._slopes(at)
        pull = weight * at["grad"] + at["rest"].T @ lam[self.kept]
        lam = lam.copy()
        lam[self.followed] = -at["factor"].solve(pull[self.given], "T")
        return lam

    def _hessian(self, at, weight, lam_g) -> np.ndarray:
        problem, x, data = self.problem, at["x"], at["data"]
        lam = np.zeros(problem.rows)
        lam[self.kept] = lam_g
        lam = self._adjoint(at, weight, lam)
        H = weight * sum(problem.hessian(n, x, data) for n in problem.costs)
        for name, term in problem.constraints.items():
            H = H + problem.hessian(name, x, data, lam[term.span])
        scaling = sp.diags(problem.scale)
        return at["Z"].T @ ((scaling @ H @ scaling) @ at["Z"])

    # -- for the solver ---------------------------------------------------------------
    def _functions(self) -> dict:
        n, m = len(self.free), len(self.kept)
        patterns = ca.Sparsity.dense(m, n), ca.Sparsity.upper(n)

        def value(u, p):
            at = self._look(u, p)
            return at["f"], at["g"]

        def grad_f(u, p):
            at = self._slopes(self._look(u, p))
            return at["f"], at["Z"].T @ at["grad"]

        def jac_g(u, p):
            at = self._slopes(self._look(u, p))
            return at["g"], (at["rest"] @ at["Z"]).ravel("F")

        def hess_lag(u, p, lam_f, lam_g):
            H = self._hessian(self._look(u, p), float(lam_f[0]), lam_g)
            return (H.T[np.tril_indices(n)],)  # symmetric: columns of its upper part

        return nlpsol_functions(
            self.problem.data().size, *patterns,
            value=value, grad_f=grad_f, jac_g=jac_g, hess_lag=hess_lag,
        )  # fmt: skip
