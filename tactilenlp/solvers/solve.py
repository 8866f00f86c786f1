"""Solve a Problem, once or along the levels of a continuation."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass, field, replace
from functools import cached_property

import casadi as ca
import numpy as np

from ..common.interrupt import interruptible
from ..common.validation import as_array, check_types
from ..errors import OptionError, PageError, shortened
from ..nlp.problem import Problem
from ..nlp.terms import check_declared
from .condensed_kkt import CondensedKkt
from .interior_point import InteriorPoint
from .options import MIN_SOLVE_TIME, NAMES, Settings, SolverOptions
from .solution import Solution, after, not_converged, recomputed, unfinished

log = logging.getLogger("tactilenlp")
MOST_IN_EQUATIONS = 200  # unknowns of equations: their block is dense in our method
LEVEL_DEFAULTS = {"mu_init": 1e-2, "max_iter": 200}  # of a level that does not set them


@dataclass(eq=False)
class Solvers:
    """The solvers of one problem, by their options, for further solves of it."""

    problem: Problem
    by_options: dict = field(default_factory=dict)

    def solver_for(self, options: SolverOptions, eliminate=False, warm=False):
        """Return a solver whose time limit ends by the deadline; it is made once.

        Functions and patterns take seconds of a large problem: they are made first.
        """
        problem = self.problem
        programme = problem.eliminated if eliminate else problem.assembly
        ours = not eliminate and set(options.ipopt) <= NAMES
        kkt = self.condensed if ours else None
        options.deadline.check()
        left = max(MIN_SOLVE_TIME, options.deadline.left)
        options = replace(options, time_limit=min(options.time_limit, left))
        named = options.named(warm).items()
        key = (*sorted(options.ipopt.items()), *named, options.push, eliminate, warm)
        if key not in self.by_options:
            self.by_options[key] = make_solver(programme, options, warm, kkt)
        return self.by_options[key]

    @cached_property
    def condensed(self) -> CondensedKkt | None:
        """The matrix of our method, None where there are too many equations for it."""
        problem = self.problem
        equal = problem.limits("lower") >= problem.limits("upper")
        if _read_by(problem, equal) > min(MOST_IN_EQUATIONS, problem.size // 2):
            return None
        of = problem.assembly
        return CondensedKkt(of.hessian, of.jacobian, equal)


def make_solver(programme, options: SolverOptions, warm: bool, kkt):
    """Return what solves a programme, called as a CasADi solver.

    The interior-point method of this package, which IPOPT takes over from where it is
    stuck, or IPOPT alone.  programme: an Assembly or an Eliminated; kkt: the
    CondensedKkt of an Assembly, None: IPOPT alone.
    """

    def ipopt(seconds: float):
        return make_ipopt(programme, replace(options, time_limit=seconds), warm)

    if kkt is None:
        return ipopt(options.time_limit)
    settings = Settings(**{**options.named(warm), **options.ipopt})
    return InteriorPoint((programme, kkt), settings, ipopt)


def make_ipopt(programme, options: SolverOptions, warm=False):
    """Return IPOPT as a CasADi solver of a programme; it shares the derivatives."""
    functions = programme.functions
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


def _read_by(problem, equal: np.ndarray) -> int:
    """Return how many unknowns are read by constraints some of whose rows are equal."""
    read = np.zeros(problem.size, bool)
    for term in problem.constraints.values():
        if equal[term.span].any():
            read[term.unknowns] = True
    return np.count_nonzero(read)


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
    """Minimise from `start` with some variables fixed; pages: see `solve_levels`.

    start: values by name, SI, by default the guesses; or a Solution of this problem,
    whose multipliers start the solver too (warm start).  eliminate: compute the
    unknowns that `follow` gives instead of solving for them.

    Raises NotConverged unless the solver succeeded or `throw` is False.
    """
    check_types(
        problem=(problem, Problem), options=(options, (SolverOptions, type(None)))
    )
    warm = start if isinstance(start, Solution) else None
    if not problem.variables:
        raise PageError("no unknowns", where="solve", next="declare nlp.variable(...)")
    began = time.process_time()
    programme = problem.eliminated if eliminate else problem.assembly
    if solver is None:
        options = options or SolverOptions()
        solver = Solvers(problem).solver_for(options, eliminate, warm is not None)
    built = time.process_time() - began
    data = problem.data(parameters)
    x, *bounds = _start(problem, (warm.values if warm else start) or {}, fixed)
    if eliminate:
        programme.check_unbounded(*bounds)
    began = time.process_time()
    with interruptible():
        out = solver(p=data, **_inputs(problem, programme, x, bounds, warm))
    x, *multipliers = _outputs(problem, programme, out, x, data, bounds)
    seconds = {"build": built, "solve": time.process_time() - began}
    terms = problem.assembly.values(x / problem.scale, data)
    solution = recomputed(
        problem, x, data, terms, *multipliers, solver.stats(), seconds, bounds
    )
    log.debug("%s after %d iterations", solution.status, solution.iterations)
    if throw and not solution.success:
        raise not_converged(problem, solution)
    return solution


def _span_of(problem, held):
    """Return the indices of a variable by its name, or those that are given."""
    if isinstance(held, str):
        return problem.variables[held].span
    where = as_array(held, "iu")
    if where is None or (where < 0).any() or (where >= problem.size).any():
        raise PageError(
            "no indices of unknowns", where="fixed", got=shortened(held, most=60),
            expected=f"names of variables, or indices below {problem.size}",
        )  # fmt: skip
    return where


def _inputs(problem, programme, x, bounds, warm: Solution | None) -> dict:
    """Return start, bounds and multipliers (of `warm`) as IPOPT takes them, scaled."""
    free, kept, scale = programme.free, programme.kept, problem.scale
    lower, upper = bounds
    inputs = {
        "x0": (x / scale)[free],
        "lbx": (lower / scale)[free],
        "ubx": (upper / scale)[free],
        "lbg": problem.limits("lower")[kept],
        "ubg": problem.limits("upper")[kept],
    }
    if warm:
        rows = [
            np.ravel(warm.multipliers.get(name, np.zeros(term.rows)))
            for name, term in problem.constraints.items()
        ]
        lam_x = problem.pack(warm.bound_multipliers) * scale
        inputs["lam_g0"] = np.concatenate([np.zeros(0), *rows])[kept]
        inputs["lam_x0"] = lam_x[free]
    return inputs


def _outputs(problem, programme, out, x, data, bounds) -> tuple:
    """Return x and the multipliers of constraints and bounds, of all, in SI.

    x: the start; bounds: of all unknowns, those that coincide hold one fixed.
    """
    free, fixed = programme.free, bounds[0] == bounds[1]
    scale, x, lam_x = problem.scale, x.copy(), np.zeros(problem.size)
    x[free] = np.asarray(out["x"]).ravel() * scale[free]
    lam_x[free] = _bound_multipliers(programme, out, data, fixed[free]) / scale[free]
    x, lam_g = programme.complete(x, data), np.asarray(out["lam_g"]).ravel()
    return x, programme.multipliers(x, data, lam_g), lam_x


def _bound_multipliers(programme, out, data, fixed) -> np.ndarray:
    """Return the multipliers of all bounds, scaled.

    IPOPT leaves fixed unknowns out and returns no multipliers for their bounds; they
    follow from the stationarity of the Lagrangian.
    """
    x, lam_g, multipliers = (
        np.asarray(out[name]).ravel() for name in ("x", "lam_g", "lam_x")
    )
    if fixed.any():
        slope, _ = programme.lagrangian(x, data, lam_g)
        multipliers[fixed] = -slope[fixed]
    return multipliers


def _start(problem, values, fixed):
    """Return a start within the bounds, and the bounds, equal where x is fixed."""
    names = [name for name in fixed if isinstance(name, str)]
    check_declared(names, problem.variables, "variable")
    lower, upper = problem.bounds("lower"), problem.bounds("upper")
    x = np.clip(problem.pack(values), lower, upper)
    for held in fixed:
        where = _span_of(problem, held)
        lower[where] = upper[where] = x[where]
    return x, lower, upper


def solve_levels(
    problem: Problem,
    levels,
    start: dict[str, np.ndarray] | Solution,
    options: SolverOptions | None = None,
    solvers: Solvers | None = None,
) -> Solution:
    """Run the levels of a continuation, each from the solution of the one before.

    solvers: of this problem, which further calls share; by default new.
    Iterations and seconds of the result are sums over the levels.  A level that fails
    does not stop the next; the status is that of the last.  At a deadline the levels
    that remain are not solved, and the result is marked as a failure.
    """
    options = options or SolverOptions()
    solvers = solvers or Solvers(problem)
    whole = None
    options.deadline.check()
    for level in levels:
        if whole is not None and options.deadline.left <= 0:
            return unfinished(whole)
        for ipopt, warm in _tries(level, start):
            solution = _at(solvers, level, ipopt, warm, start, options)
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


def _at(solvers: Solvers, level, ipopt, warm, start, options) -> Solution:
    """Solve one level from `start`; warm: with the multipliers of that solution."""
    began = time.process_time()
    chosen = replace(options, ipopt=ipopt | options.chosen | options.ipopt)
    solver = solvers.solver_for(chosen, level.eliminate, warm)
    built = time.process_time() - began
    if not warm and isinstance(start, Solution):
        start = start.values
    return solve(
        solvers.problem,
        start=start,
        parameters=level.parameters,
        fixed=level.fixed,
        throw=False,
        solver=solver,
        eliminate=level.eliminate,
    ).with_build(built)
