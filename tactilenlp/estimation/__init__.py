"""`solve_estimate`: request, search, refinement, certificates, `Estimate`.

In: `Measurements`, `Scene`, a shape, a page, `Options`, perhaps an earlier estimate.
Out: an `Estimate`: shape, poses, impulses, information, by name and in SI units.

- `request`, `options`: what is asked, and kept;  `solver`: the steps in order
- `refinement`, `certification`, `incremental_polytope`: solves after the search
- `model_selection`: compliance, centre of mass, tilt or another class if data ask
- `profile_likelihood`: sigma of sizes that no touch determines
- `readout`, `result`, `interrupted`: from a solution to an `Estimate`
- `observed_information`: information of other kinds, sensitivity to assumptions
"""
