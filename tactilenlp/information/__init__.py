"""Covariance of an estimate: Laplace approximation and error budget, by name.

In: a solved `Problem`.  Out: `Information` about shape and final pose.  The Hessian of
the Lagrangian is reduced to the null space of the active constraints, and all else is
marginalised by a Schur complement (Laplace approximation: Tierney and Kadane, J. Am.
Stat. Assoc. 81, 1986); nothing is solved here.

- `laplace_approximation`, `information`: computed, then asked for by name
- `tangent_space`: coordinates of shape and final pose, and which of them are open
- `trajectory`: deviations of the pose at every sample, and of finger offsets
- `goodness_of_fit`: expected and actual cost of the likelihood, a verdict
- `error_budget`: the errors that sigma covers, by name; `error_budget_terms`,
  `measurement_noise`, `consider_parameters`: each term; `mixture`: several local optima
- `linearisation`: a solution to first order, parametric sensitivity
- `comparisons`: other kinds of information, gain
"""
