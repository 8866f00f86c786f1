"""Refuse arguments of the wrong type, in words, before they do harm."""

from __future__ import annotations

import os
from numbers import Integral, Real

from .errors import OptionError

LONGEST = 80  # characters of a value that are shown


def check_types(**given) -> None:
    """Raise OptionError unless name=(value, type) hold; where several may be, a tuple.

    A type can be a string where it cannot be imported: the name of a class.
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
    """Raise OptionError unless this may be the path of a file."""
    if not isinstance(path, (str, os.PathLike)):
        raise OptionError(
            "no path", where="path", got=_short(path), expected="a str or a Path"
        )


def check_numbers(where: str, expected: str, **given) -> None:
    """Raise OptionError unless name=(value, low, high) is a number above low.

    It may be as large as high.  Infinity is a number; NaN, None, booleans, arrays not.
    """
    for name, (value, low, high) in given.items():
        number = isinstance(value, Real) and not isinstance(value, bool)
        if not (number and low < value <= high):
            raise OptionError(
                "out of range", where=f"{where}{name}", got=_short(value),
                expected=expected,
            )  # fmt: skip


def check_sample(sample, samples: int) -> None:
    """Raise OptionError unless `sample` is a whole number that picks one of so many."""
    whole = isinstance(sample, Integral) and not isinstance(sample, bool)
    if not (whole and -samples <= sample < samples):
        raise OptionError(
            "no such sample", where="sample", got=_short(sample),
            expected=f"a whole number from {-samples} to {samples - 1}",
        )  # fmt: skip


def _is(value, kind) -> bool:
    if isinstance(kind, str):
        return any(base.__name__ == kind for base in type(value).__mro__)
    return isinstance(value, kind)


def _short(value) -> str:
    text = repr(value)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."
