r"""eq:loss_const by single shooting: the poses follow from the first ones.

    min  sum_t L_t(theta, x_t), way between actions, priors    (multiple_shooting.py)
         with x_{t+1} = f_theta(x_t, x_{t-1}, r_t)                (time_stepping.py)
    over theta, d, x_0, the pose at the start of every later action; where unknown mu

These are the equations of multiple_shooting.py.  Here the solver does not see the poses
as unknowns: they are computed from the first one of their action at every evaluation,
with exact gradient and Hessian (adjoint sweep, implicit function theorem).
"""

from __future__ import annotations

from dataclasses import replace

from . import multiple_shooting

build, REDUCTIONS = multiple_shooting.build, multiple_shooting.REDUCTIONS
LEVELS = tuple(replace(v, eliminate=True) for v in multiple_shooting.LEVELS)
