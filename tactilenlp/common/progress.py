"""Progress of a long computation: a bar on a terminal, nothing anywhere else."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress

FIRST_DELAY = 2.0  # [s] before a bar appears
REDRAW_INTERVAL = 0.2  # [s] between two drawings of the bar
BAR_CHARACTERS = 30  # characters of the bar
ERASE_LINE = "\r\033[K"  # go to the start of the line and clear it


def progress(steps: Iterable, words: str, total: int | None = None) -> Iterator:
    """Yield the steps one by one; after two seconds, draw a bar on a terminal.

    total: number of steps, where `steps` has no length.  The bar is erased when the
    steps end, also by an error or by Ctrl-C.
    """
    total = len(steps) if total is None and hasattr(steps, "__len__") else total
    began, drawn = time.monotonic(), None
    try:
        for done, step in enumerate(steps):
            now = time.monotonic()
            if now - began > FIRST_DELAY and (
                drawn is None or now - drawn > REDRAW_INTERVAL
            ):
                _write("\r" + _bar(words, done, total, now - began))
                drawn = now
            yield step
    finally:
        if drawn is not None:
            wipe()


def wipe() -> None:
    """Clear the line of a bar before other output; on a terminal only."""
    _write(ERASE_LINE)


def _write(line: str) -> None:
    """Write to stderr if it is a terminal."""
    # A stream that was closed raises ValueError, a terminal that has gone OSError.
    with suppress(ValueError, OSError):
        if getattr(sys.stderr, "isatty", lambda: False)():
            sys.stderr.write(line)
            sys.stderr.flush()


def _bar(words: str, done: int, total: int | None, seconds: float) -> str:
    """Return the line: the share done, and an estimate of the remaining time."""
    if not total:
        return f"{words}: {done} in {seconds:.0f} s"
    full = round(BAR_CHARACTERS * done / total)
    left = f", {seconds * (total - done) / done:.0f} s left" if done else ""
    return (
        f"{words} [{'#' * full}{'.' * (BAR_CHARACTERS - full)}] {done}/{total}{left} "
    )
