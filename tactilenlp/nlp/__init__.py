"""Nonlinear programmes whose unknowns and terms have names, with exact derivatives.

In: variables, parameters and terms, each a small function of a few local unknowns.
Out: a `Problem`, its `Solution` by IPOPT, and parametric sensitivities of its KKT
system.  No tactile word stands here.

- `problem`, `terms`, `term_functions`, `assembly`, `codegen`: state, derive, compile
- `ipopt`, `solution`: solve level by level; recompute what the solver says
- `kkt`, `kkt_sensitivity`, `reduced_space`: bordered factorisation, active set, Newton
- `diagnostics`, `derivative_check`: describe and check a problem before a solve
"""
