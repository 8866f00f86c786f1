"""Search: where a local solve should start, over shapes and trajectories.

In: a `Job` (measurements, scene, shape, reductions).  Out: hypotheses, best first, each
a shape and a trajectory.  Boxes: multi-hypothesis tracking, then multistart.

- `multi_hypothesis`: the search for boxes, of the package `tracking` and `least_motion`
- `proposals_poses`: a body of one class on the poses of another
- `proposals_tumble`, `proposals_floating`: bodies that fall, bodies that float
- `multistart`: the page solved from starts, by successive halving
- `plane_slam`: several hypotheses of planes and poses of a polytope, along paths that
  pushes predict; `polytope_init`: its vertices, as many as the evidence asks for
"""
