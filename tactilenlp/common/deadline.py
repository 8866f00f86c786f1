"""The time that a computation may take: one object, passed to all that it calls.

    deadline = Deadline.within(60.0)
    while not deadline.passed("further starts"):
        ...  # solves and compilations that are given the deadline end by then

What can be left out asks `passed`, which records that it was.  What consists of many
steps calls `check` between them, which ends all of it where the deadline is strict.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

log = logging.getLogger("tactilenlp")
TIME_LIMIT = "time limit reached: without "  # in a status, before what is missing


class OutOfTime(Exception):
    """A strict deadline has passed; whoever set it catches this."""


@dataclass(frozen=True)
class Deadline:
    """When a computation ends [s], how long it may take in all [s], what was spent.

    at: of time.monotonic(), by default never; strict: whether `check` raises OutOfTime;
    spent: seconds by purpose, and omitted: what was left out, in words, both shared by
    the deadlines that `until` makes.
    """

    at: float = math.inf
    whole: float = math.inf
    strict: bool = False
    spent: dict[str, float] = field(default_factory=dict)
    omitted: list[str] = field(default_factory=list)

    def __getstate__(self) -> dict:
        """Return the fields, the end by the clock of the day: other hosts have it."""
        return {**vars(self), "at": self.at - time.monotonic() + time.time()}

    def __setstate__(self, state: dict) -> None:
        vars(self).update(state)
        vars(self)["at"] = self.at - time.time() + time.monotonic()

    @classmethod
    def within(cls, seconds: float, began: float | None = None) -> Deadline:
        """Return the deadline of what may take so long [s], from now or `began` on."""
        began = time.monotonic() if began is None else began
        return cls(began + seconds, seconds)

    def until(self, at: float, strict: bool = False) -> Deadline:
        """Return the deadline of a part of the computation, never later than all."""
        return replace(self, at=min(at, self.at), strict=strict)

    def before_end(self, seconds: float) -> float:
        """Return when so long [s] is left, of time.monotonic(); never without an end.

        seconds may be a share of an infinite limit: infinite, or no number.
        """
        return self.at if math.isinf(self.at) else self.at - seconds

    @property
    def left(self) -> float:
        """The time [s] that is left, at least 0."""
        return max(0.0, self.at - time.monotonic())

    def passed(self, omitted: str, needed: float = 0.0) -> bool:
        """Tell whether less time is left than needed [s]; record what is omitted."""
        if self.left > needed:
            return False
        self.omit(omitted)
        return True

    def omit(self, what: str) -> None:
        """Record what was left out for lack of time."""
        if what not in self.omitted:
            log.info("the time limit is near: without %s", what)
            self.omitted.append(what)

    def marked(self, status: str) -> str:
        """Return a status, with what was left out for lack of time."""
        left_out = ", ".join(self.omitted)
        before = ", " if TIME_LIMIT in status else f", {TIME_LIMIT}"
        return f"{status}{before}{left_out}" if left_out else status

    def check(self) -> None:
        """Raise OutOfTime if the deadline is strict and has passed."""
        if self.strict and self.left <= 0:
            raise OutOfTime

    @contextmanager
    def ending(self, omitted: str) -> Iterator[None]:
        """End a block where a strict deadline passes, and record what is omitted."""
        try:
            yield
        except OutOfTime:
            self.omit(omitted)

    def share_left(self, purpose: str, share: float) -> float:
        """Return the time [s] that is left for a purpose with a share [-] of all."""
        return min(self.left, share * self.whole - self.spent.get(purpose, 0.0))

    @contextmanager
    def spending(self, purpose: str) -> Iterator[None]:
        """Count the time of a block as spent on a purpose."""
        began = time.monotonic()
        try:
            yield
        finally:
            past = self.spent.get(purpose, 0.0)
            self.spent[purpose] = past + time.monotonic() - began


NEVER = Deadline()  # no time limit: nothing is omitted
