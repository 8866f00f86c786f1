"""A MuJoCo world in which fingers push a body, for tests, examples and studies.

In: a body and trajectories of fingers.  Out: `Measurements`, and the truth beside them.
No estimate reads the truth.

- `world`: `World.execute(trajectory)`, records and keeps the truth
- `mujoco_plant`: the model and its time steps
- `retraction`: how fingers leave after an action
"""
