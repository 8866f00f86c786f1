"""Checks after a solve that what the page left out was right to leave out.

In: a `Solved` page and its `Job`.  Out: `Certificates`, one `Skipped` a reduction: what
was dropped, why, and by how much it would matter.  Exact reductions by the multipliers
of the unreduced problem at the solution, model reductions by touches that they leave
unexplained.

- `certify`: every reduction of a solved page, with its check, on the problem without
  reductions, built at the solution
- `static_friction`: what carries a body at rest
- `outliers`: touches that the assumed motion does not explain
"""
