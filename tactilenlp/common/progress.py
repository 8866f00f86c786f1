"""Progress of a long computation: a bar on a terminal, nothing anywhere else."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator

FIRST_DELAY = 2.0  # [s] before a bar appears
REDRAW_INTERVAL = 0.2  # [s] between two drawings of the bar
BAR_CHARACTERS = 30  # characters of the bar
ERASE_LINE = "\r\033[K"  # go to the start of the line and clear it


def progress(
    steps: Iterable, words: str, total: int | None = None, stream=None
) -> Iterator:
    """Yield the steps one by one; after two seconds, draw a bar on a terminal.

    total: number of steps, where `steps` has no length; stream: sys.stderr.  The bar is
    erased when the steps end, also by an error or by Ctrl-C.
    """
    stream = sys.stderr if stream is None else stream
    total = len(steps) if total is None and hasattr(steps, "__len__") else total
    seen = getattr(stream, "isatty", lambda: False)()
    began = drawn = time.monotonic()
    shown = False
    try:
        for done, step in enumerate(steps):
            now = time.monotonic()
            if (
                seen
                and now - began > FIRST_DELAY
                and (not shown or now - drawn > REDRAW_INTERVAL)
            ):
                stream.write("\r" + _bar(words, done, total, now - began))
                stream.flush()
                shown, drawn = True, now
            yield step
    finally:
        if shown:
            wipe(stream)


def wipe(stream=None) -> None:
    """Clear the line of a bar before other output; on a terminal only."""
    stream = sys.stderr if stream is None else stream
    if getattr(stream, "isatty", lambda: False)():
        stream.write(ERASE_LINE)
        stream.flush()


def _bar(words: str, done: int, total: int | None, seconds: float) -> str:
    """Return the line: the share done, and an estimate of the remaining time."""
    if not total:
        return f"{words}: {done} in {seconds:.0f} s"
    full = round(BAR_CHARACTERS * done / total)
    left = f", {seconds * (total - done) / done:.0f} s left" if done else ""
    return (
        f"{words} [{'#' * full}{'.' * (BAR_CHARACTERS - full)}] {done}/{total}{left} "
    )
