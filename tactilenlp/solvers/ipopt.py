"""IPOPT as a CasADi solver of a Problem."""

from __future__ import annotations

import casadi as ca

from ..errors import OptionError, shortened
from .options import SolverOptions


def make_ipopt(problem, options: SolverOptions, eliminate=False, warm=False):
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
