"""Solves of the page after the search: multistart, model selection, profiles.

In: hypotheses of the search.  Out: the page solved, best first, certified.  In the
order in which an estimate (estimation/solver.py, optima.py) calls them:

- `incremental_polytope`: one more action of a polytope, the past as a Gaussian
- `incremental`: one more action of a shape with sizes, from few starts
- `refinement`: multistart from the promising hypotheses
- `sensor_lags`, `ground_tilt`: late sensors, a ground that leans, by Newton steps
- `nested_models`: turned sensors, compliance or centre of mass if evidence favours them
- `model_selection`: the most probable optimum, the likeliest class
- `axis_names`: the order of a box's axes; pages that tell them apart
- `certification`: restores what the package `certificates` finds wrongly left out;
  `rocking_body`: free motion of a body that rocks, started from what felt normals tell
- `profile_likelihood`, `profile_deviation`: sigma of sizes that no touch determines
"""
