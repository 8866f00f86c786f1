"""From measurements and a scene to a filled page, with only what the scene needs.

In: `Measurements`, `Scene`, a shape, a page of `formulations`.  Out: a `Window` (plain
arrays and index lists that a page reads), and certificates of every reduction.

- `window`, `reductions`, `polytope_window`, `planes_window`, `fingertips`: windows
- `pages`, `poses`: pages and shapes by name; poses and corners of a body.  What differs
  by class is in `Shape` and in the class of its window
- `missing_samples`: what may have happened where a finger was not sensed
- `certificates`, `unreduced`, `static_friction`: check after a solve that a reduction
  was right
- `outliers`: touches that the assumed motion does not explain
"""
