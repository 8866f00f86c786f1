"""Choose the next touch by expected information gain, act, estimate, repeat.

In: an `Estimate`, a `Workspace`, a world with `execute`.  Out: `Choice`, `Step`, an
`Exploration` in a file.  Expected information: pushes are predicted for samples of the
belief, and the information of what would be felt is averaged (Bayesian experimental
design); nlopt maximises it.

- `action_space`, `action_search`, `optimisers`, `policies`: which action
- `beliefs`, `polytope_beliefs`, `push_model`, `expected_information`: what it tells
- `first_touch`, `loop`, `log`: the loop, and the file that it keeps
"""
