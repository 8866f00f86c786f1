"""Refuse numbers that guard or reach a motor unless they are finite and in range."""

from __future__ import annotations

from numbers import Real

import numpy as np

from .errors import HardwareError, LimitError


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
    number = isinstance(value, Real) and not isinstance(value, bool)
    if not (number and np.isfinite(float(value)) and low <= value <= high):
        expected = f"a finite number from {low:g} to {high:g} {unit}"
        raise error("out of range", where=where, got=repr(value), expected=expected)


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
    try:
        given = list(values)
    except TypeError:
        given = []
    if len(given) != count:
        expected = f"({count},) {unit}"
        raise error("wrong shape", where=where, got=repr(values), expected=expected)
    for k, value in enumerate(given):
        check_range(f"{where}[{k}]", value, low, high, unit, error)
