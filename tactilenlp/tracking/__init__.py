"""Track many boxes at once through what the fingers felt, as a filter with a smoother.

In: starts of boxes, measurements, scene.  Out: smoothed paths, with their evidence.

- `box_contact`: gaps, normals and slopes of fingers at many boxes
- `pushing`: prediction, quasi-static pushing of upright boxes
- `tracks`: what a track is; selection by evidence, splitting
- `tracking`: prediction and correction by an iterated extended Kalman filter
- `smoother`: backward, Rauch-Tung-Striebel
"""
