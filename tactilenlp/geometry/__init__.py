"""Frames, convex hulls and their faces: geometry alone, nothing is solved here.

In: points, half-spaces, poses, estimates.  Out: rotations, hulls, faces, ways to tip.

- `transforms`: planar rotations, quaternions wxyz, poses, world to body frame
- `convex_hull`: half-space intersection, untouched side, centroid, closest point
- `simplification`: hulls of fewer vertices, of fewer faces, of more vertices
- `faces`: facets merged into faces, their planes and sigma; which of them a touch is of
- `interpolation`: gaps of time series
- `support`: where the ground carries a pushed body, and how near that is to tipping
- `tipping`: the kinematics of a body that tips over an edge
"""
