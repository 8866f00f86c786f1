"""Search: where a local solve should start, over shapes and trajectories.

In: a `Job` (measurements, scene, shape, reductions).  Out: hypotheses, best first, each
a shape and a trajectory.  Multi-hypothesis search from action to action with an
extended Kalman filter, local solves of a cheap page, then multistart of the page.

- `hypothesis`, `margins`: what is compared, by body and by objective
- `kalman_filter`, `proposals`, `proposals_tumble`, `proposals_floating`: starts
- `local_solve`, `beam`, `multistart`, `alternatives`: solve, rank, select
- `plane_slam`, `polytope_init`: planes and poses of a polytope, then its vertices
"""
