"""output.colours."""

from __future__ import annotations

import numpy as np

# Information runs from blue (none) over pale to red (much), as in the paper's first
# figure; these three are told apart by the colour-blind (after Okabe and Ito).
BLUE, PALE, RED = (0, 114, 178), (240, 228, 200), (213, 60, 0)
# [m] deviations that are as blue, as red as can be
NOT_KNOWN, WELL_KNOWN = 10e-3, 0.1e-3


def information_colour(sigma) -> np.ndarray:
    """Return the colour (..., 3) [0..255] of a deviation [m]; grey where it is NaN."""
    sigma = np.asarray(sigma, float)
    with np.errstate(divide="ignore"):
        much = np.log(NOT_KNOWN / sigma) / np.log(NOT_KNOWN / WELL_KNOWN)
    much = np.clip(np.nan_to_num(much, nan=0.5, posinf=1, neginf=0), 0, 1)
    scale = np.array([BLUE, PALE, RED], float)
    mixed = np.stack([np.interp(much, [0, 0.5, 1], c) for c in scale.T], axis=-1)
    mixed[np.isnan(sigma)] = 170.0
    return mixed.round().astype(np.uint8)
