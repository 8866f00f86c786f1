"""Local solves: a page solved from one hypothesis, its order beside others.

In: a `Job` (measurements, scene, shape, page), a `Hypothesis` (shape and trajectory).
Out: a `Solved` page: optimum, evidence, KKT system, fit, certificates.

- `local_solve`: from a hypothesis, from an earlier solution, by continuation;
  `levels`: the solves of a continuation; `transfer`: values and multipliers of a
  solution for a problem of other samples
- `comparison`: whether two hypotheses are the same body, or far from each other
- `solved`: a page as it is built and solved
- `margins`: how far objectives must differ before a choice depends on it
"""
