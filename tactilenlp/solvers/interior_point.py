"""Our interior-point method called as a CasADi solver, with IPOPT as the last resort.

Where a run accepts no step, or one small step after another, a second run starts from
the last point, or from the original start if primal and dual infeasibility have both
grown; multipliers and barrier parameter are initialised anew.  If that fails too, IPOPT
solves the problem from the original start.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from .line_search import Stuck
from .options import MIN_SOLVE_TIME, Settings
from .primal_dual import Run
from .solution import ACCEPTED, PROGRESS, SOLVED

SECOND_MU = 1e-3  # of a second run: from 1e-1 it takes three times as many iterations


class InteriorPoint:
    """Called as a solver that `casadi.nlpsol` makes.

    programme: an nlp.assembly.Assembly and the CondensedKkt of its patterns;
    otherwise(seconds): makes IPOPT with a time limit.
    """

    def __init__(self, programme: tuple, settings: Settings, otherwise: Callable):
        self._programme, self._settings = programme, settings
        self._otherwise, self._stats = otherwise, {}

    def __call__(self, **inputs) -> dict:
        """Return x, lam_g and lam_x."""
        run = Run(*self._programme, self._settings, **inputs)
        try:
            run, status = self._minimised(run, inputs)
        except Stuck:
            left = self._settings.max_wall_time - (time.monotonic() - run.began)
            reference = self._otherwise(max(left, MIN_SOLVE_TIME))
            out, self._stats = reference(**inputs), reference.stats()
            return out
        columns = zip(*run.history, strict=True)
        self._stats = {
            "solver": "interior_point",
            "success": status in (SOLVED, ACCEPTED),
            "return_status": status,
            "iter_count": run.iterations,
            "n_call_nlp_f": run.evaluations,
            "iterations": dict(zip(PROGRESS.values(), columns, strict=True)),
        }
        return {"x": run.at.w[: run.n], "lam_g": run.y, "lam_x": run.bounds_of_x()}

    def _minimised(self, run: Run, inputs: dict) -> tuple[Run, str]:
        """Return run and status, of a second run where the first one is stuck."""
        try:
            return run, run.minimise()
        except Stuck:
            settings = replace(self._settings, mu_init=SECOND_MU)
            limits = {k: v for k, v in inputs.items() if not k.endswith("0")}
            restart = run.start if run.diverged() else run.at
            again = Run(*self._programme, settings, x0=restart.w[: run.n], **limits)
            again.continue_counts(run)
            return again, again.minimise()

    def stats(self) -> dict:
        return self._stats
