"""Nonlinear programmes whose unknowns and terms have names, with exact derivatives.

In: variables, parameters and terms, each a small function of a few local unknowns.
Out: a `Problem` and, at a solution, parametric sensitivities of its KKT system.
Nothing here depends on touch.

- `problem`, `terms`: state; `derivation`, `term_functions`: derive functions of terms
- `codegen`, `simd`, `compilation`: compile them, for several instances at once
- `assembly`: evaluate all terms together
- `kkt`: bordered factorisation; active set, sensitivity, Newton step
- `nlpsol`: as CasADi's solvers take it; unknowns that follow from others eliminated
- `diagnostics`, `derivative_check`: describe and check a problem before a solve
"""
