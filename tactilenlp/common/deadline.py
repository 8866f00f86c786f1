"""The time that a computation may take, known to all that it calls.

    with ends_by(time.monotonic() + 60.0):
        ...  # solves and compilations in here end by then

Every solve of `nlp` and every compilation asks `time_left`; a loop over solves asks it
between them.  Deadlines nest: an inner one can be earlier, never later.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field


@dataclass(frozen=True)
class _Deadline:
    """When a computation ends [s], how long it may take in all [s], what was spent.

    at: of time.monotonic(); spent: seconds by purpose, shared by nested deadlines.
    """

    at: float
    whole: float
    spent: dict[str, float] = field(default_factory=dict)


_deadline: ContextVar[_Deadline | None] = ContextVar("deadline", default=None)


@contextmanager
def ends_by(deadline: float) -> Iterator[None]:
    """Limit what is called in a block to a deadline [s] of time.monotonic()."""
    outer = _deadline.get()
    if outer is None:
        inner = _Deadline(deadline, max(0.0, deadline - time.monotonic()))
    else:
        inner = _Deadline(min(deadline, outer.at), outer.whole, outer.spent)
    before = _deadline.set(inner)
    try:
        yield
    finally:
        _deadline.reset(before)


def time_left() -> float:
    """Return the time [s] until the deadline, at least 0; infinity without one."""
    now = _deadline.get()
    return math.inf if now is None else max(0.0, now.at - time.monotonic())


def share_left(purpose: str, share: float) -> float:
    """Return the time [s] that is left for a purpose, which may take a share of all."""
    now = _deadline.get()
    if now is None:
        return math.inf
    return min(time_left(), share * now.whole - now.spent.get(purpose, 0.0))


@contextmanager
def spending(purpose: str) -> Iterator[None]:
    """Count the time of a block as spent on a purpose."""
    began, now = time.monotonic(), _deadline.get()
    try:
        yield
    finally:
        if now is not None:
            past = now.spent.get(purpose, 0.0)
            now.spent[purpose] = past + time.monotonic() - began
