"""IPOPT solves a Problem, once or along the levels of a continuation."""

from __future__ import annotations

import logging
import math
import time
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from ..common.deadline import NEVER, Deadline
from ..common.interrupt import interruptible
from ..common.validation import check_numbers, check_types
from ..errors import OptionError, shortened, typed_call
from .problem import Problem
from .solution import Solution, after, not_converged, recomputed, unfinished

log = logging.getLogger("tactilenlp")
WARM_PUSH = 1e-6  # [-] by which a warm start and its multipliers are pushed inside
PUSH_OPTIONS = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac")
WARM_OPTIONS = [f"warm_start_{name}" for name in (*PUSH_OPTIONS, "mult_bound_push")]
MIN_SOLVE_TIME = 0.02  # [s] of a solve beyond a deadline: about one iteration
LEVEL_DEFAULTS = {"mu_init": 1e-2, "max_iter": 200}  # of a level that does not set them


def check_positive(options, *names: str) -> None:
    """Raise OptionError unless the named fields are positive numbers."""
    given = {name: (getattr(options, name), 0, math.inf) for name in names}
    check_numbers("", "a positive number", **given)


@typed_call()
@dataclass(frozen=True)
class SolverOptions:
    """Options of one solve.

    tolerance: of the scaled optimality conditions [-]; time_limit [s];
    iterations: at most [-]; barrier: IPOPT's first mu [-]; push: how far a start is
    pushed inside its bounds, relative [-]; ipopt: options passed on verbatim; deadline:
    by which all levels of a continuation end.
    """

    tolerance: float = 1e-6
    time_limit: float = 60.0
    iterations: int = 300
    barrier: float = 1e-2
    push: float = 1e-4
    ipopt: dict = field(default_factory=dict)
    deadline: Deadline = NEVER

    def __post_init__(self):
        check_types(ipopt=(self.ipopt, dict), deadline=(self.deadline, Deadline))
        check_positive(self, "tolerance", "time_limit", "iterations", "barrier", "push")

    def for_nlpsol(self, warm: bool = False) -> dict:
        """Return the options as CasADi names them; warm: start with multipliers too."""
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
            # Other treatments evaluate the gradient twice an iteration.
            "fixed_variable_treatment": "make_parameter_nodual",
            "max_soc": 0,  # second-order corrections end at higher objectives
            "print_level": 0,
            "sb": "yes",
        }
        if warm:
            ours["warm_start_init_point"] = "yes"
            ours |= dict.fromkeys(WARM_OPTIONS, WARM_PUSH)
        return {f"ipopt.{k}": v for k, v in {**ours, **self.ipopt}.items()} | {
            "print_time": False,
            "error_on_fail": False,
            "no_nlp_grad": True,
            "calc_lam_p": False,
        }


def make_solver(problem, options: SolverOptions, eliminate=False, warm=False):
    """Return IPOPT as a CasADi solver of this problem; it shares the derivatives."""
    functions = (problem.eliminated if eliminate else problem).functions
    exact = {k: functions[k] for k in ("grad_f", "jac_g", "hess_lag")}
    settings = options.for_nlpsol(warm) | exact
    try:
        return ca.nlpsol("solver", "ipopt", functions["nlp"], settings)
    except RuntimeError as error:
        raise OptionError(
            "IPOPT does not accept these options",
            where="ipopt",
            got=f"{shortened(options.ipopt)}: {str(error).strip().splitlines()[-1]}",
            expected="names and values of IPOPT's documentation",
        ) from error


def solve(
    problem: Problem,
    options: SolverOptions | None = None,
    *,
    start: dict[str, np.ndarray] | Solution | None = None,
    parameters: dict | None = None,
    fixed: tuple[str, ...] = (),
    throw: bool = True,
    solver: ca.Function | None = None,
    eliminate: bool = False,
) -> Solution:
    """Minimise from `start` with some variables fixed.

    start: values by name, SI, by default the guesses; or a Solution of this problem,
    whose multipliers start the solver too (warm start).  eliminate: compute the
    unknowns that `follow` gives instead of solving for them.

    Raises NotConverged unless the solver succeeded or `throw` is False.
    """
    warm = start if isinstance(start, Solution) else None
    began = time.process_time()
    _part(problem, eliminate)
    options = _in_time(options or SolverOptions())
    solver = solver or make_solver(problem, options, eliminate, warm is not None)
    built = time.process_time() - began
    values = (warm.values if warm else start) or {}
    x, lower, upper = _start(problem, values, fixed)
    data = problem.data(parameters)
    began = time.process_time()
    inputs = _inputs(problem, x, lower, upper, warm, eliminate)
    with interruptible():
        out = solver(p=data, **inputs)
    found = _outputs(problem, out, x, data, lower == upper, eliminate)
    seconds = {"build": built, "solve": time.process_time() - began}
    x, lam_g, lam_x = found
    solution = recomputed(problem, x, data, lam_g, lam_x, solver.stats(), seconds)
    log.debug("%s after %d iterations", solution.status, solution.iterations)
    if throw and not solution.success:
        raise not_converged(problem, solution)
    return solution


def _in_time(options: SolverOptions) -> SolverOptions:
    """Return options whose time limit ends by the deadline, if there is one."""
    left = max(MIN_SOLVE_TIME, options.deadline.left)
    return options if options.time_limit <= left else replace(options, time_limit=left)


def _part(problem, eliminate) -> tuple[dict, object, object]:
    """Return functions, free unknowns and kept rows of what the solver is given.

    The first call assembles the functions, which takes seconds of a large problem:
    the time limit of a solver is set after it.
    """
    if not eliminate:
        return problem.functions, slice(None), slice(None)
    reduced = problem.eliminated
    return reduced.functions, reduced.free, reduced.kept


def _inputs(problem, x, lower, upper, warm: Solution | None, eliminate) -> dict:
    """Return start, bounds and multipliers (of `warm`) as IPOPT takes them, scaled."""
    _, free, kept = _part(problem, eliminate)
    scale = problem.scale
    inputs = {
        "x0": (x / scale)[free],
        "lbx": (lower / scale)[free],
        "ubx": (upper / scale)[free],
        "lbg": problem.limits("lower")[kept],
        "ubg": problem.limits("upper")[kept],
    }
    if warm:
        rows = [warm.multipliers[name].ravel() for name in problem.constraints]
        bounds = problem.pack(warm.bound_multipliers) * scale
        inputs["lam_g0"] = np.concatenate([np.zeros(0), *rows])[kept]
        inputs["lam_x0"] = bounds[free]
    return inputs


def _outputs(problem, out, x, data, fixed, eliminate) -> tuple:
    """Return x and the multipliers of constraints and bounds, of all, in SI.

    x: the start; fixed (unknowns,): whose bounds coincide.
    """
    functions, free, _ = _part(problem, eliminate)
    scale, x, lam_x = problem.scale, x.copy(), np.zeros(problem.size)
    x[free] = np.asarray(out["x"]).ravel() * scale[free]
    lam_x[free] = _bound_multipliers(functions, out, data, fixed[free]) / scale[free]
    lam_g = np.asarray(out["lam_g"]).ravel()
    if eliminate:
        x = problem.eliminated.complete(x, data)
        lam_g = problem.eliminated.multipliers(x, data, lam_g)
    return x, lam_g, lam_x


def _bound_multipliers(functions, out, data, fixed) -> np.ndarray:
    """Return the multipliers of all bounds, scaled.

    IPOPT leaves fixed unknowns out and returns no multipliers for their bounds; they
    follow from the stationarity of the Lagrangian.
    """
    multipliers = np.asarray(out["lam_x"]).ravel()
    if fixed.any():
        slope = np.asarray(functions["grad_f"](out["x"], data)[1]).ravel()
        jacobian = functions["jac_g"](out["x"], data)[1].sparse()
        slope += jacobian.T @ np.asarray(out["lam_g"]).ravel()
        multipliers[fixed] = -slope[fixed]
    return multipliers


def _start(problem, values, fixed):
    """Return a start within the bounds, and the bounds, equal where x is fixed."""
    names = [name for name in fixed if isinstance(name, str)]
    unknown = [name for name in names if name not in problem.variables]
    if unknown:
        raise OptionError(
            "no such variable",
            where="fixed",
            got=unknown,
            expected=f"names among {[*problem.variables]}",
        )
    lower, upper = problem.bounds("lower"), problem.bounds("upper")
    x = np.clip(problem.pack(values), lower, upper)
    for held in fixed:
        where = problem.variables[held].span if isinstance(held, str) else held
        lower[where] = upper[where] = x[where]
    return x, lower, upper


def solve_levels(
    problem: Problem,
    levels,
    start: dict[str, np.ndarray] | Solution,
    options: SolverOptions | None = None,
    solvers: dict | None = None,
) -> Solution:
    """Run the levels of a continuation, each from the solution of the one before.

    solvers: keeps the solvers that were built, for further calls on the same problem.
    Iterations and seconds of the result are sums over the levels.  A level that fails
    does not stop the next; the status is that of the last.  At a deadline the levels
    that remain are not solved, and the result is marked as a failure.
    """
    options = options or SolverOptions()
    solvers = {} if solvers is None else solvers
    whole = None
    options.deadline.check()
    for level in levels:
        if whole is not None and options.deadline.left <= 0:
            return unfinished(whole)
        for ipopt, warm in _tries(level, start):
            solution = _at(problem, level, ipopt, warm, start, options, solvers)
            whole = solution if whole is None else after(whole, solution)
            if solution.success or options.deadline.left <= 0:
                break
        # Multipliers of fixed unknowns are of no use to the next level.
        start = solution.values if level.fixed else solution
    return whole


def _tries(level, start) -> list[tuple[dict, bool]]:
    """Return the IPOPT options to try, each with whether multipliers are passed.

    Far from an optimum a small mu is slow even with good multipliers, so it is tried
    last there; a stiff problem may need it.
    """
    cold = LEVEL_DEFAULTS | level.ipopt
    if level.warm_start is None or not isinstance(start, Solution):
        return [(cold, False)]
    near = [(cold | level.warm_start, True)]
    return near if start.success else [(cold, True), *near]


def _at(problem, level, ipopt, warm, start, options, solvers) -> Solution:
    """Solve one level from `start`; warm: with the multipliers of that solution."""
    began = time.process_time()
    _part(problem, level.eliminate)
    options.deadline.check()
    chosen = _in_time(replace(options, ipopt=ipopt | options.ipopt))
    key = (*sorted(ipopt.items()), chosen.tolerance, chosen.time_limit)
    key += (level.eliminate, warm)
    if key not in solvers:
        solvers[key] = make_solver(problem, chosen, level.eliminate, warm)
    built = time.process_time() - began
    if not warm and isinstance(start, Solution):
        start = start.values
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
    solution.seconds["build"] += built
    return solution
