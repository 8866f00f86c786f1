"""`identify_body`: shape, inertia and friction from poses that a camera saw.

In: `Trajectories` of a body that is tossed onto a ground.  Out: a `Body`.  No touch:
impacts are found in the poses, then one programme identifies all parameters.

- `identify`: the programme and its solve
- `impacts`: time steps between impacts, gravity, points near the ground
- `body`: the result
"""
