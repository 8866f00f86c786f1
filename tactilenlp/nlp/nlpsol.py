r"""Programmes as `casadi.nlpsol` takes them: whole, or in their free unknowns.

`whole` is the programme of all unknowns.  Of `Eliminated`, the others follow from the
free ones, step after step: a constraint made by `Problem.follow`, y = F(x, y before it,
d), gives some columns of the unknowns.  Split all unknowns into free ones u and given
ones y(u).  With the whole programme's f, g and the residuals D(u, y) of what is
followed,

    a:  D_y' a = -(s f_y + g_y' l)                 the multipliers of D (adjoint sweep)
    Z = [1; -D_y^-1 D_u]                                                 how y follows u
    gradient  Z' grad f,   Jacobian  Z' grad g,   Hessian  Z' (s f + l g + a D)'' Z

are exact, from the derivatives of the terms: no chain of steps is differentiated.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
from scipy.sparse.linalg import splu

from ..errors import PageError


def whole(problem) -> dict:
    """Return the programme in all unknowns, scaled, as `nlpsol_functions`."""
    of = problem.assembly
    return nlpsol_functions(
        problem.data().size, of.jacobian, of.hessian,
        value=lambda *at: of.evaluated(*at)[::2],
        grad_f=lambda *at: of.evaluated(*at)[:2],
        jac_g=lambda *at: of.evaluated(*at)[2:],
        hess_lag=lambda x, p, f, g: (of.second(x, p, f[0], g),),
    )  # fmt: skip


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
            residual = term.function.evaluated("first", z.T, d.T)[0].T
            given = self.problem.given[name][rows]
            x[given] += residual * scale[given]
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
        f, gradient, g, _ = problem.assembly.evaluated(x / scale, data)
        at = {"key": key, "x": x, "data": data, "f": f, "g": g[self.kept]}
        at["grad"] = gradient
        self._at = at
        return at

    def _slopes(self, at) -> dict:
        """Add the Jacobian and how the given unknowns follow, in scaled unknowns."""
        if "Z" in at:
            return at
        problem = self.problem
        J = problem.assembly.slopes(at["x"] / problem.scale, at["data"])
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
        problem, lam = self.problem, np.zeros(self.problem.rows)
        lam[self.kept] = lam_g
        lam = self._adjoint(at, weight, lam)
        given = at["x"] / problem.scale, at["data"], weight, lam
        return at["Z"].T @ (problem.assembly.curvature(*given) @ at["Z"])

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


def nlpsol_functions(
    data: int, jacobian, hessian, *, value, grad_f, jac_g, hess_lag
) -> dict:
    """Return `nlp` (expressions) and the derivatives, functions, of casadi.nlpsol.

    data: how many numbers p are given; jacobian (rows, n), hessian (n, n): patterns;
    value (x, p) -> f, g; grad_f (x, p) -> f, gradient; jac_g (x, p) -> g, nonzeros;
    hess_lag (x, p, lam_f, lam_g) -> nonzeros.
    """
    sizes = hessian.size1(), data, jacobian.size1(), 1
    x, p, g, one = map(ca.Sparsity.dense, sizes)
    functions = {
        "value": ArrayFunction("value", value, (x, p), (one, g)),
        "grad_f": ArrayFunction("grad_f", grad_f, (x, p), (one, x)),
        "jac_g": ArrayFunction("jac_g", jac_g, (x, p), (g, jacobian)),
        "hess_lag": ArrayFunction("hess_lag", hess_lag, (x, p, one, g), (hessian,)),
    }
    x, p = ca.MX.sym("x", x), ca.MX.sym("p", p)
    f, g = functions["value"](x, p)
    return {"nlp": {"x": x, "p": p, "f": f, "g": g}, **functions}


class ArrayFunction(ca.Callback):
    """A function of arrays, given nonzeros and returning tuples of them.

    inputs, outputs: patterns.  Who uses it in an expression keeps it alive.
    """

    def __init__(self, name: str, function: Callable, inputs, outputs):
        ca.Callback.__init__(self)
        self._function, self._inputs, self._outputs = function, inputs, outputs
        self.construct(name, {})

    def get_n_in(self):
        return len(self._inputs)

    def get_n_out(self):
        return len(self._outputs)

    def get_sparsity_in(self, i):
        return self._inputs[i]

    def get_sparsity_out(self, i):
        return self._outputs[i]

    def has_eval_buffer(self):
        return True

    def eval_buffer(self, arguments, results):
        given = [
            np.zeros(pattern.nnz()) if one is None else np.frombuffer(one)
            for one, pattern in zip(arguments, self._inputs, strict=True)
        ]  # CasADi's null pointer stands for zeros
        found = self._function(*given)
        for out, values in zip(results, found, strict=True):
            if out is not None:
                np.frombuffer(out)[:] = values
        return 0
