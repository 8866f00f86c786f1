"""Solve a Problem with IPOPT; recompute what the solver says of its solution."""

from __future__ import annotations

import logging
import math
import time
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from .checks import check_numbers, check_types
from .errors import NotConverged, OptionError
from .interrupt import interruptible
from .nlp import Problem

log = logging.getLogger("tactilenlp")

PROGRESS = {  # our names for IPOPT's
    "objective": "obj", "primal": "inf_pr", "dual": "inf_du", "barrier": "mu",
}  # fmt: skip


def check_positive(options, *names: str) -> None:
    """Raise OptionError unless the named fields are positive numbers."""
    given = {name: (getattr(options, name), 0, math.inf) for name in names}
    check_numbers("", "a positive number", **given)


@dataclass(frozen=True)
class SolverOptions:
    """How to solve one programme.

    tolerance: of the scaled optimality conditions [-]; time_limit [s];
    iterations: at most [-]; barrier: IPOPT's first mu [-]; push: how far a start is
    pushed inside its bounds, relative [-]; ipopt: options passed on verbatim.
    """

    tolerance: float = 1e-6
    time_limit: float = 60.0
    iterations: int = 300
    barrier: float = 1e-2
    push: float = 1e-4
    ipopt: dict = field(default_factory=dict)

    def __post_init__(self):
        check_types(ipopt=(self.ipopt, dict))
        check_positive(self, "tolerance", "time_limit", "iterations", "barrier", "push")

    def for_nlpsol(self) -> dict:
        """Return the options in CasADi's words."""
        ours = {
            "linear_solver": "mumps",
            "tol": self.tolerance,
            "constr_viol_tol": min(1e-6, self.tolerance),
            "max_iter": self.iterations,
            "max_wall_time": self.time_limit,
            "mu_init": self.barrier,
            "bound_push": self.push,
            "bound_frac": self.push,
            "bound_relax_factor": 0.0,
            "nlp_scaling_method": "none",
            "print_level": 0,
            "sb": "yes",
        }
        return {f"ipopt.{k}": v for k, v in {**ours, **self.ipopt}.items()} | {
            "print_time": False,
            "error_on_fail": False,
            "no_nlp_grad": True,
            "calc_lam_p": False,
        }


@dataclass(frozen=True, eq=False)
class Solution:
    """Where a solve ended, recomputed: nothing here is the solver's word but `status`.

    `values` by variable name, SI, (rows, columns); `costs` by term, summed over the
    instances; `violations` by constraint, the largest; `multipliers` by constraint,
    (instances, rows), and of the bounds by variable name, (rows, columns), SI.
    `progress` by iteration, as IPOPT says: level, objective, primal and dual
    infeasibility, barrier.
    """

    values: dict[str, np.ndarray]
    objective: float
    costs: dict[str, float]
    violations: dict[str, float]
    multipliers: dict[str, np.ndarray]
    bound_multipliers: dict[str, np.ndarray]
    parameters: dict[str, np.ndarray]
    success: bool
    status: str
    iterations: int
    evaluations: int
    seconds: dict[str, float]
    iterations_by_level: tuple[int, ...] = ()
    progress: dict[str, np.ndarray] = field(default_factory=dict)


def make_solver(problem, options: SolverOptions, eliminate=False) -> ca.Function:
    """Return IPOPT for this problem; solvers of one problem share its derivatives."""
    functions = (problem.eliminated if eliminate else problem).functions
    exact = {k: functions[k] for k in ("grad_f", "jac_g", "hess_lag")}
    settings = options.for_nlpsol() | exact
    try:
        return ca.nlpsol("solver", "ipopt", functions["nlp"], settings)
    except RuntimeError as error:
        raise OptionError(
            "IPOPT does not take these options",
            where="ipopt",
            got=f"{options.ipopt}: {str(error).strip().splitlines()[-1]}",
            expected="names and values of IPOPT's own documentation",
        ) from error


def solve(
    problem: Problem,
    options: SolverOptions | None = None,
    *,
    start: dict[str, np.ndarray] | None = None,
    parameters: dict | None = None,
    fixed: tuple[str, ...] = (),
    throw: bool = True,
    solver: ca.Function | None = None,
    eliminate: bool = False,
) -> Solution:
    """Minimise from `start` (by name, SI; else the guesses) with some variables fixed.

    eliminate: compute the unknowns that `follow` gives, instead of solving for them.

    Raises NotConverged unless the solver succeeded or `throw` is False.
    """
    options = options or SolverOptions()
    began = time.process_time()
    solver = solver or make_solver(problem, options, eliminate)
    built = time.process_time() - began
    scale, data = problem.scale, problem.data(parameters)
    x0 = problem.pack(start or {})
    lower, upper = problem.bounds("lower"), problem.bounds("upper")
    x0 = np.clip(x0, lower, upper)
    unknown = [name for name in fixed if name not in problem.variables]
    if unknown:
        raise OptionError(
            "no such variable",
            where="fixed",
            got=unknown,
            expected=f"names among {[*problem.variables]}",
        )
    for name in fixed:
        span = problem.variables[name].span
        lower[span] = upper[span] = x0[span]
    free = problem.eliminated.free if eliminate else slice(None)
    kept = problem.eliminated.kept if eliminate else slice(None)
    began = time.process_time()
    with interruptible():
        out = solver(
            x0=(x0 / scale)[free],
            p=data,
            lbx=(lower / scale)[free],
            ubx=(upper / scale)[free],
            lbg=problem.limits("lower")[kept],
            ubg=problem.limits("upper")[kept],
        )
    stats = solver.stats()
    x, lam_x = x0.copy(), np.zeros(problem.size)
    x[free] = np.asarray(out["x"]).ravel() * scale[free]
    lam_x[free] = np.asarray(out["lam_x"]).ravel() / scale[free]
    lam_g = np.asarray(out["lam_g"]).ravel()
    if eliminate:
        x = problem.eliminated.complete(x, data)
        lam_g = problem.eliminated.multipliers(x, data, lam_g)
    seconds = {"build": built, "solve": time.process_time() - began}
    solution = _recompute(problem, x, data, lam_g, lam_x, stats, seconds)
    solution = replace(
        solution,
        parameters={
            n: data[p.first : p.first + p.value.size]
            for n, p in problem.parameters.items()
        },
    )
    log.debug("%s after %d iterations", solution.status, solution.iterations)
    if throw and not solution.success:
        raise not_converged(problem, solution)
    return solution


def solve_levels(
    problem: Problem,
    levels,
    start: dict[str, np.ndarray],
    options: SolverOptions | None = None,
    solvers: dict | None = None,
) -> Solution:
    """Run the levels of a homotopy, each from where the one before ended.

    `solvers` keeps what was built for a next call on the same problem.  The iterations
    and seconds of the result are summed; a level that fails does not stop the next, the
    last one decides.
    """
    options = options or SolverOptions()
    solvers = {} if solvers is None else solvers
    iterations, evaluations, seconds = [], 0, {"build": 0.0, "solve": 0.0}
    steps = []
    for level in levels:
        chosen = replace(options, barrier=level.barrier, iterations=level.iterations)
        key = (level.barrier, level.iterations, options.tolerance, options.time_limit)
        key += (level.eliminate,)
        began = time.process_time()
        if key not in solvers:
            solvers[key] = make_solver(problem, chosen, level.eliminate)
        seconds["build"] += time.process_time() - began
        solution = solve(
            problem,
            chosen,
            start=start,
            parameters=level.parameters,
            fixed=level.fixed,
            throw=False,
            solver=solvers[key],
            eliminate=level.eliminate,
        )
        start = solution.values
        iterations.append(solution.iterations)
        steps.append(solution.progress)
        evaluations += solution.evaluations
        seconds["solve"] += solution.seconds["solve"]
    return replace(
        solution,
        iterations=sum(iterations),
        iterations_by_level=tuple(iterations),
        evaluations=evaluations,
        seconds=seconds,
        progress=_joined(steps),
    )


def _joined(steps: list[dict]) -> dict[str, np.ndarray]:
    """Return the progress of all levels in a row, numbered by `level`."""
    names = [name for name in steps[-1] if name != "level"] if steps else []
    level = [np.full(len(s["level"]), k) for k, s in enumerate(steps)]
    joined = {name: np.concatenate([s[name] for s in steps]) for name in names}
    return {"level": np.concatenate(level), **joined} if names else {}


def _progress(stats: dict) -> dict[str, np.ndarray]:
    """Return what IPOPT says of each iteration; without any, empty arrays."""
    said = stats.get("iterations") or {}
    found = {name: np.array(said.get(key, []), float) for name, key in PROGRESS.items()}
    return {"level": np.zeros(len(found["objective"]), int), **found}


def _recompute(problem, x, data, lam_g, lam_x, stats, seconds) -> Solution:
    costs = {name: float(problem.value(name, x, data).sum()) for name in problem.costs}
    violations, multipliers = {}, {}
    for name, term in problem.constraints.items():
        value = problem.value(name, x, data)
        beyond = np.maximum(term.lower - value, value - term.upper)
        violations[name] = float(max(0.0, beyond.max()))
        multipliers[name] = lam_g[term.span].reshape(value.shape)
    finite = bool(np.all(np.isfinite(x))) and np.isfinite(sum(costs.values()))
    return Solution(
        values=problem.unpack(x),
        objective=float(sum(costs.values())),
        costs=costs,
        violations=violations,
        multipliers=multipliers,
        bound_multipliers=problem.unpack(lam_x),
        parameters={},
        success=bool(stats["success"]) and finite,
        status=str(stats["return_status"]),
        iterations=max(0, int(stats["iter_count"])),
        evaluations=int(stats.get("n_call_nlp_f", 0)),
        seconds=seconds,
        progress=_progress(stats),
    )


def not_converged(problem: Problem, solution: Solution) -> NotConverged:
    """Return the error that names the worst terms of a solution."""
    if solution.status == "Invalid_Option":
        return NotConverged(
            "IPOPT refused an option (Invalid_Option), nothing was solved",
            where="ipopt",
            expected="options of this build; its linear solvers are mumps and spral",
            problem=problem.describe(),
            solution=solution,
        )
    worst = sorted(solution.violations, key=solution.violations.get)[-3:][::-1]
    broken = [f"{n} by {solution.violations[n]:.2g}" for n in worst]
    heavy = sorted(solution.costs, key=solution.costs.get)[-3:][::-1]
    costs = [f"{n} {solution.costs[n]:.3g}" for n in heavy]
    return NotConverged(
        f"IPOPT says {solution.status} after {solution.iterations} iterations",
        where=f"{problem.size} unknowns, {problem.rows} constraints",
        got=f"violated: {', '.join(broken) or 'nothing'}; costs: {', '.join(costs)}",
        next="start closer, loosen the tolerance, or run problem.check()",
        problem=problem.describe(),
        solution=solution,
    )
