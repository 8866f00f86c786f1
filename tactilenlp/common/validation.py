"""Checks of arguments: type, range and shape, with errors that name the argument."""

from __future__ import annotations

import os
from numbers import Integral, Real

import numpy as np

from ..errors import OptionError

SHOWN_CHARACTERS = 80  # of the repr of a value in an error


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
                "wrong type", where=name, got=_short(value), expected=expected
            )


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
        number = isinstance(value, Real) and not isinstance(value, bool)
        if not (number and low < value <= high):
            raise OptionError(
                "out of range", where=f"{where}{name}", got=_short(value),
                expected=expected,
            )  # fmt: skip


def check_sample(sample, samples: int, name: str = "sample") -> None:
    """Raise OptionError unless `sample` is an integer index into so many samples."""
    whole = isinstance(sample, Integral) and not isinstance(sample, bool)
    if not (whole and -samples <= sample < samples):
        raise OptionError(
            f"no such {name}", where=name, got=_short(sample),
            expected=f"a whole number from {-samples} to {samples - 1}",
        )  # fmt: skip


def checked_array(where: str, value, *shape: int, unit: str) -> np.ndarray:
    """Return the value as finite floats of this shape, or raise OptionError.

    shape: sizes; -1 in front stands for any number of axes of any size.
    """
    try:
        array = np.asarray(value, float)
    except (TypeError, ValueError):  # words, None among numbers, ragged lists
        array = np.full(0, np.nan)
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
        wanted = np.asarray(list(value))
    except TypeError:  # not iterable
        wanted = np.full(0, np.nan)
    if wanted.dtype.kind not in "iu" or not np.isin(wanted, known).all():
        raise error(
            "cannot select", where=where, got=_short(value),
            expected=f"whole numbers among {np.asarray(known).tolist()}",
        )  # fmt: skip
    return wanted


def _is(value, kind) -> bool:
    if isinstance(kind, str):
        return any(base.__name__ == kind for base in type(value).__mro__)
    return isinstance(value, kind)


def _short(value) -> str:
    text = repr(value)
    short = len(text) <= SHOWN_CHARACTERS
    return text if short else f"{text[: SHOWN_CHARACTERS - 3]}..."
