r"""eq:loss_const by single shooting: the poses follow from the first ones.

    min  sum_t L_t(theta, x_t),   x_{t+1} = f_theta(x_t, x_{t-1}, r_t)
    over theta, depth, x_0 and the pose at the start of every later action

These are the equations of multiple_shooting.py.  Here the solver does not see the poses
as unknowns: they are computed from the first one of their action at every evaluation,
with exact gradient and Hessian (adjoint sweep, implicit function theorem).
"""

from __future__ import annotations

from dataclasses import replace

from . import multiple_shooting

build, REDUCTIONS = multiple_shooting.build, multiple_shooting.REDUCTIONS
LEVELS = tuple(replace(v, eliminate=True) for v in multiple_shooting.LEVELS)
