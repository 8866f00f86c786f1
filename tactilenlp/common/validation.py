"""Checks of arguments: type, range and shape, with errors that name the argument.

`as_array` and `as_number` convert all numbers that a user gives.
"""

from __future__ import annotations

import math
import os
from numbers import Integral, Real

import numpy as np

from ..errors import OptionError, did_you_mean, shortened

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


def numbers_of(
    where: str, value, error=OptionError, *shape, unit: str = "", next: str = "",
    finite: bool = False, positive: bool = False,
) -> np.ndarray:  # fmt: skip
    """Return a value as floats of this shape, by default of any, or raise `error`.

    shape: sizes; a word stands for any size, `...` in front for any axes of any size.
    NaN and infinity are numbers, unless `finite` or `positive`.
    """
    raw, shape = as_array(value), shape or (...,)
    array = as_floats(raw)
    any_axes = shape[0] is ...
    sizes = shape[any_axes:]
    tail = array.shape[array.ndim - len(sizes) :] if any_axes else array.shape
    fit = all(isinstance(n, str) or n == m for n, m in zip(sizes, tail, strict=False))
    fit = fit and len(tail) == len(sizes)
    finite = finite or positive
    valid = np.isfinite(array).all() if finite else raw is not None
    if fit and valid and not (positive and (array <= 0).any()):
        return array
    words = ", ".join("..." if n is ... else str(n) for n in shape)
    words = f"({words}{',' * (len(shape) == 1)})"
    words += f" {'finite ' * finite}{'positive ' * positive}numbers {unit}".rstrip()
    what = "out of range" if fit and raw is not None else "not an array of this shape"
    if not sizes:
        what, words = "no numbers", "a number or an array of numbers"
    _refuse(error, what, where, value, words, next)


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
    """Raise OptionError unless every name=(value, type) is of its type, see below."""
    for name, (value, kind) in given.items():
        check_kind(name, value, kind)


def check_kind(where: str, value, kind, error=OptionError, next: str = "") -> None:
    """Raise `error` unless a value is of a type.

    kind: a class, the name of a class that cannot be imported here, or a tuple.  The
    keys of a dict must be words, and a boolean is no int.
    """
    kinds = kind if isinstance(kind, tuple) else (kind,)
    if not any(_is(value, k) for k in kinds):
        fix = next or _reader(value, kinds)
        _refuse(error, "wrong type", where, value, " or ".join(map(_word, kinds)), fix)


def check_path(path) -> None:
    """Raise OptionError unless path is a str or an os.PathLike."""
    if not isinstance(path, (str, os.PathLike)):
        _refuse(OptionError, "not a path", "path", path, "a str or a Path")


def check_numbers(expected: str, **given) -> None:
    """Raise OptionError unless name=(value, low, high) is a number above low.

    It may equal high.  Infinity is a number; NaN, None, booleans and arrays are not.
    """
    for name, (value, low, high) in given.items():
        if not low < as_number(value) <= high:
            _refuse(OptionError, "out of range", name, value, expected)


def check_range(
    where: str, value, low: float, high: float, unit: str = "", error=OptionError
) -> None:
    """Raise `error` unless a value is one finite number from low to high [unit].

    Booleans, words and arrays are no numbers here.
    """
    if not low <= as_number(value) <= high:
        expected = f"a finite number from {low:g} to {high:g} {unit}".rstrip()
        _refuse(error, "out of range", where, value, expected)


def check_whole(
    where: str, value, low: int, high: float, error=OptionError, what="out of range"
) -> None:
    """Raise `error` unless a value is a whole number from low to high."""
    if not (is_whole(value) and low <= value <= high):
        expected = f"a whole number from {low} to {high}"
        if high == math.inf:
            expected = f"an integer, {low} or more"
        _refuse(error, what, where, value, expected)


def check_one_of(
    where: str, value, known, what: str, error=OptionError, unit="", next: str = ""
) -> None:
    """Raise `error` unless a value is one of the words or numbers that are known.

    unit: what follows them in the error.  The most similar word comes before `next`.
    """
    plain = isinstance(value, (str, Real)) and not isinstance(value, NO_NUMBERS)
    if not (plain and value in known):
        expected = f"one of {[*known]} {unit}".rstrip()
        _refuse(error, what, where, value, expected, did_you_mean(value, known) or next)


def check_sample(sample, samples: int, name: str = "sample") -> None:
    """Raise OptionError unless `sample` is an integer index into so many samples."""
    check_whole(name, sample, -samples, samples - 1, what=f"no such {name}")


def checked_array(where: str, value, *shape, unit: str) -> np.ndarray:
    """Return the value as finite floats of this shape, or raise OptionError."""
    return numbers_of(where, value, OptionError, *shape, unit=unit, finite=True)


def checked_place(
    where: str, value, error=OptionError, farthest: float = math.inf
) -> np.ndarray:
    """Return a place (2,) on the ground or (3,) [m] as floats, or raise `error`.

    farthest [m]: no coordinate may be farther from the origin.
    """
    place = as_floats(value)
    near = np.isfinite(place).all() and (abs(place) <= farthest).all()
    if place.shape not in ((2,), (3,)) or not near:
        expected = "(2,) or (3,) finite numbers [m]"
        if farthest < math.inf:
            expected += f", within {farthest:.0f} m"
        _refuse(error, "not a place", where, value, expected)
    return place


def is_rotation(R: np.ndarray, tolerance: float) -> bool:
    """Tell whether floats are a rotation matrix (3, 3), R R' = 1 within a tolerance."""
    if R.shape != (3, 3) or not np.isfinite(R).all():
        return False
    off = abs(R @ R.T - np.eye(3)).max()
    return bool(off <= tolerance and np.linalg.det(R) > 0)


def checked_unit(
    where: str, value, size: int, tolerance: float, error=OptionError, next: str = ""
) -> np.ndarray:
    """Return a vector (size,) as floats whose length is one, or raise `error`."""
    vector = as_floats(value)
    if vector.shape != (size,) or not abs(np.linalg.norm(vector) - 1) <= tolerance:
        expected = f"numbers of shape ({size},) and length 1 within {tolerance:g}"
        _refuse(error, "not of unit length", where, value, expected, next)
    return vector


def checked_trajectory(
    trajectory, fingers: int, longest: float, farthest: float, error=OptionError
) -> tuple[np.ndarray, np.ndarray]:
    """Return the time (n,) [s] and the finger positions (n, F, 3) [m] of a trajectory.

    longest [s], farthest [m] from the origin.  Raises `error` for other shapes, and
    where numbers are not finite or beyond these limits.
    """
    values = [getattr(trajectory, k, None) for k in ("time", "finger_position")]
    time, p_wf = (as_floats(() if as_array(x) is None else x) for x in values)
    good = time.ndim == 1 and time.size > 1 and np.isfinite(time).all()
    if not (good and (time[1:] > time[:-1]).all()):
        raise error(
            "no trajectory", where="time",
            got=f"time {time.shape}, finger_position {p_wf.shape}",
            expected="(n,) [s], finite, increasing, n >= 2",
        )  # fmt: skip
    shape = (time.size, fingers, 3)
    if p_wf.shape != shape or not (abs(p_wf) <= farthest).all():
        raise error(
            "no trajectory", where="finger_position", got=f"shape {p_wf.shape}",
            expected=f"{shape} [m], finite, within {farthest:g} m",
        )  # fmt: skip
    with np.errstate(over="ignore"):
        duration = float(time[-1] - time[0])
    if not duration <= longest:
        raise error(
            "too long for the limits", where="time", got=f"{duration:g} s",
            expected=f"at most {longest:g} s", next="execute it in parts",
        )  # fmt: skip
    return time, p_wf


def checked_choice(where: str, value, known, error=OptionError) -> np.ndarray:
    """Return an iterable of whole numbers among those known; `error` otherwise."""
    try:
        wanted = as_array(list(value), "iu")
    except (TypeError, ValueError):  # not iterable, or it raises
        wanted = None
    if wanted is None or not np.isin(wanted, known).all():
        expected = f"whole numbers among {np.asarray(known).tolist()}"
        _refuse(error, "cannot select", where, value, expected)
    return wanted


def _refuse(error: type, what: str, where: str, value, expected: str, next: str = ""):
    got = shortened(value, most=VALUE_CHARACTERS)
    if isinstance(value, np.ndarray) and value.ndim > 1:
        got += f" of shape {value.shape}"
    raise error(what, where=where, got=got, expected=expected, next=next)


def _reader(value, kinds) -> str:
    """Return how a path or a dict becomes one of these classes, "" if it cannot."""
    path = isinstance(value, (str, os.PathLike))
    able = [k.__name__ for k in kinds if path and hasattr(k, "load")]
    ours = isinstance(kinds[0], type) and kinds[0].__module__ != "builtins"
    if isinstance(value, dict) and value and ours:
        return f"write {kinds[0].__name__}(name=value, ...)"
    return f"read a file by {able[0]}.load(path)" if able else ""


def _is(value, kind) -> bool:
    if isinstance(kind, str):
        return any(base.__name__ == kind for base in type(value).__mro__)
    if kind is dict and isinstance(value, dict):
        return all(isinstance(key, str) for key in value)
    return isinstance(value, kind) and not (kind is int and isinstance(value, bool))


def _word(kind) -> str:
    """Return how a class is written: those of Python by their names alone."""
    name = getattr(kind, "__name__", str(kind))
    of_python = getattr(kind, "__module__", "") == "builtins"
    return "None" if name == "NoneType" else name if of_python else f"{name}(...)"
