"""Coarse to fine in time: above 45 Hz a recording is first estimated at about 30 Hz.

Search and model selection run at that rate only (1 / PERIOD): they take
hundreds of iterations and need no more samples, and errors of the model last longer
than a sample, so that more samples of a touch are no more evidence for a larger model.
The optima, interpolated linearly, start the solve of all samples, which takes tens of
iterations (100 Hz: 118 to 46 CPU s, 200 Hz: 291 to 50; results/EXPERIMENTS.md).
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from ..certificates.certify import certify
from ..data.contact_segments import tracked_samples
from ..data.measurements import Measurements
from ..errors import NoContactError
from ..geometry.transforms import is_planar
from ..interface.checks import check_touched
from ..interface.request import Request
from ..local.comparison import distinct
from ..local.margins import LEAST_MOTION_BEHIND
from ..local.solved import Solved
from ..problem.hypothesis import Hypothesis
from ..refinement.nested_models import NUISANCES
from ..refinement.sensor_lags import estimate_lags
from ..search.multistart import multistart
from .initial_search import REFINEMENT_END
from .interrupted import Incumbents
from .optima import OTHER_SOLVES, Optima, certify_best, optima_of

TIME_SHARE = 0.6  # [-] of a time limit, of the lower rate: it took 0.5 to 0.8 of all
SELECTED = (*NUISANCES, "planar", "still")  # reductions selected at the lower rate


def coarse_rows(request: Request) -> np.ndarray | None:
    """Return the samples that are solved first; None if all of them are tracked.

    None as well where poses are given, or no touch lasts at the lower rate.
    """
    data = request.job.data
    rows = tracked_samples(data)
    if len(rows) == data.samples or request.job.search.hypothesis is not None:
        return None
    try:
        check_touched(_at_rows(data, rows))
    except NoContactError:
        return None
    return rows


def optima_of_dense(request: Request, rows, incumbents: Incumbents) -> Optima:
    """Return the optima at all samples, started from those at some rows.

    Profile likelihoods, and the models that were declined, are those of the lower rate.
    """
    data = request.job.data
    part = Incumbents([at_coarse_rows(h, rows) for h in incumbents.kept])
    try:
        coarse = optima_of(coarse_request(request, rows), part)
    except KeyboardInterrupt:
        ends = [s.at for s in part.solves.best_first()]
        flat = [h for h in ends if is_planar(h.x)] or part.kept
        incumbents.kept = [interpolate(h, data, rows) for h in flat]
        raise
    incumbents.kept = kept = [interpolate(h, data, rows) for h in coarse.kept]
    incumbents.searched = part.searched
    if (coarse_best := coarse.best) is None:
        starts = [interpolate(h, data, rows) for h in coarse.starts]
        return replace(coarse, kept=kept, starts=starts)
    made = {name: getattr(coarse_best.job.reductions, name) for name in SELECTED}
    job = request.job.as_found(coarse_best.job).with_reductions(**made)
    dense = replace(request, job=job)
    starts = [interpolate(s.at, data, rows) for s in (coarse_best, *coarse.modes)]
    starts = distinct(dense.job.shape, starts, request.widths[1], LEAST_MOTION_BEHIND)
    job, solves = dense.job_until(REFINEMENT_END), incumbents.solves.part()
    with job.deadline.ending(OTHER_SOLVES):
        multistart(job, starts, job.page.LEVELS, solves=solves)
    solved = solves.best_first()
    if not solved:
        return Optima(None, [], kept, starts)
    solved = estimate_lags(solved)  # more samples tell more of it
    optima = Optima(None, solved, kept, starts)
    optima = certify_best(dense, optima, partial(_certify_dense, coarse_best))
    declined, profile = coarse_best.declined, coarse_best.profile
    best = replace(optima.best, declined=declined, profile=profile)
    return replace(optima, best=best)


def coarse_request(request: Request, rows) -> Request:
    """Return the request for some of the samples, within TIME_SHARE of its limit.

    An earlier estimate is no `start`, since its objective is of all samples; its
    hypotheses are continued.
    """
    limit, deadline = request.job.options.time_limit, request.job.deadline
    early = deadline.before_end((1 - TIME_SHARE) * limit)
    early = deadline.until(early, deadline.strict)
    options = replace(request.job.options, time_limit=TIME_SHARE * limit)
    job = request.job.of_data(partial(_at_rows, rows=rows))
    job = replace(job, deadline=early, options=options)
    data = _at_rows(request.data, rows)
    return replace(request.from_scratch(), data=data, job=job)


def interpolate(h: Hypothesis, data: Measurements, rows) -> Hypothesis:
    """Return a hypothesis at all samples, x (unknowns, samples), linear between rows.

    h: at the first of the rows; before the first one of an action the body rests.
    """
    rows = rows[: h.x.shape[1]]
    x = np.empty((len(h.x), int(rows[-1]) + 1))
    action = data.action[: x.shape[1]]
    for number in np.unique(action):
        samples, knots = np.flatnonzero(action == number), data.action[rows] == number
        for row, pose in zip(x, h.x[:, knots], strict=True):
            row[samples] = np.interp(data.time[samples], data.time[rows[knots]], pose)
    return replace(h, x=x)


def at_coarse_rows(h: Hypothesis, rows) -> Hypothesis:
    """Return a hypothesis of the first actions at those of the rows that it has."""
    return replace(h, x=h.x[:, rows[rows < h.x.shape[1]]])


def _certify_dense(coarse: Solved, solved) -> Solved:
    """Return a solve at all samples with its certificates.

    Rest is certified at the lower rate: at the full one, what the balance of the first
    moving step leaves is a large force on the pose before.
    """
    if solved.job.deadline.passed("certificates"):
        return solved
    still = [s for s in coarse.certificates.skipped if s.name == "still"]
    return replace(solved, certificates=certify(solved.job, solved, *still))


def _at_rows(data: Measurements, rows) -> Measurements:
    """Return the data at some rows."""
    return Measurements(**data.arrays(rows))
