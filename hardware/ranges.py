"""Refuse numbers that guard or reach a motor unless they are finite and in range.

The constructors of the bench check all their arguments here.
"""

from __future__ import annotations

import numpy as np

from tactilenlp.common.validation import as_array, as_number, is_whole
from tactilenlp.errors import shortened

from .errors import HardwareError, LimitError, StaleStreamError

SHOWN_CHARACTERS = 80  # of a value in an error
TURN_ERROR = 1e-6  # [1], largest entry of R R' - 1


def check_range(
    where: str,
    value: object,
    low: float,
    high: float,
    unit: str,
    error: type[HardwareError] = LimitError,
) -> None:
    """Raise an error unless a value is one finite number from low to high.

    Booleans, words and arrays are no numbers here.
    """
    if not low <= as_number(value) <= high:
        expected = f"a finite number from {low:g} to {high:g} {unit}"
        raise error("out of range", where=where, got=_short(value), expected=expected)


def check_ranges(
    where: str,
    values: object,
    count: int,
    low: float,
    high: float,
    unit: str,
    error: type[HardwareError] = LimitError,
) -> None:
    """Raise an error unless values are so many finite numbers from low to high."""
    given = _entries(values)
    if len(given) != count:
        expected = f"({count},) {unit}"
        raise error("wrong shape", where=where, got=_short(values), expected=expected)
    for k, value in enumerate(given):
        check_range(f"{where}[{k}]", value, low, high, unit, error)


def check_age(
    where: str, what: str, age: float, limit: float, next: str, why: str = ""
) -> None:
    """Raise StaleStreamError where the newest sample is older [s] than the limit."""
    if not age <= limit:
        got = f"silence for {age:.3f} s" + (f" ({why})" if why else "")
        expected = f"one every {limit} s"
        raise StaleStreamError(what, where=where, got=got, expected=expected, next=next)


def floats(
    where: str, value: object, shape: tuple, error: type[HardwareError]
) -> np.ndarray:
    """Return a value as floats of this shape, or raise an error.

    shape: sizes; None for any size, `...` in front for any number of axes.  Words,
    times, ragged lists and masked arrays are no numbers; NaN is one.
    """
    array = as_array(value)
    found = () if array is None else array.shape
    sizes = shape[1:] if shape[0] is ... else shape
    tail = found[-len(sizes) :] if shape[0] is ... else found
    fit = array is not None and len(tail) == len(sizes)
    if not (fit and all(n in (None, m) for n, m in zip(sizes, tail, strict=True))):
        words = ", ".join({None: "n", ...: "..."}.get(n, str(n)) for n in shape)
        got, expected = _short(value), f"numbers ({words})"
        raise error("no array", where=where, got=got, expected=expected)
    return array.astype(float, copy=False)


def check_whole(
    where: str, value: object, low: int, high: int, error: type[HardwareError]
) -> None:
    """Raise an error unless a value is one whole number from low to high."""
    if not (is_whole(value) and low <= value <= high):
        expected = f"a whole number from {low} to {high}"
        raise error("out of range", where=where, got=_short(value), expected=expected)


def check_kind(
    where: str, value: object, kind: type | tuple, error: type[HardwareError]
) -> None:
    """Raise an error unless a value is of a class; words must not be empty.

    The keys of a dictionary must be words; booleans are no whole numbers.
    """
    good = isinstance(value, kind) and not isinstance(value, bool)
    if isinstance(value, dict):
        good = good and all(isinstance(key, str) for key in value)
    if not good:
        kinds = kind if isinstance(kind, tuple) else (kind,)
        expected = " or ".join(k.__name__ for k in kinds)
        raise error("wrong type", where=where, got=_short(value), expected=expected)


def rotation(where: str, value: object, error: type[HardwareError]) -> np.ndarray:
    """Return a rotation matrix (3, 3), or raise an error."""
    for k, row in enumerate(_entries(value)):
        check_ranges(f"{where}[{k}]", row, 3, -1.0, 1.0, "", error)
    R = floats(where, value, (3, 3), error)
    if not (abs(R @ R.T - np.eye(3)).max() <= TURN_ERROR and np.linalg.det(R) > 0):
        expected = "R R' = 1, det R = 1"
        raise error("no rotation", where=where, got=_short(value), expected=expected)
    return R


def _entries(values: object) -> list:
    """Return the entries of a tuple, a list or an array; none of anything else."""
    many = isinstance(values, tuple | list | np.ndarray)
    return list(values) if many and getattr(values, "ndim", 1) else []


def _short(value: object) -> str:
    return shortened(value, most=SHOWN_CHARACTERS)
