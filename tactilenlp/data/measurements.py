"""Measurements of the fingers: arrays in SI units, checked on construction."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..common.brief import same_content, shown
from ..common.npz import read_npz, write_npz
from ..common.validation import (
    as_array,
    as_floats,
    check_types,
    checked_choice,
    is_rotation,
)
from ..errors import MeasurementError, shortened, typed_call
from ..geometry.interpolation import fill_gaps

UNIT_TOLERANCE = 1e-3  # [1], beyond it a vector is wrong, not merely rounded
UNIT_EXACT = 1e-12  # [1], below it a length is left alone: round trips stay exact
ROTATION_TOLERANCE = 1e-6  # [1], largest entry of R R' - 1
LARGEST_RADIUS = 0.2  # [m], a fingertip is smaller: beyond it the file is in mm
SMALLEST_RADIUS = 1e-5  # [m], no fingertip is sharper
FARTHEST = 1e4  # [m] from the world's origin: beyond it doubles lose digits that count
LARGEST_SPREAD = 10.0  # [m], no hand reaches further: beyond it the file is in mm
LONGEST_INTERVAL = 5.0  # [s], 30 Hz data in milliseconds have 33
# The documented keys: axes (T samples, F fingers), what is expected, dtypes accepted.
LAYOUT = {
    "time": (("T",), "[s], increasing", "iuf"),
    "finger_position": (("T", "F", 3), f"[m], within {LARGEST_SPREAD} m", "iuf"),
    "finger_radius": (("F",), f"[m], {SMALLEST_RADIUS} to {LARGEST_RADIUS}", "iuf"),
    "contact": (("T", "F"), "True (1) or False (0)", "biuf"),
    "normal": (("T", "F", 3), "unit vectors, zero without contact", "iuf"),
    "action": (("T",), "whole numbers, non-decreasing", "iu"),
    "valid": (("T", "F"), "True (1) or False (0)", "biuf"),
    "finger_orientation": (("T", "F", 4), "unit quaternions wxyz", "iuf"),
}
OPTIONAL_KEYS = ("valid", "finger_orientation")


@shown
@typed_call()
@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Measurements:
    """T samples of F fingers, in SI units and in the world frame.

    time:               (T,) [s], increasing; jumps between actions
    finger_position:    (T, F, 3) [m], centres of the fingertips
    finger_radius:      (F,) [m], or one number for all fingers
    contact:            (T, F) bool
    normal:             (T, F, 3), unit, out of the object, zero without contact
    action:             (T,) int, number of the sample's action, non-decreasing: one
                        motion of the fingers towards the object, recorded whole; one
                        single action (all zeros) is fine
    valid:              (T, F) bool, False: no measurement, contact and normal are
                        ignored (kept as False and zero); the position counts: a
                        NaN there is replaced, linearly in time within its action
    finger_orientation: (T, F, 4) wxyz, finger to world; None for spheres

    Arrays are read-only copies; a MeasurementError names the key and first bad index.
    """

    time: np.ndarray
    finger_position: np.ndarray
    finger_radius: np.ndarray
    contact: np.ndarray
    normal: np.ndarray
    action: np.ndarray
    valid: np.ndarray | None = None
    finger_orientation: np.ndarray | None = None

    def __post_init__(self) -> None:
        values = {k: v for k in LAYOUT if (v := getattr(self, k)) is not None}
        arrays = _shaped({key: _array(key, value) for key, value in values.items()})
        arrays.setdefault("valid", np.ones(arrays["contact"].shape))
        _check_fingers(arrays)
        _check_time(arrays["time"], arrays["action"])
        _check_touch(arrays)
        for key, array in arrays.items():
            array.setflags(write=False)
            object.__setattr__(self, key, array)

    @classmethod
    def load(cls, path: str | os.PathLike) -> Measurements:
        """Read the documented keys of an .npz file; ignore all others."""
        return cls(**dict.fromkeys(LAYOUT) | read_npz(path, LAYOUT))

    def save(self, path: str | os.PathLike) -> None:
        """Write an .npz file that loads to equal Measurements, to the last digit."""
        write_npz(path, self.arrays())

    @property
    def samples(self) -> int:
        """The number of samples T."""
        return len(self.time)

    @property
    def fingers(self) -> int:
        """The number of fingers F."""
        return len(self.finger_radius)

    @property
    def actions(self) -> int:
        """The number of distinct actions."""
        return len(np.unique(self.action))

    @property
    def dt(self) -> float:
        """The median sample interval within actions [s]."""
        dt = _interval(self.time, self.action)
        _reject("time", np.isnan(dt), "no interval", self, "record longer actions")
        return dt

    def append(self, other: Measurements) -> Measurements:
        """Return these data followed by those of `other`, its actions renumbered."""
        check_types(other=(other, Measurements))
        ours, theirs = self.arrays(), other.arrays()
        radius, end = self.finger_radius, self.time[-1]
        differ = not np.array_equal(radius, other.finger_radius)
        fix = f"the fingers so far have {radius.tolist()} m"
        _reject("finger_radius", differ, "other fingers", other.finger_radius, fix)
        differ, fix = ours.keys() != theirs.keys(), "give it in both or in none"
        _reject("finger_orientation", differ, "in one of two", sorted(theirs), fix)
        fix = f"start after {end} s, where the data end: one clock for all actions"
        _reject("time", other.time[:1] <= end, "does not go on", other.time, fix)
        rank = np.unique(other.action, return_inverse=True)[1].reshape(-1)
        theirs["action"] = self.action[-1] + 1 + rank
        joined = {key: np.concatenate([ours[key], theirs[key]]) for key in ours}
        return Measurements(**joined | {"finger_radius": radius})

    def select(self, actions: Iterable[int]) -> Measurements:
        """Return the samples of these actions, in time order; numbers are kept."""
        numbers = np.unique(self.action)
        wanted = checked_choice("action", actions, numbers, MeasurementError)
        return Measurements(**self.arrays(np.isin(self.action, wanted)))

    def transformed(self, R: np.ndarray, t: np.ndarray) -> Measurements:
        """Return the data in a frame v: p_v = R p_w + t, R (3, 3), t (3,) [m]."""
        R_vw, t_vw = as_floats(R), as_floats(t)
        if t_vw.shape != (3,) or not is_rotation(R_vw, ROTATION_TOLERANCE):
            raise MeasurementError(
                "not a rigid motion", where="R, t", got=shortened((R, t), most=200),
                expected="a rotation matrix (3, 3) and an offset (3,) [m]",
                next="check R R' = 1",
            )  # fmt: skip
        arrays = self.arrays() | {"normal": self.normal @ R_vw.T}
        arrays["finger_position"] = self.finger_position @ R_vw.T + t_vw
        if (wxyz := self.finger_orientation) is not None:
            from scipy.spatial.transform import Rotation  # import stays light

            from ..geometry.transforms import quaternion_of, rotation_of

            R_vf = Rotation.from_matrix(R_vw) * rotation_of(wxyz.reshape(-1, 4))
            arrays["finger_orientation"] = quaternion_of(R_vf).reshape(wxyz.shape)
        return Measurements(**arrays)

    def is_prefix_of(self, other: Measurements) -> bool:
        """Return whether `other` begins with exactly these data."""
        check_types(other=(other, Measurements))
        return same_content(self.arrays(), other.arrays(slice(self.samples)))

    def __eq__(self, other: object) -> bool:
        same = isinstance(other, Measurements) and self.samples == other.samples
        return same and self.is_prefix_of(other)

    def __reduce__(self):
        # Unpickled arrays would be writable; the constructor makes them read-only.
        return partial(Measurements, **self.arrays()), ()

    def __repr__(self) -> str:
        contacts, lost = self.contact.sum(), (~self.valid).sum()
        return (
            f"Measurements({self.samples} samples, actions: {self.actions}, "
            f"fingers: {self.fingers}, contacts: {contacts}, not valid: {lost})"
        )

    def arrays(self, rows: np.ndarray | slice = slice(None)) -> dict[str, np.ndarray]:
        """Return the arrays of some samples by name, as the constructor takes them."""
        arrays = {k: v for k in LAYOUT if (v := getattr(self, k)) is not None}
        radius = arrays.pop("finger_radius")
        return {k: v[rows] for k, v in arrays.items()} | {"finger_radius": radius}


def _reject(key: str, bad: np.ndarray | bool, what: str, got: object, fix: str) -> None:
    """Raise if anything is bad; where `bad` is an array, name its first bad entry."""
    if not np.any(bad):
        return
    index = tuple(np.argwhere(bad)[0].tolist()) or None
    if index:
        what, got = f"{what} at index {index}", got[index].tolist()
    axes, meaning, _ = LAYOUT[key]
    raise MeasurementError(
        what, index=index, where=key, got=f"{got}", next=fix,
        expected=str(axes).replace("'", "") + f" {meaning}",
    )  # fmt: skip


def _array(key: str, value: object) -> np.ndarray:
    """Return a fresh contiguous array of numbers, not yet checked any further."""
    array, fix = as_array(value, LAYOUT[key][2]), "give one array of plain numbers"
    if isinstance(value, np.ma.MaskedArray):
        fix = "fill it, and state what was not measured by valid="
    of = f"{type(value).__name__}, dtype {getattr(value, 'dtype', 'object')}"
    _reject(key, array is None, "wrong dtype", of, fix)
    if key == "action":
        _reject(key, array > np.iinfo(np.int64).max, "too large", array, "number anew")
        return np.array(array, dtype=np.int64, order="C")
    return np.array(array, dtype=float, order="C")


def _shaped(arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Check that keys are there, that T and F agree; give every finger a radius."""
    sizes: dict = {3: 3, 4: 4}
    for key, (axes, _, _) in LAYOUT.items():
        if key not in arrays:
            missing, fix = key not in OPTIONAL_KEYS, "record it, there is no default"
            _reject(key, missing, "missing", f"only {list(arrays)}", fix)
            continue
        if key == "finger_radius" and arrays[key].ndim == 0:
            arrays[key] = np.full(sizes["F"], arrays[key])
        shape = arrays[key].shape
        sizes = dict(zip(axes, shape, strict=False)) | sizes
        wrong = shape != tuple(sizes.get(axis) for axis in axes)
        fix = f"T is {sizes.get('T')} here; transpose, or add a single finger's axis"
        if axes == ("F",):
            fix = f"F is {sizes.get('F')} here; one number each, or one for all"
        _reject(key, wrong, "wrong shape", shape, fix)
        _reject(key, 0 in shape, "empty", shape, "record a sample first")
    return arrays


def _check_fingers(arrays: dict[str, np.ndarray]) -> None:
    p_wf = arrays["finger_position"]
    fix = "give numbers where valid, of each action one"
    gone = np.isnan(p_wf).any(axis=2) & (arrays["valid"] == 0)
    fill_gaps(p_wf, arrays["time"], arrays["action"], gone)
    for key in ("time", "finger_position", "finger_radius", "finger_orientation"):
        if key in arrays:
            _reject(key, ~np.isfinite(arrays[key]), "not finite", arrays[key], fix)
    radius, fix = arrays["finger_radius"], "measure the tip, give metres"
    _reject("finger_radius", radius <= 0, "not positive", radius, fix)
    _reject("finger_radius", radius < SMALLEST_RADIUS, "too small", radius, fix)
    fix = f"use a frame whose origin is within {FARTHEST:.0f} m of the fingers"
    _reject("finger_position", abs(p_wf) > FARTHEST, "too far away", p_wf, fix)
    what, fix = "looks like millimetres", "divide by 1000"
    _reject("finger_position", abs(p_wf - p_wf[0, 0]) > LARGEST_SPREAD, what, p_wf, fix)
    if radius.max() < 10 * LARGEST_RADIUS:
        what, fix = "looks like centimetres", "divide by 100"
    _reject("finger_radius", radius > LARGEST_RADIUS, what, radius, fix)
    if "finger_orientation" in arrays:
        _make_unit("finger_orientation", arrays["finger_orientation"], True)


def _check_time(time: np.ndarray, action: np.ndarray) -> None:
    early, fix = np.diff(time, prepend=-np.inf) <= 0, "sort by time, drop doubles"
    _reject("time", early, "does not increase", time, fix)
    back, fix = np.diff(action, prepend=action[0]) < 0, "number actions as recorded"
    _reject("action", back, "decreases", action, fix)
    if _interval(time, action) > LONGEST_INTERVAL:
        long = np.diff(time, prepend=time[0]) > LONGEST_INTERVAL
        _reject("time", long, "looks like milliseconds", time, "divide by 1000")


def _check_touch(arrays: dict[str, np.ndarray]) -> None:
    """Check contact and normal where they are valid, blank them elsewhere."""
    normal, fix = arrays["normal"], "write zeros instead"
    for key in ("valid", "contact"):  # in this order: contact is read where valid
        flags = arrays[key]
        odd = (flags != 0) & (flags != 1)
        _reject(key, odd, "neither True nor False", flags, "give booleans")
        arrays[key] = flags.astype(bool)
        arrays["contact"][~arrays["valid"]] = 0
    normal[~arrays["valid"]] = 0
    contact, some = arrays["contact"], normal.any(axis=-1)
    if some.any() and not (some & contact).any():
        fix = "contact looks inverted, give ~contact"
    _reject("normal", ~np.isfinite(normal), "not finite", normal, fix)
    _reject("normal", some & ~contact, "normal without contact", normal, fix)
    fix = "set valid False where the normal is unknown"
    _reject("normal", contact & ~some, "contact without normal", normal, fix)
    _make_unit("normal", normal, contact)


def _make_unit(key: str, vectors: np.ndarray, rows: np.ndarray | bool) -> None:
    """Round to unit length where it nearly is, reject where it is not."""
    length = np.linalg.norm(vectors, axis=-1)
    off = np.where(rows, abs(length - 1), 0)
    what = f"not of unit length within {UNIT_TOLERANCE}"
    _reject(key, off > UNIT_TOLERANCE, what, length, "normalise it")
    vectors[off > UNIT_EXACT] /= length[off > UNIT_EXACT, None]


def _interval(time: np.ndarray, action: np.ndarray) -> float:
    steps = np.diff(time)[np.diff(action) == 0]
    return float(np.median(steps)) if steps.size else np.nan
