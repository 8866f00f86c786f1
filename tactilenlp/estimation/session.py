"""Session: term functions kept from one estimate to the next."""

from __future__ import annotations

from weakref import WeakKeyDictionary

from ..search.hypothesis import TermFunctions


class Session:
    """Keep the term functions that estimates were solved with; mutable.

    A solve that starts from an estimate of the same session, scene, shape and page
    reuses them instead of deriving them again.  The caller owns a session and passes it
    to `solve_estimate`; without one, solves share PROCESS.  A session holds estimates
    by weak references: what belongs to an estimate is dropped together with it.
    """

    def __init__(self):
        self._by_origin = WeakKeyDictionary()

    def functions_for(self, start, scene, shape, page) -> TermFunctions:
        """Return the term functions of the estimate `start`; new ones of any other."""
        if getattr(start, "origin", None) not in self._by_origin:
            return TermFunctions()
        known, functions = self._by_origin[start.origin]
        # A page that was edited and reloaded has another `build`.
        return functions if known == (scene, shape, page.build) else TermFunctions()

    def keep(self, estimate, job, page) -> None:
        """Keep the term functions of a job for solves that start from its estimate."""
        known = job.scene, job.shape, page.build
        self._by_origin[estimate.origin] = known, job.functions


PROCESS = Session()  # the default session: one in every process
