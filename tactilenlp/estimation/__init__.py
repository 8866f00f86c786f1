"""`solve_estimate`: request, search, refinement, certificates, `Estimate`.

In: `Measurements`, `Scene`, a shape, a page, `Options`, perhaps an earlier estimate.
Out: an `Estimate`: shape, poses, impulses, information, by name and in SI units.

- `solver`: the steps in order, for one class of shapes or several
- `initial_search`, `optima`: hypotheses of the search; optima of the page, which is
  solved after every action where the fit is not good
- `second_searches`: what a first search found that calls for another
- `few_starts`: an estimate is continued from few starts before others are searched for
- `coarse_to_fine`: recordings of a high rate, solved at a lower rate first
- `interrupted`: Ctrl-C, the time limit, estimates marked as failed
- `compile_ahead`: functions that are compiled before they are needed
- `observed_information`: the programme of an estimate, built again; information of
  other kinds, sensitivity to assumptions
"""
