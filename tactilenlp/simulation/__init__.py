"""Simulate fingers that push a rigid body, by MuJoCo.

In: a body and trajectories of fingers.  Out: `Measurements`, and the truth beside them.
No estimate reads the truth.

- `world`: `World.execute(trajectory)`, records, retracts and keeps the truth
- `mujoco_plant`: the model and its time steps
- `arguments`: their checks
"""
