"""Print a result in a few lines: numbers and words as they are, arrays by shape."""

from __future__ import annotations

import html
import textwrap
from collections.abc import Mapping
from dataclasses import fields, is_dataclass

import numpy as np

LINES, COLUMNS = 8, 88  # of a printed result


def brief(thing) -> str:
    """Return the name and fields of a dataclass, at most LINES lines."""
    told = (f"{f.name}={_told(getattr(thing, f.name))}" for f in fields(thing))
    return textwrap.fill(
        f"{type(thing).__name__}({', '.join(told)})", COLUMNS,
        subsequent_indent="  ", max_lines=LINES, placeholder=" ...)",
    )  # fmt: skip


def as_html(thing) -> str:
    """Return what a notebook shows: the summary, if there is one, and the fields."""
    head = thing.summary() if hasattr(thing, "summary") else type(thing).__name__
    text = f"<p>{html.escape(head)}</p>".replace("\n", "<br>")
    if not is_dataclass(thing):
        return f"{text}<pre>{html.escape(repr(thing))}</pre>"
    pairs = ((f.name, _told(getattr(thing, f.name))) for f in fields(thing))
    cells = (f"<tr><th>{n}</th><td>{html.escape(told)}</td></tr>" for n, told in pairs)
    return f"{text}<table>{''.join(cells)}</table>"


def printed(cls):
    """Print objects of a class by `brief`, and in notebooks by `as_html`."""
    cls.__repr__, cls._repr_html_ = brief, as_html
    return cls


def shown(cls):
    """Show objects of a class in notebooks by `as_html`."""
    cls._repr_html_ = as_html
    return cls


def _told(value) -> str:
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
