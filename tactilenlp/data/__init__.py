"""What was measured, and what is known before: in SI units, checked on construction.

In: arrays or files.  Out: `Measurements`, `Scene`, `Trajectories`, frozen dataclasses.

- `measurements`, `trajectories`, `scene`, `ground`, `joint_offsets`: the data classes
- `plausibility`, `mistakes`: recordings with a mistake, as swapped fingers or axes
- `sensor_noise`: noise of positions and normals, smoothed paths; late contacts
- `contact_segments`, `touch_events`: spans of constant normal, outliers, onsets
- `noise_model`, `examples`: synthetic noise; the recordings in the package
"""
