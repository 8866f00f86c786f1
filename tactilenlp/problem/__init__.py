"""From measurements and a scene to a filled page, with only what the scene needs.

In: `Measurements`, `Scene`, a shape, a page of `formulations`.  Out: a `Window` (plain
arrays and index lists that a page reads), and the `Problem` that the page poses of it.

- `job`: what is solved, with the caller's `options`; `hypothesis`: what a solve starts
  from
- `window`, `reductions`, `polytope_window`, `planes_window`, `fingertips`: windows;
  `skipped`: a reduction that was made, and its check
- `pages`, `poses`: pages and shapes by name; poses and corners of a body.  What differs
  by class is in `Shape` and in the class of its window
- `missing_samples`: what may have happened where a finger was not sensed
"""
