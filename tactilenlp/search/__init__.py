"""Find where a local solve should start: a global search over shapes and paths.

In: a `Job` (measurements, scene, shape, reductions).  Out: hypotheses, best first, each
a shape and a path.  Multi-hypothesis search from action to action with an extended
Kalman filter, local solves of a cheap page, and multistart of the page asked for.

- `hypothesis`, `proposals`, `proposals_tumble`, `proposals_floating`, `kalman_filter`
- `beam`, `local_solve`, `multistart`, `alternatives`: rank, solve, select
- `plane_slam`, `polytope_init`: planes and poses of a polytope, then its vertices
"""
