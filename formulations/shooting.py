r"""eq:loss_const by single shooting: the poses follow from the first ones.

    min  sum_t L_t(theta, x_t),   x_{t+1} = f_theta(x_t, x_{t-1}, r_t)
    over theta, x_0 and the pose in which every later action finds the body

These are the equations of multiple_shooting.py; here the poses are no unknowns of the
solver: they are computed from the first one of their action at every evaluation, with
exact gradient and Hessian (adjoint sweep, theorem of implicit functions).
"""

from __future__ import annotations

from dataclasses import replace

from . import multiple_shooting

build, REDUCTIONS = multiple_shooting.build, multiple_shooting.REDUCTIONS
LEVELS = tuple(replace(v, eliminate=True) for v in multiple_shooting.LEVELS)
