"""Proposals for an object that tipped over: the tumble, and what was known before.

An object that is pushed high tips over its far bottom edge: the measured normal of the
pushed side rises with the tilt, then the object falls like a pendulum and comes to lie
on the next face.  There it slides again; a turn by 90 degrees permutes the sides.  So a
tumble is proposed from the normals, what follows is tracked in the plane, and
both together start one local solve in free motion.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from formulations import quasi_static

from ..certificates.outliers import side_tilt
from ..data.contact_segments import SIDE_NORMAL, felt_sides, intervals
from ..geometry.tipping import QUARTER_TURN, Tip, fall, planar_to_free
from ..geometry.transforms import matrices, move_poses, rotate_planar, rotvecs
from ..local.comparison import distinct
from ..local.solved import BuiltPage
from ..problem.hypothesis import Hypothesis
from ..problem.reductions import Reductions, window_of_samples
from ..tracking.initial_states import BELOW_TOP
from .contact_frame import ContactFrame
from .multi_hypothesis import SMOOTHED, TrackingSearch, smoothed_tracks

TIPPING_TILT = np.radians(2)  # a side normal that rises further shows tipping
DEPTH_SHARES = (1.0, 2 / 3)  # [-] of the proposed depth: the edge is not observed
# Which of the two horizontal sides are taken from before the tumble:
KNOWN_SIDES = tuple(np.array(k, bool) for k in ((0, 0), (0, 1), (1, 0), (1, 1)))
MAX_TUMBLES = 100  # proposals that are continued, the likeliest first


@dataclass(frozen=True, eq=False)
class Tumble:
    """A proposal of how the last action of a job went on: theta (3,), x (6, T), name.

    before: the planar hypothesis until it tipped; start: the sample at which it tips.
    """

    theta: np.ndarray
    x: np.ndarray
    name: str
    before: Hypothesis
    start: int
    tip: Tip

    def fallen(self, samples: int) -> Hypothesis:
        """Return the planar hypothesis of the fallen object, at rest for `samples`."""
        S = self.tip.renamed
        p, R = self.tip.poses(self.theta, self.before.x[:, self.start])
        ahead = (R[-1] @ S.T)[:2, 0]
        x = np.r_[p[-1, :2], np.arctan2(ahead[1], ahead[0])]
        path = (*self.before.path, self.name)
        x = np.repeat(x[:, None], samples, axis=1)
        return Hypothesis(np.abs(S) @ self.theta, x, np.inf, path)

    def whole_motions(self, later: Hypothesis) -> Iterator[Hypothesis]:
        """Yield the whole motions, free: tumbled so as to lie where `later` begins.

        later: planar poses of the renamed object from the action of the tumble on.  One
        motion for each of KNOWN_SIDES, their rotations are the same.  How tall the
        object stood, and where the pushed side was, is always taken from before.
        """
        S, tip, n, k = self.tip.renamed, self.tip, len(self.tip.angle), self.start + 1
        stood, landed = self.before.x[:, self.start], later.x[:, n - 1]
        tail, x = slice(n - (self.x.shape[1] - k), n), np.zeros(3)
        ahead = (tip.poses(self.theta, x)[1][-1] @ S.T)[:2, 0]
        x[2] = landed[2] - np.arctan2(ahead[1], ahead[0])
        R, turns = tip.poses(self.theta, x)[1], tip.turns(x)
        before, after = self.before.x[:, :k], later.x[:, n:]
        R_past, R_after = (
            matrices(planar_to_free(self.theta, flat))
            for flat in (move_poses(before, stood, x), after)
        )
        R_after = R_after @ S
        w = rotvecs(np.concatenate([R_past, R[tail], R_after]))
        for known in KNOWN_SIDES:
            theta = np.abs(S).T @ later.theta
            theta[2] = max(theta[2], self.theta[2])
            theta[:2] = np.where(known, self.theta[:2], theta[:2])
            x[:2] = self._upright(theta, x[2], turns, stood, landed)
            p = tip.positions(theta, x, turns)
            off = R[-1].T @ (p[-1] - [*landed[:2], p[-1, 2]])
            p_past = planar_to_free(theta, move_poses(before, stood, x))[:3].T
            p_after = planar_to_free(np.abs(S) @ theta, after)[:3].T + R_after @ off
            p = np.vstack([p_past, p[tail], p_after])
            yield replace(later, theta=theta, x=np.hstack([p, w]).T)

    def _upright(self, theta, yaw, turns, stood, landed) -> np.ndarray:
        """Return the place (2,) from which it tips, its yaw known, to lie at `landed`.

        Along the fall the pushed side stays where it `stood`; across, it may slide.
        """
        tip, x = self.tip, np.r_[0, 0, yaw]
        out = -tip.fall(x)[:2]
        place = landed[:2] - tip.positions(theta, x, turns)[-1, :2]
        grown = (theta - self.theta)[tip.axis] / 2
        return place + out * (out @ (stood[:2] - place) - grown)


def last_tumbles(job, kept) -> list[Tumble]:
    """Return proposals of how the object tumbled in the last action of a job.

    kept: planar hypotheses of the actions before, none if it is the first.
    """
    data, out = job.data, []
    side = felt_sides(data)
    side &= (data.action == data.action[-1])[:, None]
    highest = data.finger_position[side][:, 2].max(initial=-np.inf)
    for h in smoothed_tracks(job, kept, SMOOTHED):
        height = max(h.theta[2], highest + BELOW_TOP)  # tall enough for its sides
        h = replace(h, theta=np.r_[h.theta[:2], height])
        start, tipped = _last_tip(job, h)
        for share, tip in tips_to_try(tipped) if tipped is not None else ():
            thin, name = _less_deep(h, tip, share), f"tips {len(out)}"
            p, R = tip.poses(thin.theta, thin.x[:, start])
            flat = planar_to_free(thin.theta, thin.x[:, : start + 1])
            fallen = np.hstack([p, rotvecs(R)])[:-1].T
            left = h.x.shape[1] - flat.shape[1]  # none where it tips at the end
            x = np.hstack([flat, fallen[:, fallen.shape[1] - left :]])
            out.append(Tumble(thin.theta, x, name, thin, start, tip))
    return out


def tips_to_try(tip: Tip) -> list:
    """Return (share of the depth, tip): over the edge, and back if it still stands.

    Where the record ends while it is tipped less than halfway, either may follow.
    """
    ways = [(share, tip) for share in DEPTH_SHARES]
    if tip.angle[-1] < QUARTER_TURN / 2:
        ways.append((1.0, replace(tip, end=0.0)))
    return ways


def _less_deep(h: Hypothesis, tip: Tip, share: float) -> Hypothesis:
    """Return the hypothesis with less depth behind the pushed side, which stays."""
    theta = h.theta.copy()
    theta[tip.axis] *= share
    fall = np.array([tip.fall(x) for x in h.x.T])
    shift = (theta - h.theta)[tip.axis] / 2 * fall.T
    return replace(h, theta=theta, x=h.x + shift * [[1], [1], [0]])


def tumbling_motions(job, evidence, width: int, solves: int, executor=None):
    """Return free hypotheses of all actions, best first: it tumbled in one of them.

    evidence: of outliers.unexplained_by_action for the best planar hypothesis. Any
    action that contradicts sliding and shows a rising normal may be the one.
    """
    frame = ContactFrame.of(job)
    job, actions, motions = frame.job(job), np.unique(job.data.action), []
    for action in [e.action for e in evidence if e.against and e.tilt > TIPPING_TILT]:
        hypotheses = []
        if job.data.contact[job.data.action < action].any():
            part = replace(job, data=job.data.select(actions[actions < action]))
            hypotheses = TrackingSearch(part, (), solves, executor).starts()
        part = replace(job, data=job.data.select(actions[actions <= action]))
        tumbles = likeliest_tumbles(part, last_tumbles(part, hypotheses))
        if tumbles:
            motions += motions_after(job, tumbles, width, solves, executor)
    motions = distinct(job.shape, motions, width, np.inf)
    return [frame.out_of(h) for h in motions]


def motions_after(job, tumbles, width: int, solves: int, executor=None):
    """Return free hypotheses of all actions of a job: tumbled, then slid, best first.

    job: the data from the first action on; tumbles: of one action of it. What
    comes after is tracked. The results and what was known before are joined in
    every way; the objective is that of the likelihoods, on the coarse level.
    """
    action = job.data.action[tumbles[0].x.shape[1] - 1]
    data = job.data.select([a for a in np.unique(job.data.action) if a >= action])
    valid = data.valid.copy()
    valid[: max(t.tip.landed for t in tumbles)] = False
    part = replace(job, data=replace(data, valid=valid))
    felt = part.data.contact.any(axis=1) & (data.action > action)
    touched = np.append(data.action[felt], data.action[-1] + 1)
    rest = int(np.searchsorted(data.action, touched[0]))
    fallen = [t.fallen(rest) for t in tumbles]
    later = TrackingSearch(part, fallen, solves, executor).starts()
    alone = rest == data.samples  # nothing was felt later: each lies as it fell
    pairs = zip(fallen, tumbles, strict=True) if alone else product(later, tumbles)
    motions = [(h, motion) for h, t in pairs for motion in t.whole_motions(h)]
    costs, best_motion = _costs(job, [motion for _, motion in motions]), {}
    for (h, motion), cost in zip(motions, costs, strict=True):
        if h not in best_motion or cost < best_motion[h].objective:
            best_motion[h] = replace(motion, objective=cost)
    return distinct(job.shape, best_motion.values(), width, np.inf)


def likeliest_tumbles(job, tumbles) -> list[Tumble]:
    """Return the MAX_TUMBLES tumbles that explain best what was felt until they end."""
    if len(tumbles) <= MAX_TUMBLES:
        return tumbles
    motions = [Hypothesis(t.theta, t.x, np.inf, ()) for t in tumbles]
    order = np.argsort(_costs(job, motions), kind="stable")
    return [tumbles[i] for i in order[:MAX_TUMBLES]]


def _costs(job, motions) -> list[float]:
    """Return what was felt costs free hypotheses, and the priors [nats]."""
    every = Reductions(still=False, far=False, absent=True, planar=False)
    window = window_of_samples(job.data, job.scene, job.shape, job.precision, every)
    problem = replace(job, page=quasi_static).build(window)
    built = BuiltPage(problem, window, None)
    data = problem.data(quasi_static.LEVELS[0].parameters)
    names = problem.costs_of("likelihood", "prior")

    def cost(h):
        x = problem.pack(built.values_at(h))
        return sum(float(problem.value(name, x, data).sum()) for name in names)

    return [cost(h) for h in motions]


def _last_tip(job, h):
    """Return the sample at which the last action tips the object, and how, or None."""
    data = job.data
    rows = np.nonzero(data.action == data.action[-1])[0]
    touched = data.contact[rows]
    normals = data.normal[rows]
    tilt = np.array([side_tilt(normals[:, f]) for f in range(data.fingers)]).T
    tilt = np.where(touched & (np.abs(normals[..., 2]) < SIDE_NORMAL), tilt, -1.0)
    if tilt.max() < TIPPING_TILT + 3 * job.precision.normal:
        return 0, None
    pusher = int(np.argmax(tilt.max(axis=0)))
    k = np.nonzero(tilt[:, pusher] >= 0)[0]
    rising = np.maximum.accumulate(tilt[k, pusher])
    upright = k[rising < TIPPING_TILT]
    first = upright[-1] if len(upright) else k[0]
    start = int(rows[first])
    x = h.x[:, start]
    n_o = rotate_planar(-x[2], *normals[k[0], pusher, :2])
    axis = int(np.argmax(np.abs(n_o)))
    angle = np.interp(np.arange(len(rows)), np.r_[first, k[k > first]],
                      np.r_[0.0, rising[k > first]])  # fmt: skip
    done = k[-1] + 1
    size, left = h.theta[[axis, 2]], len(rows) - done
    angle[done:] = fall(
        size, angle[:done], left, job.scene.gravity, intervals(data)[-1]
    )
    return start, Tip(axis, float(np.sign(n_o[axis])), angle)
