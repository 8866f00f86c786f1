"""Search for shapes with sizes by multi-hypothesis tracking.

Bodies that explain the first touch, a guess, or a posterior (a Gaussian mixture) are
tracked through all samples by the package `tracking`.  Smoothed tracks, and optima of
least motion from many (least_motion.py), far from each other, start the local solves.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import zip_longest

import numpy as np

from ..common.progress import progress
from ..data.contact_segments import samples_until
from ..data.sensor_noise import precise
from ..geometry.transforms import move_poses
from ..local.comparison import distinct, diverse_starts, of_other_yaw, same_body
from ..local.margins import DECISIVE
from ..problem.fingertips import as_spheres
from ..problem.hypothesis import UNSEARCHED, Hypothesis
from ..problem.job import Job
from ..tracking.carried import was_carried, with_carried
from ..tracking.initial_states import (
    DRAWN,
    body_height,
    from_guess,
    initial_states,
    mid_face_guess,
)
from ..tracking.tracking import explaining_first_touch, smoothed_states, tracks_after
from ..tracking.tracks import (
    KalmanFilter,
    SmootherStep,
    Tracks,
    filter_of,
    new_tracks,
    parts_of,
)
from .least_motion import ROUND, Executor, from_posterior, least_motion

log = logging.getLogger("tactilenlp")
SMOOTHED = 300  # tracks that are smoothed at most
TRACKS_PER_START = 5  # far from each other, from which least motion is solved
TRACK_SHARE = 4  # one start in so many is a track, the others are of least motion
TURNED_AS_A_WHOLE = 0.3  # [rad] a larger turn moves the past as one piece
POSTERIOR_PARTS = 250  # of a posterior: parts of all its hypotheses together


@dataclass(frozen=True)
class _Past:
    """What tracks continue: hypotheses, and how their poses follow size and last pose.

    along: d poses / d (theta, last pose) of each hypothesis, (T, 3, n + 3); parent
    (S,): index of the hypothesis that each first track continues; name: of the
    proposal; carried: whether the body may be, between two actions.
    """

    kept: tuple
    along: tuple
    parent: np.ndarray
    name: str = "track"
    carried: bool = False

    @property
    def samples(self) -> int:
        """How many samples are known."""
        return self.kept[0].x.shape[1] if self.kept else 0

    def with_track(self, of: int, begin, end, tail, objective) -> Hypothesis:
        """Return hypothesis `of`, changed to end at `begin`, with the poses `tail`."""
        theta = end[:-3]
        if not self.kept:
            return Hypothesis(
                theta, tail, objective, (self.name,), carried=self.carried
            )
        h = self.kept[of]
        change, path = begin - h.end, (*h.path, self.name)
        if abs(change[-1]) > TURNED_AS_A_WHOLE:
            past = move_poses(h.x, h.x[:, -1], begin[-3:])
        else:
            past = h.x + (self.along[of] @ change).T
        x = np.hstack([past, tail])
        return replace(
            h, theta=theta, x=x, objective=objective, path=path, carried=self.carried
        )


@dataclass(frozen=True, eq=False)
class _Run:
    """Tracks after the first samples: what they continue, how they came about."""

    past: _Past
    samples: int
    tracks: Tracks
    steps: tuple[SmootherStep, ...]

    def trajectories(self, samples: int, count: int) -> list[Hypothesis]:
        """Return the best tracks as trajectories of so many samples, best first."""
        past, tracks = self.past, self.tracks
        rows = np.argsort(-tracks.evidence, kind="stable")[:count]
        states, first = smoothed_states(self.steps, samples, rows)
        done, begin = past.samples, states[:, :, max(past.samples - 1, 0)]
        return [
            past.with_track(of, b, tracks.z[:, i], s[-3:, done:], -tracks.evidence[i])
            for i, s, b, of in zip(rows, states, begin, past.parent[first], strict=True)
        ]


@dataclass(frozen=True, eq=False)
class TrackingSearch:
    """The search for the starts of a job: tracks, and optima of least motion from them.

    kept: hypotheses of the first actions to continue, if any; count: of the starts;
    executor: see least_motion; keep(hypotheses): is called with those of the actions
    done, also by Ctrl-C; out_of: maps a resulting hypothesis to another frame.  Optima
    of least motion are kept: the same track is not solved twice.
    """

    job: Job
    kept: Sequence[Hypothesis]
    count: int
    executor: Executor | None = None
    keep: Callable[[list[Hypothesis]], None] = field(default=lambda _: None)
    out_of: Callable[[Hypothesis], Hypothesis] = field(default=lambda h: h)
    optima: dict = field(default_factory=dict, init=False)  # of least motion, by track

    def starts(self) -> list[Hypothesis]:
        """Return `count` starts, by least motion, and a likely one of another yaw.

        Where `kept` are of all samples nothing is searched: they are the starts.
        """
        if self.kept and self.kept[0].x.shape[1] == self.job.data.samples:
            return self._keep(self.kept)
        shape, count, tracks = self.job.shape, self.count, self._tracks()
        self._keep(tracks[:1])
        optima, starts = self._of_least_motion(tracks), []
        for h in diverse_starts(shape, optima, count - max(1, count // TRACK_SHARE)):
            if not any(same_body(shape, h, other) for other in starts):
                starts.append(h)
        pairs = zip(tracks, optima, strict=False)  # the last tracks need not be solved
        alone = [replace(h, objective=rest.objective) for h, rest in pairs]
        starts += alone[: count - len(starts)]
        if count > 1:  # beside faces an edge, say
            most = min(h.rank for h in tracks) + 2 * DECISIVE
            likely = [h for h, t in zip(alone, tracks, strict=False) if t.rank < most]
            starts += of_other_yaw(shape, likely, starts)[:1]
        return self._keep(sorted(starts, key=lambda h: h.rank))

    def least_motion_optima(self) -> list[Hypothesis]:
        """Return good optima of least motion from the first tracks, the best first."""
        optima = self._of_least_motion(self._far_apart[:ROUND])
        optima = sorted(optima, key=lambda h: h.objective)
        optima = distinct(self.job.shape, optima, ROUND, DECISIVE)
        return [self.out_of(h) for h in optima]

    def best_track(self) -> Hypothesis:
        """Return the best track as it is: another start than least motion."""
        return self.out_of(self._own_tracks[0])

    def _keep(self, hypotheses) -> list[Hypothesis]:
        """Return hypotheses in the other frame, and have them kept."""
        hypotheses = [self.out_of(h) for h in hypotheses]
        self.keep(hypotheses)
        return hypotheses

    def _of_least_motion(self, tracks) -> list[Hypothesis]:
        """Return the optima of least motion from tracks, in order."""
        return least_motion(self.job, tracks, self.executor, self.optima)

    @cached_property
    def _own_tracks(self) -> list[Hypothesis]:
        """Tracks that continue `kept`, smoothed, the best first."""
        return smoothed_tracks(self.job, self.kept, SMOOTHED, self._keep)

    @cached_property
    def _far_apart(self) -> list[Hypothesis]:
        """Tracks that continue `kept`, far from each other."""
        return self._diverse(self._own_tracks)

    @cached_property
    def _other_tracks(self) -> list[list[Hypothesis]]:
        """Tracks of other searches that are due, far from each other."""
        job, kept, again = self.job, self.kept, []
        if self._own_tracks[0].carried:  # soft fingertips may look alike
            stays = job.with_search(may_be_carried=False)
            again.append((stays, kept, "a search for a body that stays"))
        if kept and not precise(job.data, job.precision) and job.data.contact.any():
            # Noise leaves hypotheses open that the mixture has lost: 21 nats once.
            again.append((job, (), "a search from scratch"))
        return [
            self._diverse(smoothed_tracks(other, continued, SMOOTHED))
            for other, continued, name in again
            if not job.deadline.passed(name)
        ]

    def _diverse(self, tracks) -> list[Hypothesis]:
        """Return tracks that are far from each other."""
        return diverse_starts(self.job.shape, tracks, TRACKS_PER_START * self.count)

    def _tracks(self) -> list[Hypothesis]:
        """Return tracks far from each other, by every search that is due."""
        job, kept, count = self.job, self.kept, TRACKS_PER_START * self.count
        late = job.deadline.passed("other tracks")
        tracks = self._own_tracks[:1] if late else self._far_apart
        several = [tracks, *self._other_tracks]
        tracks = [h for each in zip_longest(*several) for h in each if h][:count]
        one_touch = job.data.actions == 1 and not (kept or job.search.guess)
        if one_touch and job.shape.faced:
            # Where one touch leaves size and place open, their middle is reported.
            data, sigma = as_spheres(job.data, job.scene), job.precision.normal
            theta, x = mid_face_guess(data, job.shape, sigma)
            guess = Hypothesis(theta, x[:, None], np.inf, ("middle",))
            middle = job.with_search(guess=guess)
            tracks = [*smoothed_tracks(middle, (), 1), *tracks][: len(tracks)]
        return tracks


def smoothed_tracks(job: Job, kept, count: int, keep=None) -> list[Hypothesis]:
    """Return the best tracks through all actions of a job, as smoothed trajectories.

    Their objective is the negative log evidence.  kept: hypotheses of fewer samples.
    keep(hypotheses): is called with the best of the actions done by Ctrl-C.
    """
    data = as_spheres(job.data, job.scene)
    ekf = filter_of(job, kept[0].with_offset(data) if kept else data)
    run = _tracked_actions(job, ekf, kept, keep, carried=False)
    if run is None:
        log.info("the body was carried between two actions: all are tracked again")
        run = _tracked_actions(job, ekf, kept, keep, carried=True)
    return run.trajectories(job.data.samples, count)


def _tracked_actions(job, ekf, kept, keep, carried: bool) -> _Run | None:
    """Return the tracks after all actions; at the deadline the body stays where it is.

    carried: whether a box may be elsewhere as each action begins.  If not, but that
    explains an action better: None.
    """
    rng = np.random.default_rng(0)
    tracks, past = proposed_tracks(job, ekf, kept, rng)
    past = replace(past, name="carried", carried=True) if carried else past
    data, done, state = ekf.data, past.samples, (tracks.z, tracks.P)
    begin = max(done - 1, 0)
    first = SmootherStep(begin, begin, *state, None, *state, None)
    run, actions = _Run(past, done, tracks, (first,)), np.unique(data.action[done:])
    try:
        for i, action in enumerate(progress(actions, "search")):
            rows = np.flatnonzero(data.action == action)
            rows = rows[rows >= done]
            if i and job.deadline.passed(f"{UNSEARCHED} {i + 1} on"):
                break
            (*steps, last), begun = run.steps, None
            after_gap = job.shape.faced and (i or done)
            if after_gap and carried:
                *begun, parents = with_carried(ekf, run.tracks, action, rng)
                last = last.selected(parents)
            tracks, more = tracks_after(ekf, run.tracks, rows, rng, begun)
            sought = after_gap and job.search.may_be_carried and not carried
            if sought and was_carried(ekf, run.tracks, tracks, rows):
                return None
            run = _Run(past, int(rows[-1]) + 1, tracks, (*steps, last, *more))
            words = "searched %d of %d actions: %d tracks, the best of %.1f nats"
            best = -tracks.evidence.max()
            log.info(words, i + 1, len(actions), tracks.z.shape[1], best)
    except KeyboardInterrupt:
        if keep is not None and run.samples > done:
            keep(run.trajectories(run.samples, 1))
        raise
    return run


def proposed_tracks(job, ekf: KalmanFilter, kept, rng) -> tuple[Tracks, _Past]:
    """Return the tracks to begin with, and the past that they continue."""
    fingers, sigma = ekf.data.fingers, job.precision.normal
    if not kept and (guess := job.search.guess) is not None:
        (name,), states = guess.path, from_guess(guess.end, ekf.geometry, rng)
        none = np.zeros(states[0].shape[1], int)
        return new_tracks(*states, fingers, rng), _Past((), (), none, name)
    if not kept:
        drawn = DRAWN * job.search.drawn
        states = initial_states(ekf.data, job.shape, rng, sigma, drawn)
        tracks = explaining_first_touch(ekf, new_tracks(*states, fingers, rng))
        return tracks, _Past((), (), np.zeros(len(tracks.evidence), int))
    done = kept[0].x.shape[1]
    earlier = replace(job, data=samples_until(job.data, done))
    P, along = zip(*from_posterior(earlier, kept), strict=True)
    z = np.array([h.end for h in kept]).T
    if job.shape.faced:
        z[2] = [body_height(ekf.data, job.shape, h, sigma) for h in z[2]]
    tracks = new_tracks(z, np.stack(P, axis=2), fingers, rng)
    cost = np.array([h.objective for h in kept])
    if np.isfinite(cost).all():  # proposals that nothing was solved for have none
        tracks = replace(tracks, evidence=cost.min() - cost)
    rows = np.repeat(np.arange(len(kept)), -(-POSTERIOR_PARTS // len(kept)))
    return parts_of(ekf, tracks, rows, rng), _Past(tuple(kept), along, rows)
