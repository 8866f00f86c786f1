"""`identify_body`: shape, inertia and friction from poses that a camera recorded.

In: `Trajectories` of a body that is tossed onto a ground.  Out: a `Body`.  No touch:
impacts are found in the poses, then one problem identifies all parameters.

- `identify`: the problem and its solve
- `impacts`: time steps, gravity, impacts and rest, vertices near the ground
- `starts`: first guesses of the proportions
- `body`: the result and its goodness of fit
"""
