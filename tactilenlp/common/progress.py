"""Say how far a long computation is: a bar on a terminal, nothing anywhere else."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator

PATIENCE = 2.0  # [s] that nobody needs to be told of
EVERY = 0.2  # [s] between two pictures of the bar
WIDTH = 30  # characters of the bar
WIPED = "\r\033[K"  # back to the start of the line, which is cleared


def progress(
    steps: Iterable, words: str, total: int | None = None, stream=None
) -> Iterator:
    """Yield the steps one by one; after two seconds, draw on a terminal how far it is.

    total: number of steps, where `steps` has no length; stream: sys.stderr.  The bar is
    wiped when the steps end, also where they end by an error or by Ctrl-C.
    """
    stream = sys.stderr if stream is None else stream
    total = len(steps) if total is None and hasattr(steps, "__len__") else total
    seen = getattr(stream, "isatty", lambda: False)()
    began = drawn = time.monotonic()
    shown = False
    try:
        for done, step in enumerate(steps):
            now = time.monotonic()
            if seen and now - began > PATIENCE and (not shown or now - drawn > EVERY):
                stream.write("\r" + _bar(words, done, total, now - began))
                stream.flush()
                shown, drawn = True, now
            yield step
    finally:
        if shown:
            wipe(stream)


def wipe(stream=None) -> None:
    """Clear the line of a bar, before somebody else writes: on a terminal only."""
    stream = sys.stderr if stream is None else stream
    if getattr(stream, "isatty", lambda: False)():
        stream.write(WIPED)
        stream.flush()


def _bar(words: str, done: int, total: int | None, seconds: float) -> str:
    """Return the line: what is done of it, and how long the rest may take."""
    if not total:
        return f"{words}: {done} in {seconds:.0f} s"
    full = round(WIDTH * done / total)
    left = f", {seconds * (total - done) / done:.0f} s left" if done else ""
    return f"{words} [{'#' * full}{'.' * (WIDTH - full)}] {done}/{total}{left} "
