"""The orientation of a body at the last sample: its turn about the ground's normal."""

from __future__ import annotations

import numpy as np

from ..data.ground import frame_of
from ..geometry.faces import is_hull

UNOBSERVED_TURN = 45.0  # [deg] of sigma beyond which a rotation is not observed


def orientation_of(estimate) -> str:
    """Return the orientation at the last sample, with its standard deviation."""
    if is_hull(estimate):  # it has no axes of its own
        return "with the axes of the world"
    yaw, off = np.degrees([yaw_of(estimate), sigma_of_yaw(estimate)])
    if off > UNOBSERVED_TURN:
        return "orientation not observed"
    axis = "the vertical" if is_level(estimate) else "the ground's normal"
    return f"turned by {yaw:.2f} ± {off:.2f} deg about {axis}"


def yaw_of(estimate) -> float:
    """Return the turn about the ground's normal at the last sample [rad].

    Of the body's x axis from that of the ground frame, the world's on level ground.
    """
    x, y, _ = frame_of(estimate.scene.ground).rotation @ estimate.rotation()[:, 0]
    return float(np.arctan2(y, x))


def sigma_of_yaw(estimate) -> float:
    """Return the standard deviation of the turn [rad]; in free motion the largest."""
    information = estimate.information
    if not estimate.reductions["planar"]:
        return float(np.nanmax(information.sigma("rotation")))
    n_w = np.array(frame_of(estimate.scene.ground).normal)
    variance = n_w @ np.nan_to_num(information.covariance("rotation")) @ n_w
    return float(np.sqrt(variance if variance >= 0 else np.inf))


def is_level(estimate) -> bool:
    """Tell whether the ground's normal is the vertical; also without a ground."""
    return frame_of(estimate.scene.ground).normal == (0.0, 0.0, 1.0)
