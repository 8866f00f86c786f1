"""Choose the next touch by expected information gain, act, estimate, repeat.

In: an `Estimate`, a `Workspace`, a world with `execute`.  Out: `Choice`, `Step`, an
`Exploration` in a file.  The method is Bayesian experimental design: the push of an
action is predicted for each hypothesis, the Fisher information of its samples gives the
expected information gain, and nlopt maximises the mean over hypotheses.

- `action_space`, `action_search`, `optimisers`, `policies`: choice of an action
- `beliefs`, `polytope_beliefs`, `push_model`, `expected_information`: its expected gain
- `sweep`, `loop`, `options`, `log`: the loop, its settings and its file
"""
