"""Sensor noise and latency: noise estimated from the data, paths smoothed and shifted.

A finger moves smoothly, and a normal changes slowly during contact: third differences
of positions and second differences of normals are dominated by sensor noise.  They are
divided differences, since sample times may be uneven.  Contacts and normals that are
reported r later than positions are those of fingers, and of a body, r earlier.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from .contact_segments import REPEATED, consecutive_contacts, intervals, rate_of
from .measurements import Measurements

LONG_PAUSE = 3.0  # [sample intervals] a longer one ends a run of samples
EVEN = 0.05  # [sample intervals] times that are off an even grid by less are on it
SMOOTHING_WINDOW = 9  # samples of the local parabola (0.3 s at 30 Hz)
LEAST_WINDOW = 5  # samples: parabolas through fewer leave most of the noise
SMOOTHERS = 64  # [1] smoothing matrices kept, of actions with other times
SMOOTHING_NOISE = 0.03  # [finger radii] positions with less noise are not smoothed
LATENCY = 20e-3  # [s] deviation of the latency: tactile cameras are up to 40 ms late
NORMAL_LAG = 10e-3  # [s] deviation of the lag of normals alone: means of up to 20 ms
SAME_NORMAL = 1e-9  # [-] by which two readings of one number may differ
NORMAL_MEDIAN = 0.6745  # median of |z| for a standard normal z
RAYLEIGH_MEDIAN = 1.1774  # median length of a standard normal vector in the plane
MEDIAN_ERROR = 1.004  # [-] relative deviation of a median of one length: of Rayleigh's
#                       law 0.721, times 1.393 as second differences overlap


@dataclass(frozen=True)
class Precision:
    """Standard deviations: position [m] per axis, normal [rad] per tangential axis.

    normal_error [-]: relative standard deviation of `normal`, zero where it was told.
    latency, latency_error [s]: by how much contacts and normals are reported later than
    positions, and its standard deviation; normal_lag, normal_lag_error [s]: by how much
    normals are later than contacts besides.  All zero where data do not ask for it.
    """

    position: float
    normal: float
    normal_error: float = 0.0
    latency: float = 0.0
    latency_error: float = 0.0
    normal_lag: float = 0.0
    normal_lag_error: float = 0.0


def precision_of(data: Measurements, scene=None) -> Precision:
    """Estimate the noise of positions and normals, unless the scene gives it."""
    position = getattr(scene, "sigma_position", None) or _position(data)
    latency = getattr(scene, "latency", None) or 0.0
    if told := getattr(scene, "sigma_normal", None):
        return Precision(position, told, latency=latency)
    return Precision(position, *_normal(data), latency=latency)


def _position(data: Measurements) -> float:
    """Return the noise of positions, of fingers that move: one at rest may be held."""
    p = data.finger_position
    if len(p) < 4:
        return 0.0
    third, used = noise_of_differences(data, p, 3)
    used &= data.valid[3:] & (np.ptp(_windows(p, 4), axis=3) > 0).any(axis=2)
    if not used.any():
        return 0.0
    return float(np.median(np.abs(third[used])) / NORMAL_MEDIAN)


def noise_of_differences(data, values, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Return divided differences (T - order, F, 3) of values (T, F, 3), and their use.

    They are scaled to the deviation of white noise, and vanish where values follow a
    polynomial of a lower order in time.  Used (T - order, F) are those within an
    action, without a long pause or a sample that has come twice.
    """
    time = _windows(data.time, order + 1)
    apart = time[:, :, None] - time[:, None] + np.eye(order + 1)
    weights = 1 / apart.prod(axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    differences = np.einsum("tk,tfck->tfc", weights, _windows(values, order + 1))
    used = data.action[order:] == data.action[:-order]
    steps = np.diff(time, axis=1) / intervals(data)[order:, None]
    used &= ((steps > REPEATED) & (steps <= LONG_PAUSE)).all(axis=1)
    return differences, np.repeat(used[:, None], values.shape[1], axis=1)


def _windows(values: np.ndarray, width: int) -> np.ndarray:
    """Return all runs of `width` samples of values (T, ...), along a last axis."""
    return np.lib.stride_tricks.sliding_window_view(values, width, axis=0)


def _normal(data: Measurements) -> tuple[float, float]:
    """Return the noise of normals, and the relative deviation of this estimate."""
    n, c = data.normal, data.contact
    if len(n) < 3:
        return 0.0, 0.0
    second, run = noise_of_differences(data, n, 2)
    run &= c[2:] & c[1:-1] & c[:-2]
    if not run.any():
        return 0.0, 0.0
    second = second[run]
    smooth = np.median(np.linalg.norm(second, axis=1)) / RAYLEIGH_MEDIAN
    error = MEDIAN_ERROR / np.sqrt(len(second))
    return float(max(smooth, _rounding_of_normals(data))), float(error)


def _rounding_of_normals(data: Measurements) -> float:
    """Return the noise [rad] of normals that are rounded to steps, 0 if none are.

    During contact they are then mostly the same to the last digit, and jump else, by a
    step at the median.  Readings that are the same have the same error: they count as
    one.
    """
    jumps = np.linalg.norm(np.diff(data.normal, axis=0), axis=2)
    jumps = jumps[consecutive_contacts(data)]
    changes = jumps[jumps > SAME_NORMAL]
    if not 0 < len(changes) < len(jumps) / 2:
        return 0.0
    return np.median(changes) / np.sqrt(12) * np.sqrt(len(jumps) / len(changes))


def smooth_paths(data: Measurements, precision: Precision) -> Measurements:
    """Return the data with noisy finger paths smoothed by local parabolas.

    White noise of 1 mm is 0.04 m/s at 30 Hz, more than the velocities of slip.  Precise
    positions are returned unchanged.
    """
    if precise(data, precision):
        return data
    p = data.finger_position.copy()
    for rows, S in smoothing_matrices(data, precision):
        p[rows] = np.tensordot(S, p[rows], axes=1)
    return replace(data, finger_position=p)


def smoothing_matrices(data: Measurements, precision: Precision):
    """Yield (rows, S) of every run of samples: its rows, their smoothing matrix (n, n).

    A run ends with its action, or before a long pause.
    """
    interval = intervals(data)
    ends = np.diff(data.time) > LONG_PAUSE * interval[1:]
    ends |= data.action[1:] != data.action[:-1]
    for rows in np.split(np.arange(data.samples), np.flatnonzero(ends) + 1):
        window = min(SMOOTHING_WINDOW, len(rows) - 1 + len(rows) % 2)
        if window < LEAST_WINDOW or precise(data, precision):
            yield rows, np.eye(len(rows))
            continue
        times = (data.time[rows] - data.time[rows[0]]) / interval[rows[0]]
        grid = np.arange(len(rows), dtype=float)
        even = np.abs(np.diff(times) - 1).max() < EVEN
        yield rows, local_parabolas(tuple(grid if even else times), window)


@lru_cache(SMOOTHERS)
def local_parabolas(times: tuple, window: int) -> np.ndarray:
    """Return the matrix (n, n) whose rows are values of parabolas fitted to `window`.

    times: of n samples [intervals].  The samples of a window are those around its own,
    or at an end the first or last.  It is the filter of Savitzky and Golay (Anal. Chem.
    36, 1964) at uneven times, which SciPy's does not take.
    """
    S, times = np.zeros((len(times), len(times))), np.array(times)
    for row in range(len(times)):
        first = min(max(0, row - window // 2), len(times) - window)
        columns = first + np.arange(window)
        S[row, columns] = np.linalg.pinv(np.vander(times[columns] - times[row], 3))[-1]
    S.flags.writeable = False  # it is shared
    return S


def variance_left(data: Measurements, precision: Precision) -> float:
    """Return the share of the noise variance that smoothing leaves [1], its mean."""
    left = [(S**2).sum(axis=1) for _, S in smoothing_matrices(data, precision)]
    return float(np.concatenate(left).mean())


def noise_at_edges(data: Measurements, precision: Precision) -> float:
    """Return the angle [rad] that the noise of smoothed positions makes of the radius.

    At an edge the body's normal points to the centre of the finger.  Precise positions
    turn it by nothing.
    """
    if precise(data, precision):
        return 0.0
    noise = precision.position * variance_left(data, precision) ** 0.5
    return noise / float(data.finger_radius.min())


def precise(data: Measurements, precision: Precision) -> bool:
    """Return whether positions are so precise that they are not smoothed."""
    return precision.position < SMOOTHING_NOISE * data.finger_radius.min()


def with_fingers_earlier(data: Measurements, lag: float) -> Measurements:
    """Return the data with every finger where it was a lag [s] before each sample."""
    if lag == 0:
        return data
    arrays = {"finger_position": shift_in_time(data, data.finger_position, -lag)}
    if (wxyz := data.finger_orientation) is not None:
        each = [shift_rotations(data, wxyz[:, f], -lag) for f in range(data.fingers)]
        arrays["finger_orientation"] = np.stack(each, axis=1)
    return replace(data, **arrays)


def normal_rates(data: Measurements) -> np.ndarray:
    """Return how fast felt normals (T, F, 3) change, per second.

    By central differences while contact lasts, which do not average a sample's own
    noise, by a backward difference where it ends.  Zero where contact begins: a
    sensor that averages has felt nothing earlier.
    """
    felt = consecutive_contacts(data)[..., None]
    step = np.where(felt, rate_of(data, data.normal)[1:], 0.0)
    none, no_pair = np.zeros_like(step[:1]), np.zeros_like(felt[:1])
    behind, ahead = np.vstack([none, step]), np.vstack([step, none])
    lasts = np.vstack([felt, no_pair])
    rate = np.where(lasts, (behind + ahead) / 2, behind)
    return np.where(np.vstack([no_pair, felt]), rate, 0.0)


def with_sensors_earlier(data: Measurements, sensors: Precision) -> Measurements:
    """Return the data as they would be if sensors were not late."""
    data = with_normals_earlier(data, sensors.normal_lag)
    return with_fingers_earlier(data, sensors.latency)


def with_normals_earlier(data: Measurements, lag: float) -> Measurements:
    """Return the data with every normal as it is felt a lag [s] after each sample."""
    if lag == 0:
        return data
    normal = data.normal + lag * normal_rates(data)
    length = np.linalg.norm(normal, axis=2, keepdims=True)
    return replace(data, normal=normal / np.maximum(length, 1e-9))


def shift_rotations(data: Measurements, wxyz, by: float) -> np.ndarray:
    """Return unit quaternions wxyz (T, 4) at other times, as of `shift_in_time`."""
    if by == 0:
        return wxyz
    # lazily: import stays light
    from scipy.spatial.transform import Rotation

    from ..geometry.transforms import quaternion_of, rotation_of, rotvecs

    turns = shift_in_time(data, rotvecs(rotation_of(wxyz).as_matrix()), by)
    return quaternion_of(Rotation.from_rotvec(turns))


def shift_in_time(
    data: Measurements, values: np.ndarray, by: float, beyond: bool = True
) -> np.ndarray:
    """Return values (T, ...) of the samples as they are at other times, later by [s].

    Linear between the samples of an action and, unless these are kept, beyond its first
    and last one.
    """
    out = values.copy()
    if by == 0:
        return out
    from scipy.interpolate import make_interp_spline  # lazily: import stays light

    least = REPEATED * intervals(data)
    for action in np.unique(data.action):
        rows = np.flatnonzero(data.action == action)
        apart = np.diff(data.time[rows], prepend=-np.inf) > least[rows]
        knots = rows[apart]  # a sample that has come twice tells no velocity
        if len(knots) > 1:
            line = make_interp_spline(data.time[knots], values[knots], k=1)
            then = data.time[rows] + by
            ends = data.time[rows[[0, -1]]]
            out[rows] = line(then if beyond else np.clip(then, *ends))
    return out


def reported_late(data: Measurements, latency: float) -> np.ndarray:
    """Return the samples (n,) of which late sensors tell only after their action."""
    last = np.searchsorted(data.action, data.action, side="right") - 1
    return np.flatnonzero(data.time > data.time[last] - latency)


def latency_cost(scene, precision: Precision) -> float:
    """Return the prior of a latency that was estimated [nats], and of the normals'.

    Zero if it was told.
    """
    if scene.latency is not None:
        return 0.0
    late, lag = precision.latency / LATENCY, precision.normal_lag / NORMAL_LAG
    return (late**2 + lag**2) / 2
