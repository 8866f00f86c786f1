"""Options of one solve, under our names and under IPOPT's."""

from __future__ import annotations

import math
import sys
from contextlib import suppress
from ctypes import CDLL
from dataclasses import dataclass, field, fields
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np

from ..common.deadline import NEVER, Deadline
from ..common.validation import check_numbers, check_types
from ..errors import OptionError, did_you_mean, typed_call

MIN_SOLVE_TIME = 0.02  # [s] of a solve beyond a limit: about one iteration
DEFAULTS = {"max_iter": 300, "mu_init": 1e-2}  # of a solve without levels
LINEAR_SOLVERS = {  # of IPOPT, and the library that it loads, None: its own
    "mumps": None, "spral": None, "pardiso": "pardiso",
    **dict.fromkeys(("ma27", "ma57", "ma77", "ma86", "ma97"), "hsl"),
}  # fmt: skip
SHARED = {"darwin": ".dylib", "win32": ".dll"}.get(sys.platform, ".so")
WARM_PUSH = 1e-6  # [-] by which a warm start and its multipliers are pushed inside
PUSH_OPTIONS = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac")
WARM_OPTIONS = [f"warm_start_{name}" for name in (*PUSH_OPTIONS, "mult_bound_push")]


def check_ipopt(ipopt) -> None:
    """Raise OptionError unless these can be options of IPOPT, by name.

    A linear solver whose library is missing ends the process in some builds of IPOPT.
    """
    check_types(ipopt=(ipopt, dict))
    kinds = bool, int, float, str, np.integer, np.floating
    check_types(**{f"ipopt {name}": (value, kinds) for name, value in ipopt.items()})
    solver = str(ipopt.get("linear_solver", "mumps")).lower()
    library = LINEAR_SOLVERS.get(solver, "")
    if library is None:
        return
    if library and has_library(str(ipopt.get(f"{library}lib", f"lib{library}"))):
        return
    here = [k for k, v in LINEAR_SOLVERS.items() if v is None or has_library(f"lib{v}")]
    raise OptionError(
        "no such linear solver of IPOPT here", where="ipopt linear_solver", got=solver,
        expected=f"one of {here}", next=did_you_mean(solver, here),
    )  # fmt: skip


@cache
def has_library(name: str) -> bool:
    """Tell whether a shared library can be loaded, from CasADi's folder too."""
    name = name if "." in name else f"{name}{SHARED}"
    for place in ("", Path(ca.__file__).parent):
        with suppress(OSError):
            return bool(CDLL(str(Path(place, name))))
    return False


def check_positive(options, *names: str) -> None:
    """Raise OptionError unless the named fields are positive numbers."""
    limits = {name: (getattr(options, name), 0, math.inf) for name in names}
    check_numbers("a positive number", **limits)


@typed_call()
@dataclass(frozen=True)
class SolverOptions:
    """Options of one solve.

    tolerance: of the scaled optimality conditions [-]; time_limit [s];
    iterations: at most [-]; barrier: IPOPT's first mu [-]: None as each level of a
    continuation says, or DEFAULTS; push: how far a start is pushed inside its bounds,
    relative [-]; ipopt: options passed on verbatim; deadline: by which all levels end.
    """

    tolerance: float = 1e-6
    time_limit: float = 60.0
    iterations: int | None = None
    barrier: float | None = None
    push: float = 1e-4
    ipopt: dict = field(default_factory=dict)
    deadline: Deadline = NEVER

    def __post_init__(self):
        check_ipopt(self.ipopt)
        check_types(deadline=(self.deadline, Deadline))
        check_types(iterations=(self.iterations, (int, np.integer, type(None))))
        chosen = [n for n in ("iterations", "barrier") if getattr(self, n) is not None]
        check_positive(self, "tolerance", "time_limit", "push", *chosen)

    @property
    def chosen(self) -> dict:
        """What was given in place of a level's own, under IPOPT's names."""
        options = {"max_iter": self.iterations, "mu_init": self.barrier}
        return {name: value for name, value in options.items() if value is not None}

    def named(self, warm: bool) -> dict:
        """Return the fields under IPOPT's names; warm: start with multipliers too."""
        return {
            "tol": self.tolerance,
            "constr_viol_tol": min(1e-6, self.tolerance),
            "max_wall_time": self.time_limit,
            "bound_push": WARM_PUSH if warm else self.push,
            **DEFAULTS,
            **self.chosen,
        }

    def for_nlpsol(self, warm: bool = False) -> dict:
        """Return the options as CasADi names them; warm: start with multipliers too."""
        ours = self.named(warm=False) | {
            "linear_solver": "mumps",
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


@dataclass(frozen=True)
class Settings:
    """Options of IPOPT that interior_point knows too, under their names.

    Counts may be zero, all others are positive: OptionError.
    """

    tol: float = 1e-8
    constr_viol_tol: float = 1e-4
    dual_inf_tol: float = 1.0
    compl_inf_tol: float = 1e-4
    max_iter: int = 3000
    max_wall_time: float = math.inf  # [s]
    mu_init: float = 0.1
    bound_push: float = 1e-2
    acceptable_tol: float = 1e-6
    acceptable_iter: int = 15
    acceptable_constr_viol_tol: float = 1e-2
    acceptable_compl_inf_tol: float = 1e-2
    acceptable_obj_change_tol: float = 1e20

    def __post_init__(self):
        for known in fields(self):
            name, count = known.name, known.type == "int"
            value = getattr(self, name)
            if count:
                check_types(**{name: (value, (int, np.integer))})
            expected = "a whole number from 0" if count else "a positive number"
            limits = -1 if count else 0, math.inf
            check_numbers(expected, **{f"ipopt {name}": (value, *limits)})


NAMES = {field.name for field in fields(Settings)}
