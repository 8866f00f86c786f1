"""Log likelihood of a record of touches under physical invariants.

Every term is the log likelihood of one kind of event, relative to a uniform density: it
mixes what physics says of the event with a small probability of a departure,

    log((1 - departure) p(event) + departure),

so that no single event decides.  The terms are added as if they were independent (a
composite likelihood).  The departures are upper bounds: in the 1495 onsets, 2282 pairs
of touches and 857 actions of the recordings that this package is tested with, a finger
never begins to touch against the felt normal, 0.5 % of the pairs lie outside each
other's planes, and no other departure but 39 releases occurs.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy.special import ndtr

from .touch_events import Record

# [1] probabilities of a departure
AGAINST_NORMAL = 0.02  # a touch begins while the finger moves along the felt normal
BODY_MOVES = 0.1  # the same while other fingers may move the body
AT_REST = 0.02  # a touch begins though neither this finger nor the body moves
LET_GO = 0.1  # a touch ends while the finger presses on: the body gets away
BEGUN = 0.4  # an action begins in contact: programmes push on from where they are
OUTSIDE_PLANE = 0.05  # a touched point lies outside another touched plane
INSIDE_FINGER = 0.05  # a finger passes a point that was touched, and feels nothing
FINGERS_OVERLAP = 0.05  # two fingers overlap in an action
JUMP = 1e-3  # a finger jumps within an action
BELOW = 0.01  # the centre of a finger is below the ground
NO_KINK = 0.05  # a path bends elsewhere, by something else than the touch

RATES = (np.arange(20) + 0.5) / 20  # [1] of departures, where they are not known

ONSET_STEPS = 4  # samples of a path before a touch
LARGEST_ONSET = 4.4  # [-] density of an onset, with the largest noise of a direction
AROUND_RELEASE = 2  # samples of a path before the end of a touch
EXACT_POSITION, EXACT_NORMAL = 1e-4, 0.03  # [m], [rad] least noise of a direction
BLUNT = 2e-3  # [m] by which a contact point is off: fingertips yield
CLEAR_SIGMAS = 3.0  # [sigma] from which a length is not due to noise
JUMP_RATIO, JUMP_LENGTH = 5.0, 5e-3  # of the neighbouring steps, and at least [m]
USUAL_RADIUS, RADIUS_SPREAD = 0.012, 0.3  # [m], [decades]: human and robot fingertips
KINK_REACH, KINK_WINDOW = 14, 10  # samples of a path, and where it may bend
KINK_FLOOR = 7e-4  # [m] by which paths differ from a cubic with kinks
# [samples] beside a kink; [-] of the way before it that a finger which turned goes back
KINK_SPAN, KINK_TURN = 3, 0.1
FITTED = 3 * (4 + 2)  # numbers of a cubic and two kinks, of three coordinates
LEAST_ANGLE = 1e-6  # [-] of two kinks: sin^2 below which they are one
# Probability of the samples by which a path bends later than its touch is reported: a
# soft contact or a light body slows the finger only gradually.
KINK_LAG = dict(enumerate((0.05, 0.45, 0.25, 0.1, 0.04, 0.02, 0.02, 0.01, 0.01), -2))


def log_likelihood(record: Record, terms: Sequence[str] | None = None) -> dict:
    """Return the log likelihood [nats] of these terms, by default of all."""
    return {name: float(TERMS[name](record)) for name in terms or TERMS}


def most_log_likelihood(record: Record, terms: Sequence[str]) -> float:
    """Return an upper bound of the sum of these terms, the events as they are [nats].

    terms: without "kinks", which have no bound.  All others but onsets are logarithms
    of probabilities.
    """
    onsets_of_record = len(record.events.onset[0]) * ("onsets" in terms)
    return onsets_of_record * float(_mixed(LARGEST_ONSET, AGAINST_NORMAL))


def _mixed(density, departure):
    """Return the log density of an event that departs from its law that often."""
    return np.log((1 - departure) * density + departure)


def of_one_rate(density, departure) -> float:
    """Return the log likelihood of events (N,) that may depart for the same reason.

    A motion that is repeated departs again: the rate of a recording is as likely any as
    the usual one.
    """
    each = _mixed(density, np.r_[departure, RATES][:, None]).sum(axis=1)
    share = np.full(len(RATES), 0.5 / len(RATES))
    return float(np.logaddexp.reduce(each + np.log(np.r_[0.5, share])))


def _mean_normal(record: Record, t, f, offsets) -> np.ndarray:
    """Return the mean normal (N, 3) of finger f at offsets from t; zero: unknown."""
    first, last = record.bounds
    rows = t[:, None] + np.array(offsets)
    inside = (rows >= first[t][:, None]) & (rows <= last[t][:, None])
    rows = np.where(inside, rows, t[:, None])
    felt = (inside & record.felt[rows, f[:, None]])[..., None]
    total = (record.normal[rows, f[:, None]] * felt).sum(axis=1)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return total / np.where(length > 0, length, 1.0)


def _cosine(record: Record, way, n) -> tuple[np.ndarray, np.ndarray]:
    """Return the cosine of a way (N, 3) [m] and a normal, and its sigma."""
    length = np.maximum(np.linalg.norm(way, axis=1), 1e-9)
    noise = np.sqrt(2) * max(record.sigma_position, EXACT_POSITION) / length
    sigma = np.minimum(np.hypot(record.sigma_normal, noise), 1.0) + EXACT_NORMAL
    return (way * n).sum(axis=1) / length, sigma


def _others_touch(record: Record, t, f) -> np.ndarray:
    """Return whether another finger touches at the samples t or just before."""
    rows = np.maximum(t[:, None] - np.arange(3), record.bounds[0][t][:, None])
    others = record.felt[rows].sum(axis=2) - record.felt[rows, f[:, None]]
    return others.any(axis=1)


def onsets(record: Record) -> float:
    """A touch begins while the finger moves against the felt normal.

    Directions of approach are uniform in a plane across the normal, so that the cosine
    c to the normal has the density 2 c on [0, 1], blurred by noise.
    """
    t, f = record.events.onset
    n = _mean_normal(record, t, f, (0, 1, 2))
    way = record.place(t, f, -ONSET_STEPS) - record.position[t, f]
    c, sigma = _cosine(record, way, n)
    z = c / sigma
    blurred = c * ndtr(z) + sigma * np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi)
    has_normal, others = n.any(axis=1), _others_touch(record, t, f)
    alone = _mixed(4 * blurred[has_normal & ~others], AGAINST_NORMAL).sum()
    return alone + of_one_rate(4 * blurred[has_normal & others], BODY_MOVES)


def onsets_at_rest(record: Record) -> float:
    """A touch begins only where the finger, or others with the body, move.

    The displacement before it is noise at rest, else uniform in a ball of rms radius.
    """
    onset = np.array(record.events.onset)
    t, f = onset[:, ~_others_touch(record, *onset)]
    way, noise = record.way_before(t, f, ONSET_STEPS)
    sigma = np.hypot(noise, EXACT_POSITION)
    at_rest = np.exp(-0.5 * (way / sigma) ** 2) / (np.sqrt(2 * np.pi) * sigma) ** 3
    usual = np.hypot(record.usual_way(ONSET_STEPS), sigma)
    rest = at_rest / (at_rest + 3 / (4 * np.pi * usual**3))
    return np.log1p((AT_REST - 1) * rest).sum()


def releases(record: Record) -> float:
    """A touch ends while the finger moves along the normal."""
    t, f = record.events.release
    n = _mean_normal(record, t, f, (-1, -2, -3))
    way = record.place(t, f, 1) - record.place(t, f, -AROUND_RELEASE)
    c, sigma = _cosine(record, way, n)
    return of_one_rate(ndtr(2 + c / sigma)[n.any(axis=1)], LET_GO)


def begins_touched(record: Record) -> float:
    """An action begins without contact."""
    return np.log(BEGUN) * record.events.begun


def planes(record: Record) -> float:
    """The body is convex: touched points lie behind every touched plane."""
    t, f, u, g, weight = record.events.pairs
    apart = record.contact_point(u, g) - record.contact_point(t, f)
    n, has_normal = record.normal[t, f], record.normal[u, g].any(axis=1)
    by_turn = record.sigma_normal * np.linalg.norm(apart, axis=1)
    placed = np.hypot(BLUNT + record.slack, np.sqrt(2) * record.sigma_position)
    z = (n * apart).sum(axis=1) / np.hypot(placed, by_turn)
    each = _mixed(ndtr(2 - z), OUTSIDE_PLANE)
    return (weight * (has_normal & n.any(axis=1)) * each).sum()


def passages(record: Record) -> float:
    """A finger that feels nothing does not contain a point that was touched."""
    t, f, u, g = record.events.before
    way = record.position[t, f] - record.contact_point(u, g)
    sigma = np.hypot(BLUNT + record.slack, record.sigma_position)
    deep = record.radius[f] - np.linalg.norm(way, axis=1) > CLEAR_SIGMAS * sigma
    deep &= record.normal[u, g].any(axis=1)
    first = record.bounds[0][t[deep]]
    return np.log(INSIDE_FINGER) * len(set(zip(first, f[deep], strict=True)))


def overlaps(record: Record) -> float:
    """Two fingers do not overlap."""
    count, fingers = 0, len(record.radius)
    for f in range(fingers):
        for g in range(f):
            apart = np.linalg.norm(np.diff(record.position[:, [f, g]], axis=1), axis=-1)
            sigma = BLUNT + record.sigma_position
            least = record.radius[[f, g]].sum() - CLEAR_SIGMAS * sigma - record.slack
            both = record.valid[:, [f, g]].all(axis=1)
            count += len(np.unique(record.action[both & (apart[:, 0] < least)]))
    return np.log(FINGERS_OVERLAP) * count


def jumps_of(record: Record) -> np.ndarray:
    """Return how often each finger (F,) jumps within an action.

    In a longer lapse it goes farther, in a shorter one it may have gone as far: clocks
    are inexact.
    """
    lapse = np.diff(record.time)
    step = np.linalg.norm(np.diff(record.position, axis=0), axis=2)
    within = np.diff(record.action) == 0
    usual = np.median(lapse[within]) if within.any() else 1.0
    step = np.where(within, np.minimum(usual / lapse, 1.0), 0.0)[:, None] * step
    none = np.zeros((1, step.shape[1]))
    beside = np.maximum(np.vstack([none, step[:-1]]), np.vstack([step[1:], none]))
    noise = 10 * record.sigma_position + JUMP_LENGTH
    return (step > JUMP_RATIO * beside + noise).sum(axis=0)


def jumps(record: Record) -> float:
    """A finger does not jump within an action."""
    return np.log(JUMP) * jumps_of(record).sum()


def heights(record: Record) -> float:
    """The centres of the fingers lie above the ground."""
    height = record.position @ record.up - record.level
    below = record.valid & (height < -CLEAR_SIGMAS * record.sigma_position)
    return np.log(BELOW) * below.any()


def radii(record: Record) -> float:
    """The radius of a fingertip is log-normal."""
    return -0.5 * (np.log10(record.radius / USUAL_RADIUS) / RADIUS_SPREAD).max() ** 2


def kinks(record: Record) -> float:
    """A path is smooth; it bends where the finger begins to touch, or turns."""
    return sum(_kink(record, t, f) for t, f in zip(*record.events.onset, strict=True))


def _kink(record: Record, t: int, f: int) -> float:
    """Return the log likelihood of a kink near sample t in the path of finger f.

    The path around t is a cubic plus the kink of the touch at an unknown sample, and
    one where the finger was told to turn round, if it does: no touch turns it.  The
    profile over the pairs, the noise eliminated, gives the probability of each sample.
    """
    first, last = (int(bound[t]) for bound in record.bounds)
    begin, end = max(first, t - KINK_REACH), min(last, t + KINK_REACH)
    at, cubic, hinges, gram, lag = _kinked_cubics(int(t) - begin, end - int(t))
    p = record.position[begin : end + 1, f]
    p = p - p.mean(axis=0)
    here = at + int(t) - begin
    before = p[here] - p[np.maximum(here - KINK_SPAN, 0)]
    after = p[np.minimum(here + KINK_SPAN, len(p) - 1)] - p[here]
    on = (before * after).sum(axis=1) >= -KINK_TURN * (before**2).sum(axis=1)
    if not (on * lag).any():
        return 0.0
    pair = np.eye(len(on), dtype=bool) | ~on  # of a touch alone, of it and a turn
    smooth = (p**2).sum() - ((cubic.T @ p) ** 2).sum()
    c = hinges @ p
    one = (c**2).sum(axis=1)  # of hinges of length one, across the cubics
    both = one[:, None] + one - 2 * gram * (c @ c.T)
    explained = both / np.maximum(1 - gram**2, LEAST_ANGLE)
    np.fill_diagonal(explained, one)
    left = np.maximum(smooth - explained, 0.0) + p.size * KINK_FLOOR**2
    left = np.where(pair & on[:, None], left, np.inf)
    each = (left / left.min()) ** (-0.5 * (p.size - FITTED))
    share = each.sum(axis=1) / pair.sum(axis=1)
    density = on.sum() * (lag @ share) / share.sum()
    return float(_mixed(density, NO_KINK))


@lru_cache(maxsize=1024)
def _kinked_cubics(back: int, ahead: int) -> tuple[np.ndarray, ...]:
    """Return K offsets from t, a basis (n, 4) of cubics, and kinks at these samples.

    The basis is orthonormal.  Kinks (K, n) are of length one and orthogonal to all
    cubics, with their products (K, K); and the probability (K,) of each sample.  Empty
    where the path is too short.
    """
    s = np.arange(-back, ahead + 1.0)
    at = np.arange(max(-KINK_WINDOW, 3 - back), min(KINK_WINDOW, ahead - 1) + 1)
    if len(s) < 8 or not len(at):
        return np.zeros(0, int), *(np.zeros((0, 0)),) * 3, np.zeros(0)
    cubic = np.linalg.qr(np.vander(s / KINK_REACH, 4))[0]
    hinges = np.maximum(s[None, :] - at[:, None], 0) / KINK_REACH
    hinges = hinges - hinges @ cubic @ cubic.T
    hinges /= np.linalg.norm(hinges, axis=1, keepdims=True)
    lag = np.array([KINK_LAG.get(int(k), 0.0) for k in at])
    return at, cubic, hinges, hinges @ hinges.T, lag / max(lag.sum(), 1e-9)


TERMS = {
    term.__name__: term
    for term in (
        onsets, onsets_at_rest, releases, begins_touched, planes, passages, overlaps,
        jumps, heights, radii, kinks,
    )
}  # fmt: skip
