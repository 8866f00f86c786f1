"""Update from few starts: an estimate that fits well is continued from these first."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import NamedTuple

from ..data.sensor_noise import precise
from ..interface.request import Request
from ..local.solved import Solved
from ..refinement.incremental import can_update, of_whole_actions, update_by_few_starts
from ..search.multi_hypothesis import TrackingSearch
from .initial_search import REFINEMENT_END, reduced_job, search_in_contact_frame
from .interrupted import Incumbents

log = logging.getLogger("tactilenlp")


class FewStarts(NamedTuple):
    """An update from few starts, before others are searched for.

    search: as far as it came, for the others to continue; solved: the page solved from
    these starts; enough: whether they suffice.  Without an update, `solved` is empty.
    """

    search: TrackingSearch | None = None
    solved: Sequence[Solved] = ()
    enough: bool = False


def update_from_few_starts(request: Request, incumbents: Incumbents) -> FewStarts:
    """Return what few starts lead to that continue the estimate of a request.

    Where a shape with sizes slid flat and its first actions fit well; noise leaves more
    optima open than few starts find, and a page without levels from guessed poses needs
    all of its levels.
    """
    job, start = request.job_until(REFINEMENT_END), request.start
    may_do = incumbents.kept and job.search.hypothesis is None
    may_do = may_do and not job.shape.of_vertices
    may_do = may_do and job.reductions.planar and job.contract.rough
    may_do = may_do and precise(job.data, job.precision)
    if not (may_do and can_update(start, job) and of_whole_actions(start, job)):
        return FewStarts()
    search = search_in_contact_frame(request, reduced_job(request), incumbents)
    enough, solves = False, incumbents.solves.part()
    with job.deadline.ending("an update by few starts"):
        enough = update_by_few_starts(
            job, start, search.least_motion_optima(), search.best_track, solves
        )
    solved = solves.best_first()
    if solved:
        more = solved[0].solution.objective - start.objective
        words = ", no others are needed" if enough else ""
        log.info("%d starts of an update: %.1f nats more%s", len(solved), more, words)
    return FewStarts(search, solved, enough)
