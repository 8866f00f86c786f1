"""Checks of arguments: type, range and shape, with errors that name the argument.

`as_array` and `as_number` convert all numbers that a user gives.
"""

from __future__ import annotations

import math
import os
from numbers import Integral, Real

import numpy as np

from ..errors import OptionError, shortened

VALUE_CHARACTERS = 80  # of the repr of a value in an error
NO_NUMBERS = (bool, np.bool_, np.timedelta64)  # though Python or NumPy call them so


def as_array(value, kinds: str = "biuf") -> np.ndarray | None:
    """Return a value as an array of one of these kinds of dtype, None if it is none.

    Words, times, complex numbers, ragged lists, masked arrays (their mask would be
    lost) and integers beyond 64 bits are no arrays of numbers.
    """
    if isinstance(value, np.ma.MaskedArray):
        return None
    try:
        array = np.asarray(value)
    except (TypeError, ValueError, OverflowError, RuntimeError):  # RuntimeError: CasADi
        return None
    return array if array.dtype.kind in kinds else None


def as_floats(value) -> np.ndarray:
    """Return a value as an array of floats, one NaN (1,) if it is no array of numbers.

    What checks that all entries are finite refuses both.
    """
    array = as_array(value)
    if array is None:
        return np.full(1, np.nan)
    with np.errstate(over="ignore"):  # infinite: of more digits than a float has
        return array.astype(float)


def numbers_of(where: str, value, error=OptionError) -> np.ndarray:
    """Return a value as an array of floats, NaN and infinity as well; else `error`."""
    if (array := as_array(value)) is None:
        expected = "a number or an array of numbers"
        raise error("no numbers", where=where, got=_short(value), expected=expected)
    return array.astype(float)


def as_number(value) -> float:
    """Return one real number as a float, NaN for booleans, arrays and all else."""
    if not isinstance(value, Real) or isinstance(value, NO_NUMBERS):
        return math.nan
    try:
        return float(value)
    except OverflowError:  # an integer of 400 digits
        return math.nan


def is_whole(value) -> bool:
    """Return whether a value is one whole number; booleans are not."""
    return isinstance(value, Integral) and not isinstance(value, NO_NUMBERS)


def check_types(**given) -> None:
    """Raise OptionError unless every name=(value, type) is of its type.

    type: a class, the name of a class that cannot be imported here, or a tuple.
    """
    for name, (value, kind) in given.items():
        kinds = kind if isinstance(kind, tuple) else (kind,)
        if not any(_is(value, k) for k in kinds):
            names = [getattr(k, "__name__", str(k)) for k in kinds]
            said = ["None" if n == "NoneType" else f"{n}(...)" for n in names]
            expected = " or ".join(said)
            raise OptionError(
                "wrong type", where=name, got=_short(value), expected=expected,
                next=_reader(value, kinds),
            )  # fmt: skip


def check_path(path) -> None:
    """Raise OptionError unless path is a str or an os.PathLike."""
    if not isinstance(path, (str, os.PathLike)):
        raise OptionError(
            "not a path", where="path", got=_short(path), expected="a str or a Path"
        )


def check_numbers(where: str, expected: str, **given) -> None:
    """Raise OptionError unless name=(value, low, high) is a number above low.

    It may equal high.  Infinity is a number; NaN, None, booleans and arrays are not.
    """
    for name, (value, low, high) in given.items():
        if not low < as_number(value) <= high:
            raise OptionError(
                "out of range", where=f"{where}{name}", got=_short(value),
                expected=expected,
            )  # fmt: skip


def check_sample(sample, samples: int, name: str = "sample") -> None:
    """Raise OptionError unless `sample` is an integer index into so many samples."""
    if not (is_whole(sample) and -samples <= sample < samples):
        raise OptionError(
            f"no such {name}", where=name, got=_short(sample),
            expected=f"a whole number from {-samples} to {samples - 1}",
        )  # fmt: skip


def checked_array(where: str, value, *shape: int, unit: str) -> np.ndarray:
    """Return the value as finite floats of this shape, or raise OptionError.

    shape: sizes; -1 in front stands for any number of axes of any size.
    """
    array = as_floats(value)
    tail = shape[1:] if shape[0] == -1 else shape
    fit = array.ndim >= len(tail) if shape[0] == -1 else array.ndim == len(shape)
    found = array.shape[array.ndim - len(tail) :]
    if fit and np.isfinite(array).all() and found == tail:
        return array
    words = ", ".join("..." if n == -1 else str(n) for n in shape)
    raise OptionError(
        "not an array of this shape", where=where, got=_short(value),
        expected=f"({words}{',' * (len(shape) == 1)}) finite numbers {unit}".strip(),
    )  # fmt: skip


def checked_choice(where: str, value, known, error=OptionError) -> np.ndarray:
    """Return an iterable of whole numbers among those known; `error` otherwise."""
    try:
        wanted = as_array(list(value), "iu")
    except (TypeError, ValueError):  # not iterable, or it raises
        wanted = None
    if wanted is None or not np.isin(wanted, known).all():
        raise error(
            "cannot select", where=where, got=_short(value),
            expected=f"whole numbers among {np.asarray(known).tolist()}",
        )  # fmt: skip
    return wanted


def _reader(value, kinds) -> str:
    """Return how a path or a dict becomes one of these classes, "" if it cannot."""
    path = isinstance(value, (str, os.PathLike))
    able = [k.__name__ for k in kinds if path and hasattr(k, "load")]
    if isinstance(value, dict) and value and isinstance(kinds[0], type):
        return f"write {kinds[0].__name__}(name=value, ...)"
    return f"read a file by {able[0]}.load(path)" if able else ""


def _is(value, kind) -> bool:
    if isinstance(kind, str):
        return any(base.__name__ == kind for base in type(value).__mro__)
    return isinstance(value, kind)


def _short(value) -> str:
    return shortened(value, most=VALUE_CHARACTERS)
