"""Refuse ages, rows of numbers and rotations of the bench that are out of range.

Single numbers, words and arrays are checked by tactilenlp.common.validation: the
constructors of the bench check all their arguments.
"""

from __future__ import annotations

import numpy as np

from tactilenlp.common.validation import as_floats, check_range, is_rotation
from tactilenlp.errors import shortened

from .errors import HardwareError, LimitError, StaleStreamError

SHOWN_CHARACTERS = 80  # of a value in an error
TURN_ERROR = 1e-6  # [1], largest entry of R R' - 1


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
        got, expected = shortened(values, most=SHOWN_CHARACTERS), f"({count},) {unit}"
        raise error("wrong shape", where=where, got=got, expected=expected)
    for k, value in enumerate(given):
        check_range(f"{where}[{k}]", value, low, high, unit, error)


def check_most(
    where: str, what: str, values: np.ndarray, most: float, unit: str, next: str
) -> None:
    """Raise LimitError unless all magnitudes are at most `most` [unit]."""
    if not np.abs(values).max() <= most:  # NaN as well
        got, expected = f"{np.round(values, 3)} {unit}", f"{most:g} {unit} at most"
        raise LimitError(what, where=where, got=got, expected=expected, next=next)


def check_age(
    where: str, what: str, age: float, limit: float, next: str, why: str = ""
) -> None:
    """Raise StaleStreamError where the newest sample is older [s] than the limit."""
    if not age <= limit:
        got = f"silence for {age:.3f} s" + (f" ({why})" if why else "")
        expected = f"one every {limit} s"
        raise StaleStreamError(what, where=where, got=got, expected=expected, next=next)


def rotation(where: str, value: object, error: type[HardwareError]) -> np.ndarray:
    """Return a rotation matrix (3, 3), or raise an error."""
    for k, row in enumerate(_entries(value)):
        check_ranges(f"{where}[{k}]", row, 3, -1.0, 1.0, "", error)
    if is_rotation(R := as_floats(value), TURN_ERROR):
        return R
    expected, got = "R R' = 1, det R = 1", shortened(value, most=SHOWN_CHARACTERS)
    raise error("no rotation", where=where, got=got, expected=expected)


def _entries(values: object) -> list:
    """Return the entries of a tuple, a list or an array; none of anything else."""
    many = isinstance(values, tuple | list | np.ndarray)
    return list(values) if many and getattr(values, "ndim", 1) else []
