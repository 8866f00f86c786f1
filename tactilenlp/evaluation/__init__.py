"""Errors of an estimate, where the truth is known.

In: surfaces, sizes and poses of two bodies.  Out: errors in SI units.

- `metrics`: exact surface distance, errors of size and pose modulo symmetry, and all of
  these for an estimate of a simulated world
"""
