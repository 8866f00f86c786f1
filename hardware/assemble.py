"""Sample all streams of all fingers on one 30 Hz grid: Measurements.

Grid: from the first touch in the time range common to all streams to the end of that
range; nothing is extrapolated.  Positions: motor positions are interpolated linearly,
then mapped by the kinematics.  Contact: zero-order hold of the newest touch that is not
later than the sample (causal), at most 1.5 samples old, with its normal, rotated to the
world by the pose of the finger at the time of the touch; normals are not interpolated.
Once an action is over, the touch may be the one nearest in time instead.  The latency
of a sensor is subtracted first.  Samples are not valid where contact is felt without a
normal, nor where they are missing; too many missing ones are an error.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from tactilenlp.common.validation import check_range
from tactilenlp.data.measurements import Measurements

from .clock import near_samples
from .errors import ClockError, CompletenessError, LimitError
from .streams import (
    CONTACT,
    DECIDED,
    NORMAL,
    VALID,
    FingerStreams,
    Stream,
    StreamReport,
)

RATES = 1.0, 1000.0  # [Hz] of the grid
SHARES = 0.0, 2.0  # [1] of `complete`: above 1 nothing is complete enough
RATE = 30.0  # [Hz]; the formulations need a constant interval
OLDEST_TOUCH = 1.5  # [samples]
LARGEST_GAP = 0.02  # [s] between two positions of a motor
COMPLETE = 0.9  # [1], share of a finger's samples that must be valid
ROUNDING = 1e-6  # [s]: a stamp of 1.7e9 s has digits of 2.4e-7 s


@dataclass(frozen=True)
class Report:
    """Hold how complete the streams are, and which share of the grid is there.

    streams:  one report each
    valid:    [1], share of the samples by finger that came: also of those that are not
              valid since contact was felt without a normal
    oldest:   [s], largest age of a touch that was used, by finger
    """

    streams: tuple[StreamReport, ...]
    samples: int
    valid: dict[str, float]
    oldest: dict[str, float]

    def __str__(self) -> str:
        lines = [str(stream) for stream in self.streams]
        for name, share in self.valid.items():
            lines.append(
                f"{name}: {100 * share:.1f} % of {self.samples} samples valid, "
                f"oldest touch {1e3 * self.oldest[name]:.0f} ms"
            )
        return "\n".join(lines)


def assemble(
    fingers: Sequence[FingerStreams],
    rate: float = RATE,
    *,
    origin: float | None = None,
    start: float = -np.inf,
    end: float = np.inf,
    action: int = 0,
    parked: Collection[str] = (),
    complete: float = COMPLETE,
    nearest: bool = False,
) -> Measurements:
    """Return the measurements of one action.

    rate:     [Hz] of the grid
    origin:   [s] of the host that is time 0, None: the first sample
    start, end: [s] of the host, limits of the action
    parked:   names of fingers that take no part: not valid, not judged
    complete: [1], the least share of valid samples of each other finger
    nearest:  take the touch nearest in time instead of the newest one before: once all
              of the action is recorded, as it is not causal

    Raises CompletenessError with a report, ClockError if the streams do not overlap.
    """
    time = _grid(fingers, rate, start, end)
    parts = [_finger(one, time, OLDEST_TOUCH / rate, nearest) for one in fingers]
    _judge(_report(fingers, time, parts), parked, complete)
    takes_part = np.array([one.name not in parked for one in fingers])
    valid = np.stack([part["valid"] for part in parts], axis=1) & takes_part
    contact = np.stack([part["contact"] for part in parts], axis=1) & valid
    normal = np.stack([part["normal"] for part in parts], axis=1)
    return Measurements(
        time=time - (time[0] if origin is None else origin),
        finger_position=np.stack([part["position"] for part in parts], axis=1),
        finger_radius=np.array([one.geometry.tip_radius for one in fingers]),
        contact=contact,
        normal=np.where(contact[..., None], normal, 0.0),
        action=np.full(len(time), action),
        valid=valid,
    )


def examine(fingers: Sequence[FingerStreams], rate: float = RATE) -> Report:
    """Return how complete the streams are in their common range, without an error."""
    time = _grid(fingers, rate, -np.inf, np.inf)
    parts = [_finger(one, time, OLDEST_TOUCH / rate, False) for one in fingers]
    return _report(fingers, time, parts)


def _report(fingers: Sequence[FingerStreams], time: np.ndarray, parts: list) -> Report:
    named = list(zip([one.name for one in fingers], parts, strict=True))
    return Report(
        tuple(report for one in fingers for report in one.reports),
        len(time),
        {name: part["complete"] for name, part in named},
        {name: part["oldest"] for name, part in named},
    )


def _judge(report: Report, parked: Collection[str], complete: float) -> None:
    check_range("assemble, complete", complete, *SHARES, "", LimitError)
    for name, share in report.valid.items():
        if name not in parked and share < complete:
            raise CompletenessError(
                "too many samples are missing",
                where=name,
                got=f"{100 * share:.1f} % valid",
                expected=f"{100 * complete:.0f} % or more",
                next="see what `python -m hardware check` says of the streams",
                report=report,
            )


def _grid(
    fingers: Sequence[FingerStreams], rate: float, start: float, end: float
) -> np.ndarray:
    """Return the sample times (T,) [s] of the host."""
    check_range("assemble, rate", rate, *RATES, "Hz", LimitError)
    ranges = [(s.time[0], s.time[-1]) for one in fingers for s in one.boards]
    touch = [one.touch.time - one.latency for one in fingers]
    ranges += [(t[0], t[-1]) for t in touch]
    first = max(start, *(low for low, _ in ranges))
    last = min(end, *(high for _, high in ranges))
    inside = [t[(t >= first - ROUNDING) & (t <= last + ROUNDING)] for t in touch]
    if not all(map(len, inside)):
        raise ClockError(
            "the streams do not overlap",
            where="assemble",
            got=f"{last - first:.3f} s in common",
            expected="touches of every finger within the range of all encoders",
            next="are all stamps of one clock, are the latencies right?",
        )
    begin = max(first, min(t[0] for t in inside))
    return begin + np.arange(int((last - begin) * rate + ROUNDING) + 1) / rate


def _finger(
    one: FingerStreams, time: np.ndarray, oldest: float, nearest: bool
) -> dict[str, np.ndarray | float]:
    angles, moved = _angles(one, time)
    stamps = one.touch.time - one.latency
    # the newest touch that is not later than the sample
    row = np.maximum(np.searchsorted(stamps, time + ROUNDING, side="right") - 1, 0)
    if nearest:
        after = np.minimum(row + 1, len(stamps) - 1)
        row = np.where(abs(stamps[after] - time) < abs(time - stamps[row]), after, row)
    age = abs(time - stamps[row])
    touch = one.touch.values[row]
    contact, felt, decided = (touch[:, (CONTACT, VALID, DECIDED)] > 0).T
    felt_at, known = _angles(one, stamps[row])
    came = moved & known & decided & (age <= oldest + ROUNDING)
    valid = came & felt
    R_wt = one.geometry.rotation(felt_at)
    used = age[valid]
    return {
        "position": one.geometry.forward(angles),
        "contact": contact,
        "normal": np.einsum("nij,nj->ni", R_wt, touch[:, NORMAL]),
        "valid": valid,
        "complete": float(came.mean()),
        "oldest": float(used.max()) if used.size else np.nan,
    }


def _angles(one: FingerStreams, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return joint angles (n, 3) [rad] at times, and where they are known (n,)."""
    parts = [_interpolated(stream, time) for stream in one.boards]
    turns = np.stack([values for values, _ in parts], axis=1)
    return one.joints.angles(turns), parts[0][1] & parts[1][1]


def _interpolated(stream: Stream, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return values (n, 2) between neighbours, and whether these are close enough."""
    known = stream.time
    close = near_samples(known, time, LARGEST_GAP, ROUNDING)
    inside = (time >= known[0] - ROUNDING) & (time <= known[-1] + ROUNDING)
    columns = [np.interp(time, known, values) for values in stream.values.T]
    return np.stack(columns, axis=-1), inside & close
