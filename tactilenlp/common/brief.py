"""Print a result in a few lines, arrays by shape; compare two results exactly."""

from __future__ import annotations

import html
import textwrap
from collections.abc import Mapping
from dataclasses import fields, is_dataclass

import numpy as np

LINES, COLUMNS = 8, 88  # of a printed result
MM_PER_M, MS_PER_S = 1e3, 1e3  # [mm / m], also [mN s / N s]; [ms / s]


def brief(thing) -> str:
    """Return the name and fields of a dataclass, at most LINES lines."""
    words = (f"{f.name}={_in_words(getattr(thing, f.name))}" for f in fields(thing))
    return textwrap.fill(
        f"{type(thing).__name__}({', '.join(words)})", COLUMNS,
        subsequent_indent="  ", max_lines=LINES, placeholder=" ...)",
    )  # fmt: skip


def as_html(thing) -> str:
    """Return what a notebook shows of a dataclass: summary, if it has one, fields."""
    head = thing.summary() if hasattr(thing, "summary") else type(thing).__name__
    text = f"<p>{html.escape(head)}</p>".replace("\n", "<br>")
    pairs = ((f.name, _in_words(getattr(thing, f.name))) for f in fields(thing))
    cells = (f"<tr><th>{n}</th><td>{html.escape(v)}</td></tr>" for n, v in pairs)
    return f"{text}<table>{''.join(cells)}</table>"


def printed(cls):
    """Print objects of a class by `brief`, and in notebooks by `as_html`."""
    cls.__repr__, cls._repr_html_ = brief, as_html
    return cls


def shown(cls):
    """Show objects of a class in notebooks by `as_html`."""
    cls._repr_html_ = as_html
    return cls


def _in_words(value) -> str:
    """Return one value in a few words."""
    if isinstance(value, np.ndarray):
        return np.array2string(value, precision=4) if value.size <= 3 else (
            f"array{value.shape}".replace(" ", "")
        )  # fmt: skip
    if isinstance(value, str | int | float | None):
        return f"{value:.6g}" if isinstance(value, float) else repr(value)
    if isinstance(value, Mapping | tuple | list):
        return f"{len(value)} {'entries' if len(value) != 1 else 'entry'}"
    return type(value).__name__


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
    return bool(a == b or (a != a and b != b))  # NaN alone differs from itself


def _same_arrays(a, b) -> bool:
    """Tell whether two values are arrays of one kind with the same entries."""
    if not (isinstance(a, np.ndarray) and isinstance(b, np.ndarray)):
        return False
    numbers = a.dtype.kind in "fc" and b.dtype.kind in "fc"
    return a.dtype.kind == b.dtype.kind and np.array_equal(a, b, equal_nan=numbers)
