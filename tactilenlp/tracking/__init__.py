"""Multi-hypothesis tracking: iterated extended Kalman filters with a smoother.

In: starts of bodies, measurements, scene.  Out: smoothed trajectories, with evidence.

- `geometry`, `mapped`: gaps and normals of fingers at many bodies, compiled
- `pushing`, `filter_steps`: quasi-static pushing; prediction and correction, compiled
- `felt_pushes`: quasi-static pushing of bodies that are known where they are felt alone
- `process_noise`: how a body may move otherwise than predicted
- `initial_states`: where a body may be by the first touch
- `carried`: whether a box was carried between two actions
- `tracks`: what a track is; selection by evidence, splitting
- `tracking`: prediction and correction by an iterated extended Kalman filter; backward
  the smoother of Rauch, Tung and Striebel
- `surface`: points of the surface, and supports by which bodies are compared
- `standing`: a body as it stands on the ground, as it lies once it is let go
"""
