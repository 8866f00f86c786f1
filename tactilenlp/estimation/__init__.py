"""`solve_estimate`: request, search, refinement, certificates, `Estimate`.

In: `Measurements`, `Scene`, a shape, a page, `Options`, perhaps an earlier estimate.
Out: an `Estimate`: shape, poses, impulses, information, by name and in SI units.

- `request`, `options`: read and refuse what is asked;  `solver`: the steps in order
- `refinement`, `incremental_polytope`: the last solves, and updates by one action
- `readout`, `result`, `interrupted`: from a solution to an `Estimate`
- `observed_information`: information of other kinds, sensitivity to assumptions
"""
