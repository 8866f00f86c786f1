"""The time that a computation may take, known to all that it calls.

    with ends_by(time.monotonic() + 60.0):
        ...  # solves and compilations in here end by then

Every solve of `nlp` and every compilation asks `time_left`; what can be left out asks
`out_of_time`, which records that it was.  Deadlines nest: an inner one can be earlier,
never later.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace

log = logging.getLogger("tactilenlp")


@dataclass(frozen=True)
class _Deadline:
    """When a computation ends [s], how long it may take in all [s], what was spent.

    at: of time.monotonic(); spent: seconds by purpose, and omitted: what was left out,
    both shared by nested deadlines.
    """

    at: float
    whole: float
    spent: dict[str, float] = field(default_factory=dict)
    omitted: list[str] = field(default_factory=list)


_deadline: ContextVar[_Deadline | None] = ContextVar("deadline", default=None)


@contextmanager
def ends_by(deadline: float) -> Iterator[None]:
    """Limit what is called in a block to a deadline [s] of time.monotonic()."""
    outer = _deadline.get()
    if outer is None:
        inner = _Deadline(deadline, max(0.0, deadline - time.monotonic()))
    else:
        inner = replace(outer, at=min(deadline, outer.at))
    before = _deadline.set(inner)
    try:
        yield
    finally:
        _deadline.reset(before)


def time_left() -> float:
    """Return the time [s] until the deadline, at least 0; infinity without one."""
    now = _deadline.get()
    return math.inf if now is None else max(0.0, now.at - time.monotonic())


def out_of_time(omitted: str, needed: float = 0.0) -> bool:
    """Tell whether less time is left than needed [s]; if so, record what is omitted."""
    if time_left() > needed:
        return False
    known = omissions()
    if omitted not in known:
        log.info("the time limit is near: without %s", omitted)
        known.append(omitted)
    return True


def omissions() -> list[str]:
    """Return what was left out so far for lack of time."""
    now = _deadline.get()
    return [] if now is None else now.omitted


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
