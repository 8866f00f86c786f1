"""What a solve found: recomputed, named, with what the solver said of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from ..common.brief import printed
from ..common.deadline import TIME_LIMIT
from ..errors import NotConverged, PageError
from ..nlp.derivative_check import not_finite
from ..nlp.problem import Problem

REFUSED = "Invalid_Option"  # before the first iteration, whose number is then unset
INVALID = "Invalid_Number_Detected"  # IPOPT met NaN or infinity
PROGRESS = {  # our names for IPOPT's
    "objective": "obj", "primal": "inf_pr", "dual": "inf_du", "barrier": "mu",
}  # fmt: skip
# IPOPT's names of why it ended
SOLVED, ACCEPTED = "Solve_Succeeded", "Solved_To_Acceptable_Level"
TOO_MANY, TIME_EXCEEDED = "Maximum_Iterations_Exceeded", "Maximum_WallTime_Exceeded"
VIOLATED = "Constraints_Violated"  # status where IPOPT claims success
NOT_OPTIMAL = "Optimality_Conditions_Violated"  # likewise
# [-] at most, of a success: dual_inf_tol and acceptable_compl_inf_tol of IPOPT
OPTIMAL = {"stationarity": 1.0, "complementarity": 1e-2}
FEASIBLE = 1e-4  # [-] largest violation of a success: a hundred times constr_viol_tol


@printed
@dataclass(frozen=True, eq=False)
class Solution:
    """Where a solve ended: costs and violations are recomputed from the values.

    `success`: the solver says so, all numbers are finite, no constraint is violated by
    more than FEASIBLE, scaled as the solver sees it, and the other first-order
    conditions hold to OPTIMAL.  `status`: the solver's, VIOLATED or NOT_OPTIMAL;
    `solver`: the one that ended the solve, "interior_point" or "ipopt".

    `stationarity`: the largest |entry| of the gradient of the Lagrangian, and of the
    multipliers that push towards no limit; `complementarity`: the largest |multiplier
    times distance from its limit| of what is no equation (`violations` are these).
    Both are recomputed, in scaled unknowns; NaN where nothing was solved.

    `values` by variable name, SI, (rows, columns); `costs` by term, summed over the
    instances; `violations` by constraint, the largest; `multipliers` by constraint,
    (instances, rows), and of the bounds by variable name, (rows, columns), SI.
    `held` by variable name, masks (rows, columns) of the unknowns that it held fixed,
    without those of which it held none.  `progress` by iteration: level, objective,
    primal and dual infeasibility, barrier parameter; `seconds` of CPU time: "build",
    "solve".
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
    solver: str = ""
    stationarity: float = math.nan
    complementarity: float = math.nan
    held: dict[str, np.ndarray] = field(default_factory=dict)

    def at(self, problem) -> tuple[np.ndarray, np.ndarray]:
        """Return all unknowns and all data of a problem, as vectors, SI."""
        return problem.pack(self.values), problem.data(self.parameters)

    def with_build(self, seconds: float) -> Solution:
        """Return the solution with so much more time [s] to build its problem."""
        total = self.seconds["build"] + seconds
        return replace(self, seconds=self.seconds | {"build": total})


def recomputed(
    problem, x, data, terms, lam_g, lam_x, stats, seconds, bounds=None
) -> Solution:
    """Return the solution at x; terms: the value of each at every instance.

    bounds: lower and upper ones of x (unknowns,), SI, where it was solved.
    """
    costs = {name: float(terms[name].sum()) for name in problem.costs}
    violations, multipliers = {}, {}
    for name, term in problem.constraints.items():
        value = terms[name]
        beyond = np.maximum(term.lower - value, value - term.upper)
        violations[name] = float(np.maximum(0.0, beyond.max()))  # NaN stays
        multipliers[name] = lam_g[term.span].reshape(value.shape)
    finite = np.isfinite(np.r_[x, [*costs.values(), *violations.values()]]).all()
    errors = _kkt_errors(problem, x, data, lam_g, lam_x, bounds)
    success, status = bool(stats["success"] and finite), str(stats["return_status"])
    iterations = 0 if status == REFUSED else max(0, int(stats["iter_count"]))
    if success and max(violations.values(), default=0.0) > FEASIBLE:
        success, status = False, VIOLATED
    elif success and not all(errors[name] <= OPTIMAL[name] for name in errors):
        success, status = False, NOT_OPTIMAL
    return Solution(
        values=problem.unpack(x),
        objective=float(sum(costs.values())),
        costs=costs,
        violations=violations,
        multipliers=multipliers,
        bound_multipliers=problem.unpack(lam_x),
        parameters={n: data[p.span] for n, p in problem.parameters.items()},
        success=success,
        status=status,
        solver=str(stats.get("solver", "ipopt")),
        iterations=iterations,
        iterations_by_level=(iterations,),
        evaluations=int(stats.get("n_call_nlp_f", 0)),
        seconds=seconds,
        progress=_progress(stats),
        held={} if bounds is None else _held(problem, bounds),
        **errors,
    )


def _held(problem, bounds) -> dict[str, np.ndarray]:
    """Return masks, by name, of unknowns that bounds (lower, upper) alone hold."""
    fixed = problem.bounds("lower") == problem.bounds("upper")
    masks = problem.unpack((bounds[0] == bounds[1]) & ~fixed)
    return {name: mask for name, mask in masks.items() if mask.any()}


def _kkt_errors(problem, x, data, lam_g, lam_x, bounds) -> dict:
    """Return the fields of a Solution about the first-order optimality conditions."""
    if bounds is None:
        return {}
    scale = problem.scale
    slope, g = problem.assembly.lagrangian(x / scale, data, lam_g)
    value, multiplier = np.r_[x / scale, g], np.r_[lam_x * scale, lam_g]
    lower, upper = (
        np.r_[bound / scale, problem.limits(which)]
        for bound, which in zip(bounds, ("lower", "upper"), strict=True)
    )
    slack = np.where(multiplier > 0, upper - value, value - lower)
    slack[lower == upper] = 0.0  # of an equation it is the violation
    no_limit = np.isinf(slack)
    dual = np.r_[slope + lam_x * scale, multiplier[no_limit]]
    products = multiplier[~no_limit] * slack[~no_limit]
    return {
        "stationarity": float(np.abs(dual).max(initial=0.0)),
        "complementarity": float(np.abs(products).max(initial=0.0)),
    }


def after(first: Solution, then: Solution) -> Solution:
    """Return the second of two solves with what both took."""
    return replace(
        then,
        iterations=first.iterations + then.iterations,
        iterations_by_level=(*first.iterations_by_level, *then.iterations_by_level),
        evaluations=first.evaluations + then.evaluations,
        seconds={k: v + first.seconds.get(k, 0.0) for k, v in then.seconds.items()},
        progress=_joined(first.progress, then.progress, len(first.iterations_by_level)),
    )


def unfinished(solution: Solution) -> Solution:
    """Return a solution, marked: a deadline came before the levels that follow."""
    return replace(solution, success=False, status=TIME_EXCEEDED)


def evaluated(problem, values: dict, parameters: dict | None = None) -> Solution:
    """Return a start as if a solve had ended there for lack of time: not a success."""
    x, data = problem.pack(values), problem.data(parameters)
    stats = {"iter_count": 0, "success": False, "return_status": TIME_EXCEEDED}
    stats["solver"] = ""
    terms = {name: problem.value(name, x, data) for name in problem.terms}
    none = np.zeros(problem.rows), np.zeros(problem.size)
    seconds = {"build": 0.0, "solve": 0.0}
    return recomputed(problem, x, data, terms, *none, stats, seconds)


def _joined(first: dict, then: dict, levels: int) -> dict[str, np.ndarray]:
    """Return the progress of two solves in a row; the first one had so many levels."""
    then = {**then, "level": then["level"] + levels}
    return {name: np.concatenate([first[name], then[name]]) for name in then}


def _progress(stats: dict) -> dict[str, np.ndarray]:
    """Return what IPOPT says of each iteration; without any, empty arrays."""
    rows = stats.get("iterations") or {}
    by_name = {n: np.array(rows.get(key, []), float) for n, key in PROGRESS.items()}
    return {"level": np.zeros(len(by_name["objective"]), int), **by_name}


def check_finite(problem: Problem, solution: Solution) -> None:
    """Raise PageError with the terms that are not finite where a solve ended."""
    numbers = [*solution.costs.values(), *solution.violations.values()]
    if np.all(np.isfinite(numbers)) and solution.status != INVALID:
        return
    x, data = solution.at(problem)
    with np.errstate(all="ignore"):
        bad = list(not_finite(problem, x, data, "the end of the solve"))
    if bad:
        raise PageError(
            "the page has terms without a number",
            where=f"{solution.solver}: {solution.status}", got="; ".join(bad),
            expected="finite costs, constraints and derivatives",
            next="keep divisors, logarithms and roots away from zero; use functions "
            "of casadi, as float() and math make NaN of a symbol; problem.check() "
            "examines a page at its guess",
        )  # fmt: skip


def violation_in_words(violations: dict[str, float]) -> str:
    """Name the constraint that is violated most, and by how much.

    Pages divide constraints by a weight, a length or a scale: one tolerance is for all.
    """
    worst = max(violations, key=violations.get, default=None)
    if worst is None or violations[worst] == 0.0:
        return "no constraint is violated"
    return f"largest violation {violations[worst]:.1g} (dimensionless) of {worst!r}"


def _advice(solution: Solution, limit: bool) -> str:
    """Return what to do about a failed solve; limit: whether a time limit ended it."""
    if solution.status == TIME_EXCEEDED or limit:
        return "raise time_limit; the best so far is the error's `estimate`"
    if solution.status == REFUSED:
        return "leave out what this build of IPOPT does not have"
    return "start closer, loosen the tolerance, or run problem.check()"


def not_converged(problem: Problem, solution: Solution, estimate=None) -> NotConverged:
    """Return the error that names the worst terms of a solution; it has an estimate."""
    kept = {"problem": problem.describe(), "solution": solution, "estimate": estimate}
    worst = sorted(solution.violations, key=solution.violations.get)[-3:][::-1]
    broken = [
        f"{n} by {solution.violations[n]:.2g}" for n in worst if solution.violations[n]
    ]
    heavy = sorted(solution.costs, key=solution.costs.get)[-3:][::-1]
    costs = [f"{n} {solution.costs[n]:.3g}" for n in heavy]
    status = getattr(estimate, "status", solution.status)
    return NotConverged(
        f"{solution.solver or 'the solver'} says {solution.status} after "
        f"{solution.iterations} iterations{status.removeprefix(solution.status)}",
        where=f"{problem.size} unknowns, {problem.rows} constraints",
        got=f"violated: {', '.join(broken) or 'nothing'}; costs: {', '.join(costs)}",
        next=_advice(solution, TIME_LIMIT in status),
        **kept,
    )
