"""Search: where a local solve should start, over shapes and trajectories.

In: a `Job` (measurements, scene, shape, reductions).  Out: hypotheses, best first, each
a shape and a trajectory.  Of shapes with sizes: multi-hypothesis tracking, multistart.

- `multi_hypothesis`: the search for shapes with sizes, by the package `tracking`;
  `least_motion`: its tracks as optima of the page with least motion
- `contact_frame`: the frame of the first touch, in which bodies are searched
- `proposals_poses`: a body of one class on the poses of another
- `proposals_tumble`, `proposals_floating`: bodies that fall, bodies that float
- `multistart`: the page solved from starts, by successive halving
- `plane_slam`: several hypotheses of planes and poses of a polytope, along paths that
  pushes predict (`predicted_motion`), for several compliances (`soft_fingertips`);
  `polytope_init`: hulls of these planes; `vertex_number`: their fits, whose number of
  vertices is selected by evidence
"""
