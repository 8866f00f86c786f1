"""Compare results exactly: arrays entry by entry, NaN equal to NaN."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass

import numpy as np


def same_content(a, b) -> bool:
    """Tell whether two values are the same to the last digit, whatever they hold.

    Arrays agree in shape and entries; dataclasses in class and fields; a list and a
    tuple in their entries, as files do not tell them apart.
    """
    if a is b:
        return True
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return _same_arrays(a, b)
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return a.keys() == b.keys() and all(same_content(a[k], b[k]) for k in a)
    if isinstance(a, tuple | list) and isinstance(b, tuple | list):
        return len(a) == len(b) and all(map(same_content, a, b))
    if is_dataclass(a) and type(a) is type(b):
        names = [f.name for f in fields(a)]
        return all(same_content(getattr(a, n), getattr(b, n)) for n in names)
    return bool(a == b) or (_is_nan(a) and _is_nan(b))


def _same_arrays(a, b) -> bool:
    if not (isinstance(a, np.ndarray) and isinstance(b, np.ndarray)):
        return False
    numbers = a.dtype.kind in "fc" and b.dtype.kind in "fc"
    return a.dtype.kind == b.dtype.kind and np.array_equal(a, b, equal_nan=numbers)


def _is_nan(value) -> bool:
    return isinstance(value, float | np.floating) and bool(np.isnan(value))
