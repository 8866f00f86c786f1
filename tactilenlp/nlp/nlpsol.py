r"""Programmes as `casadi.nlpsol` takes them: whole, or in their free unknowns.

The whole one is an `Assembly`.  Of `Eliminated`, the other unknowns follow from the
free ones, step after step: a constraint made by `Problem.follow`, y = F(x, y before it,
d), gives some columns of the unknowns.  Split all unknowns into free ones u and
dependent ones y(u).  With the whole programme's f, g and the residuals D(u, y) of the
constraints that define y,

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


def objective(problem, values: dict[str, np.ndarray] | None = None) -> float:
    """Return the objective of a problem at values by name, SI; the guesses elsewhere.

    Unknowns that follow from others are computed, whatever their values are.
    """
    x, data = problem.pack(values or {}), problem.data()
    if problem.dependent:
        x = problem.eliminated.complete(x, data)
    return float(sum(problem.value(name, x, data).sum() for name in problem.costs))


class Eliminated:
    """A problem in its free unknowns u, scaled; to be evaluated as an Assembly is.

    free, dependent: indices into the vector of all unknowns; kept: rows of the
    constraints that remain, defining: of those that give the dependent ones; jacobian,
    hessian: patterns; functions: what `nlpsol` takes.
    """

    def __init__(self, problem):
        self.problem = problem
        self.dependent = np.concatenate(
            [np.zeros(0, int), *map(np.ravel, problem.dependent.values())]
        )
        if not len(self.dependent):
            raise PageError(
                "nothing to eliminate", where="problem", got="no dependent unknowns",
                next="call nlp.follow on the page",
            )  # fmt: skip
        if len(np.unique(self.dependent)) < len(self.dependent):
            raise PageError(
                "an unknown follows twice", where=str([*problem.dependent]),
                expected="one nlp.follow for each column",
            )  # fmt: skip
        rows = np.zeros(problem.rows, bool)
        for name, given in problem.dependent.items():
            if len(given) < problem.constraints[name].instances:
                raise PageError(
                    "several instances give one column", where=name,
                    got=f"{problem.constraints[name].instances} for {len(given)}",
                    expected="as many instances as columns that follow",
                )  # fmt: skip
            rows[problem.constraints[name].span] = True
        self.kept, self.defining = np.nonzero(~rows)[0], np.nonzero(rows)[0]
        self.free = np.setdiff1d(np.arange(problem.size), self.dependent)
        self.rounds = self._rounds()
        self._at = None
        n = len(self.free)
        self.jacobian = ca.Sparsity.dense(len(self.kept), n)
        self.hessian = ca.Sparsity.upper(n)
        self.functions = nlpsol_functions(self, problem.data().size)

    def check_unbounded(self, lower: np.ndarray, upper: np.ndarray) -> None:
        """Raise PageError where bounds of unknowns that follow from others are finite.

        lower, upper: of all unknowns, equal where one is fixed.
        """
        finite = np.isfinite(np.stack([lower, upper])[:, self.dependent]).any(axis=0)
        if finite.any():
            raise PageError(
                "unknowns that follow from others have bounds, or are fixed",
                where="eliminate", got=f"{np.count_nonzero(finite)} of {len(finite)}",
                expected="none: they are computed",
                next="state the bounds by subject_to, or leave out eliminate",
            )  # fmt: skip

    def complete(self, x: np.ndarray, data: np.ndarray) -> np.ndarray:
        """Return all unknowns (unknowns,): the dependent ones computed from the others.

        x (unknowns,) SI, of which dependent ones are not read.
        """
        x, scale = x.copy(), self.problem.scale
        x[self.dependent] = 0.0  # residuals are then what is computed, without rounding
        for name, rows in self.rounds:
            term = self.problem.constraints[name]
            z, d = x[term.unknowns[rows]], data[term.data[rows]]
            residual = term.function.evaluated("first", z.T, d.T)[0].T
            columns = self.problem.dependent[name][rows]
            x[columns] += residual * scale[columns]
        return x

    def multipliers(self, x, data, lam_g) -> np.ndarray:
        """Return the multipliers of all constraints, given those that are kept."""
        at = self._slopes(x[self.free] / self.problem.scale[self.free], data)
        return self._adjoint(at, 1.0, lam_g)

    def lagrangian(self, u, data, lam_g: np.ndarray) -> tuple:
        """Return the gradient of f + lam_g' g by u, and g, of what is kept."""
        at = self._slopes(u, data)
        return at["Z"].T @ (at["grad"] + at["rest"].T @ lam_g), at["g"]

    def value(self, u, data) -> tuple:
        """Return f and g, of what is kept."""
        at = self._look(u, data)
        return at["f"], at["g"]

    def evaluated(self, u, data) -> tuple:
        """Return f, its gradient, g and the nonzeros of its Jacobian, by u."""
        at = self._slopes(u, data)
        return at["f"], at["Z"].T @ at["grad"], at["g"], at["J"].ravel("F")

    def second(self, u, data, lam_f: float, lam_g: np.ndarray) -> np.ndarray:
        """Return the nonzeros of the Hessian of lam_f f + lam_g' g by u."""
        at = self._slopes(u, data)
        lam, Z = self._adjoint(at, lam_f, lam_g), at["Z"]
        x, problem = at["x"] / self.problem.scale, self.problem
        H = Z.T @ (problem.assembly.curvature(x, data, lam_f, lam) @ Z)
        return H.T[np.tril_indices(len(u))]  # symmetric: columns of its upper part

    def _rounds(self) -> list[tuple[str, np.ndarray]]:
        """Return (constraint, instances) in an order in which each can be computed."""
        problem = self.problem
        computed = np.ones(problem.size, bool)
        computed[self.dependent] = False
        left = {name: np.arange(len(g)) for name, g in problem.dependent.items()}
        rounds = []
        while any(map(len, left.values())):
            ready = {}
            for name, rows in left.items():
                # Its own columns come last: a residual also reads what it gives.
                own = problem.dependent[name].shape[1]
                inputs = problem.constraints[name].unknowns[rows, :-own]
                ready[name] = computed[inputs].all(axis=1)
            if not any(r.any() for r in ready.values()):
                raise PageError(
                    "unknowns follow from each other", where=str([*left]),
                    expected="columns that follow from earlier ones alone",
                )  # fmt: skip
            for name, now in ready.items():
                rows = left[name][now]
                left[name] = left[name][~now]
                if len(rows):
                    rounds.append((name, rows))
                    computed[problem.dependent[name][rows]] = True
        return rounds

    # -- derivatives ------------------------------------------------------------------
    def _look(self, u, data) -> dict:
        """Return x, f, its gradient by x and g at u, cached."""
        key = u.tobytes() + data.tobytes()
        if self._at is not None and self._at["key"] == key:
            return self._at
        problem, scale = self.problem, self.problem.scale
        x = np.zeros(problem.size)
        x[self.free] = u * scale[self.free]
        x = self.complete(x, data)
        f, gradient, g, _ = problem.assembly.evaluated(x / scale, data)
        self._at = {"key": key, "x": x, "f": f, "g": g[self.kept], "grad": gradient}
        return self._at

    def _slopes(self, u, data) -> dict:
        """Return that with the Jacobian and how dependent unknowns follow, scaled."""
        at = self._look(u, data)
        if "Z" in at:
            return at
        problem = self.problem
        J = problem.assembly.slopes(at["x"] / problem.scale, data)
        at["rest"], D = J[self.kept], J[self.defining].tocsc()
        at["factor"] = splu(D[:, self.dependent].tocsc())
        Z = np.zeros((problem.size, len(self.free)))
        Z[self.free, np.arange(len(self.free))] = 1.0
        Z[self.dependent] = -at["factor"].solve(D[:, self.free].toarray())
        at["Z"], at["J"] = Z, at["rest"] @ Z
        return at

    def _adjoint(self, at, lam_f, lam_g) -> np.ndarray:
        """Return the multipliers of what is kept, and those that define unknowns."""
        pull = lam_f * at["grad"] + at["rest"].T @ lam_g
        lam = np.zeros(self.problem.rows)
        lam[self.kept] = lam_g
        lam[self.defining] = -at["factor"].solve(pull[self.dependent], "T")
        return lam


def nlpsol_functions(programme, data: int) -> dict:
    """Return `nlp` (expressions) and the derivatives, functions, of casadi.nlpsol.

    programme: an Assembly or an Eliminated; data: how many numbers p it is given.
    """
    patterns = programme.jacobian, programme.hessian
    sizes = patterns[1].size1(), data, patterns[0].size1(), 1
    x, p, g, one = map(ca.Sparsity.dense, sizes)

    def grad_f(x, p):
        return programme.evaluated(x, p)[:2]

    def jac_g(x, p):
        return programme.evaluated(x, p)[2:]

    def hess_lag(x, p, lam_f, lam_g):
        return (programme.second(x, p, float(lam_f[0]), lam_g),)

    functions = {
        "value": ArrayFunction("value", programme.value, (x, p), (one, g)),
        "grad_f": ArrayFunction("grad_f", grad_f, (x, p), (one, x)),
        "jac_g": ArrayFunction("jac_g", jac_g, (x, p), (g, patterns[0])),
        "hess_lag": ArrayFunction("hess_lag", hess_lag, (x, p, one, g), patterns[1:]),
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
        """Read the arguments from CasADi's memory, write the results; return 0."""
        values = [
            np.zeros(pattern.nnz()) if one is None else np.frombuffer(one)
            for one, pattern in zip(arguments, self._inputs, strict=True)
        ]  # CasADi's null pointer stands for zeros
        for out, result in zip(results, self._function(*values), strict=True):
            if out is not None:
                np.frombuffer(out)[:] = result
        return 0
