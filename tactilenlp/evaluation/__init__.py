"""How far an estimate is from the truth, where a truth is known.

In: surfaces, sizes and poses of two bodies.  Out: errors in SI units.

- `metrics`: exact surface distance, and a cuboid's size and pose errors modulo
  symmetry
- `ground_truth`: the same for a world that keeps its truth
"""
