"""Colours of standard deviations and of fingers, in all outputs."""

from __future__ import annotations

import numpy as np

# The colour-blind can distinguish these (Okabe and Ito, "Color Universal Design", then
# Tol, "Colour Schemes", 2021: muted).
FINGER_RGB = (
    (0, 158, 115), (204, 121, 167), (230, 159, 0), (240, 228, 66),
    (51, 34, 136), (136, 34, 85), (136, 204, 238), (153, 153, 51),
)  # fmt: skip
# Information runs from blue (none) to red (much), as in the paper's first figure.
BLUE, PALE, RED = (0, 114, 178), (240, 228, 200), (213, 60, 0)
UNKNOWN_SIGMA, WELL_KNOWN_SIGMA = 10e-3, 0.1e-3  # [m] of pure blue, of pure red


def information_colour(sigma) -> np.ndarray:
    """Return the colour (..., 3) [0..255] of a standard deviation [m]; grey for NaN."""
    sigma = np.asarray(sigma, float)
    with np.errstate(divide="ignore"):
        much = np.log(UNKNOWN_SIGMA / sigma) / np.log(UNKNOWN_SIGMA / WELL_KNOWN_SIGMA)
    much = np.clip(np.nan_to_num(much, nan=0.5, posinf=1, neginf=0), 0, 1)
    scale = np.array([BLUE, PALE, RED], float)
    mixed = np.stack([np.interp(much, [0, 0.5, 1], c) for c in scale.T], axis=-1)
    mixed[np.isnan(sigma)] = 170.0
    return mixed.round().astype(np.uint8)
