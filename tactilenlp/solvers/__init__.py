"""Interior-point methods that minimise a `Problem`, and what they found.

In: a `Problem` of the package nlp, a start, and the levels of a continuation.  Out: a
`Solution`, whose objective and violations are recomputed.  Both methods are primal-dual
barrier methods with a filter line search (Waechter and Biegler, Math. Program. 106).

- `solve`, `options`: one solve, or the levels of a page, each from the one before;
  IPOPT is the reference, for all problems, and wherever the other method fails
- `interior_point`: for problems with few equations; a step solves a system of the size
  of x: `primal_dual` (the algorithm), `line_search`, `condensed_kkt`,
  `bordered_ldl`, `sparse_ldl` (C)
- `solution`: values, costs, violations and multipliers by name
"""
