"""The orientation of a body at the last sample: its turn about the ground's normal."""

from __future__ import annotations

import numpy as np

from ..data.ground import frame_of
from ..geometry.faces import is_hull

UNOBSERVED_TURN = 45.0  # [deg] of sigma beyond which a rotation is not observed
ON_END = np.sqrt(0.5)  # [-] sine of the slope beyond which an axis is on end


def orientation_of(estimate) -> str:
    """Return the orientation at the last sample, with its standard deviation."""
    if is_hull(estimate):  # it has no axes of its own
        return "with the axes of the world"
    yaw, off = np.degrees([yaw_of(estimate), sigma_of_yaw(estimate)])
    if off > UNOBSERVED_TURN:
        return "orientation not observed"
    axis = "the vertical" if is_level(estimate) else "the ground's normal"
    end = ", its x axis on end" if stands_on_x(_in_ground(estimate)) else ""
    return f"turned by {yaw:.2f} ± {off:.2f} deg about {axis}{end}"


def yaw_of(estimate) -> float:
    """Return the turn about the ground's normal at the last sample [rad].

    Of the body's x axis from that of the ground frame, the world's on level ground.
    Where x is on end and has no heading, that of where x was before the body tipped
    over its y axis: of z if x points down, of -z if it points up.
    """
    R = _in_ground(estimate)
    heading = -np.sign(R[2, 0]) * R[:, 2] if stands_on_x(R) else R[:, 0]
    return float(np.arctan2(heading[1], heading[0]))


def stands_on_x(R) -> bool:
    """Tell whether the x axis of a body of rotation R is steeper than 45 degrees."""
    return abs(R[2, 0]) > ON_END


def _in_ground(estimate) -> np.ndarray:
    """Return the last rotation (3, 3) from the body to the frame of the ground."""
    return frame_of(estimate.scene.ground).rotation @ estimate.rotation()


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
