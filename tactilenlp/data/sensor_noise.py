"""How precise the sensors are, read from the data themselves.

A finger moves smoothly, and a normal turns slowly while it stays in contact: what third
differences of positions and second differences of normals leave is sensor noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import savgol_filter

from .measurements import Measurements

WINDOW = 9  # samples of the local parabola that smooths a noisy path (0.3 s at 30 Hz)
SMOOTH_ABOVE = 0.03  # [finger radii] below this noise, positions are used as they are
LAG = 5e-3  # [s] that a contact is felt longer than it lasts: sensors average
MEDIAN = 0.6745  # median of |z| for a standard normal z
MEDIAN_2 = 1.1774  # median of the length of a standard normal vector in the plane


@dataclass(frozen=True)
class Precision:
    """Standard deviations: position [m] per axis, normal [rad] per tangential axis."""

    position: float
    normal: float


def precision_of(data: Measurements, scene=None) -> Precision:
    """Estimate the precision of positions and normals; what the scene says wins."""
    return Precision(
        position=getattr(scene, "sigma_position", None) or _position(data),
        normal=getattr(scene, "sigma_normal", None) or _normal(data),
    )


def _position(data: Measurements) -> float:
    p, action = data.finger_position, data.action
    if len(p) < 4:
        return 0.0
    third = p[3:] - 3 * p[2:-1] + 3 * p[1:-2] - p[:-3]
    used = data.valid[3:] & (action[3:] == action[:-3])[:, None]
    if not used.any():
        return 0.0
    return float(np.median(np.abs(third[used])) / MEDIAN / np.sqrt(20))


def _normal(data: Measurements) -> float:
    n, c, action = data.normal, data.contact & data.valid, data.action
    if len(n) < 3:
        return 0.0
    run = c[2:] & c[1:-1] & c[:-2] & (action[2:] == action[:-2])[:, None]
    if not run.any():
        return 0.0
    second = (n[2:] - 2 * n[1:-1] + n[:-2])[run]
    return float(np.median(np.linalg.norm(second, axis=1)) / MEDIAN_2 / np.sqrt(6))


def smoothed(data: Measurements, precision: Precision) -> Measurements:
    """Return the data with noisy finger paths smoothed by local parabolas.

    White noise of a millimetre is four hundredths of a metre per second at 30 Hz: slip
    would drown in it.  Precise positions come back unchanged.
    """
    if precise(data, precision):
        return data
    p = data.finger_position.copy()
    for rows, S in smoothing(data, precision):
        p[rows] = np.tensordot(S, p[rows], axes=1)
    return replace(data, finger_position=p)


def smoothing(data: Measurements, precision: Precision):
    """Yield (rows, S) of every action: its samples, their smoothing matrix (n, n)."""
    for action in np.unique(data.action):
        rows = np.nonzero(data.action == action)[0]
        window = min(WINDOW, len(rows) - 1 + len(rows) % 2)
        S = np.eye(len(rows))
        if window >= 5 and not precise(data, precision):
            S = savgol_filter(S, window, 2, axis=0)
        yield rows, S


def precise(data: Measurements, precision: Precision) -> bool:
    """Tell whether positions are so precise that they are used as they are."""
    return precision.position < SMOOTH_ABOVE * data.finger_radius.min()


def contact_latency(data: Measurements) -> np.ndarray:
    """Return how far off a finger may be that is felt (T, F) [m]: one that just left.

    A boolean is a mean over some milliseconds, a position is that of an instant: a
    finger that feels nothing at the next sample may have parted before this one.
    """
    p, felt = data.finger_position, data.contact & data.valid
    goes_on = (data.action[1:] == data.action[:-1])[:, None]
    leaves = felt[:-1] & ~data.contact[1:] & data.valid[1:] & goes_on
    share = np.minimum(1.0, LAG / np.diff(data.time))[:, None]
    way = share * np.linalg.norm(np.diff(p, axis=0), axis=2)
    return np.vstack([np.where(leaves, way, 0.0), np.zeros(felt.shape[1])])
