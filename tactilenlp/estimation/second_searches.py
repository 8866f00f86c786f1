"""Second searches: when the result of a first one asks for another, and of what job.

A search is repeated where its assumptions turned out to be wrong (latency, soft
fingertips of a polytope, a ground that leans), where an update costs too much, and,
where the trajectory is doubtful, from more hypotheses.
"""

from __future__ import annotations

import logging
from dataclasses import replace

from ..interface.request import Request
from ..interface.session import Guess
from ..local.solved import Solved
from ..problem.job import Job
from ..refinement.nested_models import lost_by_compliance
from ..refinement.refinement import update_costs_too_much
from ..refinement.sensor_lags import lost_by_latency
from ..search.plane_slam import DOUBTFUL_PATHS
from ..tracking.initial_states import DOUBTFUL_DRAWN
from .initial_search import SEARCH_END

log = logging.getLogger("tactilenlp")


def job_to_search_again(job: Job, best: Solved) -> Job | None:
    """Return the job that is to be searched again, as a solve found it, if any."""
    if lost_by_latency(job, best):
        log.info("searching again with the latency that was found")
        return job.as_late_as(best.job.precision)
    if lost_by_compliance(job, best):
        log.info("searching again with soft fingertips")
        return job.as_found(best.job)
    return None


def search_that_may_gain(request: Request, best: Solved) -> Request | None:
    """Return the request of a search from scratch that may find a better optimum.

    Where an update costs more than it should, and on a ground that was found to lean:
    the first search took it for level.
    """
    ground, assumed = best.job.scene.ground, request.job.scene.ground
    searched = request.job.search.hypothesis is None
    if ground is not assumed and assumed.told is None and searched:
        log.info("searching again on the ground that leans")
        return replace(request.from_scratch(), job=request.job.as_found(best.job))
    if update_costs_too_much(request, best):
        return request.from_scratch()
    return None


def from_more_hypotheses(request: Request, like: Job) -> Request | None:
    """Return the request of a search of all actions from more hypotheses.

    More first bodies are drawn; of a polytope more paths of an action are continued.
    like: the job of a solve, as which it begins (`Job.as_found`).  None from a user's
    guess, about which as many are drawn, or without time.
    """
    guessed = isinstance(request.start, Guess)
    if guessed or not in_time(request):
        return None
    log.info("the trajectory is doubtful: searching from more hypotheses")
    drawn = DOUBTFUL_PATHS if request.job.shape.of_vertices else DOUBTFUL_DRAWN
    job = request.job.as_found(like).with_search(drawn=drawn)
    return replace(request.from_scratch(), job=job)


def in_time(request: Request) -> bool:
    """Tell whether there is time for another search."""
    return request.job_until(SEARCH_END).deadline.left > 0
