"""What was measured, and what is known before: in SI units, checked on construction.

In: arrays or files.  Out: `Measurements`, `Scene`, `Trajectories`, frozen dataclasses.

- `measurements`, `trajectories`, `scene`, `joint_offsets`: the data classes
- `sensor_noise`: estimates the noise of positions and normals, smooths noisy paths
- `contact_segments`: spans of constant normal, and normals that are outliers
- `noise_model`: adds synthetic noise to clean measurements
"""
