"""Coarse to fine in time: a dense recording is solved at the search's rate first.

Where the page starts, and which assumptions the data ask to give up, takes hundreds of
iterations to find, and no more samples than are tracked (tracking.PERIOD).  Of a
recording of a higher rate the tracked samples are estimated first.  Their optima,
interpolated in time, start the page of all samples, which converges in tens of
iterations from there.  A larger model is selected once, at the lower rate: errors of
the model last longer than a sample, so that more samples of a touch are no more
evidence for it.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from ..data.measurements import Measurements
from ..errors import NoContactError
from ..search.hypothesis import Hypothesis, Job
from ..tracking.tracking import stride_of, tracked_samples
from .refinement import on_ground
from .request import Request, check_touched

log = logging.getLogger("tactilenlp")
TIME_SHARE = 0.6  # [-] of a time limit, of the lower rate
MODELS = "rigid", "central", "planar"  # reductions that are selected at the lower rate


def tracked_rows(request: Request) -> np.ndarray | None:
    """Return the samples that are solved first; None if all of them are tracked.

    None as well where poses are given, or no touch lasts at the lower rate.
    """
    data = request.job.data
    if stride_of(data) == 1 or request.job.path is not None:
        return None
    each = (np.flatnonzero(data.action == a) for a in np.unique(data.action))
    rows = np.concatenate([tracked_samples(data, samples) for samples in each])
    try:
        check_touched(_part(data, rows))
    except NoContactError:
        return None
    return rows


def at_rows(request: Request, rows) -> Request:
    """Return the request for some of the samples, within TIME_SHARE of its limit.

    An update starts from the hypotheses of its start, not from the objective of that.
    """
    limit, deadline = request.options.time_limit, request.job.deadline
    early = deadline.until(deadline.at - (1 - TIME_SHARE) * limit, deadline.strict)
    job = replace(request.job, data=_part(request.job.data, rows), deadline=early)
    options = replace(request.options, time_limit=TIME_SHARE * limit)
    start = None if hasattr(request.start, "measurements") else request.start
    data = _part(request.data, rows)
    return replace(request, data=data, job=job, options=options, start=start)


def at_full_rate(request: Request, coarse: Job) -> Request:
    """Return the request for the models that were selected at the lower rate."""
    made = {name: getattr(coarse.reductions, name) for name in MODELS}
    job = on_ground(request.job, coarse.scene.ground)
    job = replace(job, reductions=replace(job.reductions, **made))
    return replace(request, job=job)


def interpolated(h: Hypothesis, data: Measurements, rows) -> Hypothesis:
    """Return a hypothesis at all samples of the data; x (unknowns, T).

    h: at some rows; before the first one of an action the body is where it is there.
    """
    done = h.x.shape[1]
    rows = rows[:done]
    x = np.empty((len(h.x), int(rows[-1]) + 1))
    action = data.action[: x.shape[1]]
    for number in np.unique(action):
        samples = np.flatnonzero(action == number)
        mine = data.action[rows] == number
        known, poses = data.time[rows[mine]], h.x[:, :done][:, mine]
        for row, pose in zip(x, poses, strict=True):
            row[samples] = np.interp(data.time[samples], known, pose)
    return replace(h, x=x)


def at_tracked(h: Hypothesis, rows) -> Hypothesis:
    """Return a hypothesis of the first actions at those of the rows that it has."""
    return replace(h, x=h.x[:, rows[rows < h.x.shape[1]]])


def _part(data: Measurements, rows) -> Measurements:
    return Measurements(**data.arrays(rows))
