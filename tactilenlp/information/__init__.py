"""What an estimate tells, and how far off it may be: covariance by name.

In: a solved `Problem`.  Out: `Information` about shape and final pose.  The Hessian of
the Lagrangian is reduced to the null space of the active constraints, and all else is
marginalised by a Schur complement (Laplace approximation: Tierney and Kadane, J. Am.
Stat. Assoc. 81, 1986); nothing is solved here.

- `information`, `polytope_information`, `tangent_space`: what is known, what is open
- `trajectory`: deviations of the pose at every sample, and of finger offsets
- `goodness_of_fit`: expected and actual cost of the likelihood, a verdict
- `error_budget`: the errors that sigma covers, by name; `error_budget_terms`,
  `measurement_noise`, `consider_parameters`: each term; `mixture`: several local optima
- `sensitivity`, `comparisons`: parametric sensitivity; other kinds of information, gain
"""
