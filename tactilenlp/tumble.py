"""Tell when an object did not only slide, and guess how it tipped over.

An object that is pushed high tips over its far bottom edge: the measured normal of the
pushed side rises with the tilt, then the object falls like a pendulum and comes to lie
on the next face.  Lying, it slides again: a turn by 90 degrees renames the sides.  So a
tumble is guessed from the normals, what follows is searched by the planar beam, and both
together start one local solve in free motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from .guess import carried
from .reduce import SIDE
from .search import Hypothesis, beam, extensions

TOUCH, NORMAL = 0.15e-3, 0.015  # [m], [rad] model errors of a touch of a rigid object
WRONG = 0.8  # [ceilings] a touch that costs more is not explained
TWO, SHARE = 2, 0.2  # so many touches, and this part of an action's, are no accident
TILTED = np.radians(2)  # a side normal that rises further says that the object tilts
ENOUGH = 1.05  # [-] of the speed that just carries the object over its edge
FALL = 20  # steps of the falling pendulum in one sample
FLAT = np.pi / 2


@dataclass(frozen=True)
class Evidence:
    """What speaks against sliding in one action.

    touches: how many; unexplained: how many of them no flat pose explains; tilt [rad]:
    how far the normals of a side rise.
    """

    action: int
    touches: int
    unexplained: int
    tilt: float

    @property
    def against(self) -> bool:
        """Whether the object did something else than slide."""
        return self.unexplained >= TWO and self.unexplained > SHARE * self.touches


def contradicts(job, window, problem, values) -> list[Evidence]:
    """Return the evidence against flat motion in every action that touched.

    problem: any page with the terms of `quasi_static.sense`; values: a flat solution.
    """
    scale = {
        "touch scale": np.hypot(TOUCH, window.sigma_position),
        "normal scale": np.hypot(NORMAL, window.sigma_normal),
    }
    cost = problem.value("touch", problem.pack(values), problem.data(scale))[:, 0]
    wrong = cost > WRONG * window.ceiling
    action = job.data.action[window.touch.sample]
    return [
        Evidence(
            int(a), int((action == a).sum()), int(wrong[action == a].sum()),
            _tilt(window.touch.normal[action == a]).max(initial=0.0),
        )
        for a in np.unique(action)
    ]  # fmt: skip


def _tilt(n) -> np.ndarray:
    """Return how far side normals (n, 3) rise [rad]; 0 for those of other faces."""
    side = np.abs(n[:, 2]) < SIDE
    return np.where(side, np.arctan2(n[:, 2], np.hypot(n[:, 0], n[:, 1])), 0.0)


def lifted(theta, x) -> np.ndarray:
    """Return planar poses x (3, T) of a cuboid lying flat as free poses (6, T)."""
    o = np.zeros(x.shape[1])
    return np.vstack([x[:2], o + theta[2] / 2, o, o, x[2]])


@dataclass(frozen=True, eq=False)
class Tip:
    """A cuboid that tips about a bottom edge, from planar pose `x` (3,).

    It falls towards -side of its horizontal `axis`; angle (n,) [rad] at the samples
    of the action, 0 before it tips.
    """

    axis: int
    side: float
    angle: np.ndarray

    @property
    def renamed(self) -> np.ndarray:
        """Return S (3, 3): q_lying = S q_o once it has turned by 90 degrees."""
        turn = -self.side * self.angle[-1].round(9)
        over = turn * np.cross([0, 0, 1.0], np.eye(3)[self.axis])
        return Rotation.from_rotvec(over).as_matrix()

    def poses(self, theta, x) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (n, 3) and rotations (n, 3, 3) while it tips, from x (3,)."""
        R_wo = Rotation.from_euler("z", x[2]).as_matrix()
        fall = -self.side * R_wo[:, self.axis]
        p_wo = np.r_[x[:2], theta[2] / 2]
        edge = np.r_[(p_wo + fall * theta[self.axis] / 2)[:2], 0.0]
        over = np.outer(self.angle, np.cross([0, 0, 1.0], fall))
        R = Rotation.from_rotvec(over).as_matrix()
        return edge + R @ (p_wo - edge), R @ R_wo


@dataclass(frozen=True, eq=False)
class Tumble:
    """A guess of how the last action of a job went on: theta (3,), x (6, T), name.

    before: the planar hypothesis until it tipped; start: the sample since when it does.
    """

    theta: np.ndarray
    x: np.ndarray
    name: str
    before: Hypothesis
    start: int
    tip: Tip

    def lying(self, samples: int) -> Hypothesis:
        """Return the planar hypothesis of the fallen object, at rest for `samples`."""
        S = self.tip.renamed
        R = Rotation.from_rotvec(self.x[3:, -1]).as_matrix() @ S.T
        x = np.r_[self.x[:2, -1], np.arctan2(R[1, 0], R[0, 0])]
        path = (*self.before.path, self.name)
        theta = np.abs(S).round() @ self.theta
        return Hypothesis(theta, np.repeat(x[:, None], samples, axis=1), np.inf, path)

    def joined(self, later: Hypothesis) -> Hypothesis:
        """Return the whole motion, free: tumbled so as to lie where `later` begins.

        later: planar poses of the renamed object from the action of the tumble on.
        """
        S, n = self.tip.renamed, len(self.tip.angle)
        theta = np.abs(S).round().T @ later.theta
        landed = later.x[:, n - 1]
        x = self.before.x[:, self.start]
        p, R = self.tip.poses(theta, np.r_[0, 0, x[2]])
        yaw = (R[-1] @ S.T)[:2, 0]
        turn = landed[2] - np.arctan2(yaw[1], yaw[0])
        x = np.r_[0, 0, x[2] + turn]
        x[:2] = landed[:2] - self.tip.poses(theta, x)[0][-1, :2]
        past = carried(self.before.x[:, : self.start + 1], self.before.x[:, self.start], x)
        after = lifted(later.theta, later.x[:, n:])
        p_wo, R_wo = self.tip.poses(theta, x)
        flat = lifted(theta, past)
        R = [*_matrices(flat), *R_wo[-(n - self._done) :], *(_matrices(after) @ S)]
        p = np.vstack([flat[:3].T, p_wo[-(n - self._done) :], after[:3].T])
        return replace(later, theta=theta, x=np.vstack([p.T, continuous(R).T]))

    @property
    def _done(self) -> int:
        """Return how many samples of the last action have passed when it tips."""
        return len(self.tip.angle) - (self.x.shape[1] - self.start - 1)


def tumbled(job, kept) -> list[Tumble]:
    """Return guesses of how the object tumbled in the last action of a job.

    kept: planar hypotheses of the actions before, none if it is the first.
    """
    out = []
    for h in extensions(job, kept):
        start, tip = _tipped(job, h)
        if tip is None:
            continue
        p, R = tip.poses(h.theta, h.x[:, start])
        flat = lifted(h.theta, h.x[:, : start + 1])
        rest = h.x.shape[1] - start - 1
        x = np.hstack([flat, np.hstack([p, continuous(R)])[len(p) - rest :].T])
        out.append(Tumble(h.theta, x, f"tips {tip.axis}{tip.side:+.0f}", h, start, tip))
    return out


def continued(job, tumble: Tumble, width: int, solves: int, executor=None):
    """Return free hypotheses of all actions of a job, tumbling as guessed, then sliding.

    job: the data from the first action on; the planar beam searches what comes after.
    """
    done = tumble.x.shape[1]
    action = job.data.action[done - 1]
    data = job.data.select([a for a in np.unique(job.data.action) if a >= action])
    fallen = len(tumble.tip.angle)
    valid = data.valid.copy()
    valid[: fallen - 1] = False
    part = replace(job, data=replace(data, valid=valid))
    later = beam(part, [tumble.lying(fallen)], width, solves, executor)
    return [tumble.joined(h) for h in later]


def _tipped(job, h):
    """Return since which sample the last action tips the object, and how, or None."""
    data = job.data
    rows = np.nonzero(data.action == data.action[-1])[0]
    touched = (data.contact & data.valid)[rows]
    normals = data.normal[rows]
    tilt = np.array([_tilt(normals[:, f]) for f in range(data.fingers)]).T
    tilt = np.where(touched & (np.abs(normals[..., 2]) < SIDE), tilt, -1.0)
    if tilt.max() < TILTED + 2 * job.precision.normal:
        return 0, None
    pusher = int(np.argmax(tilt.max(axis=0)))
    k = np.nonzero(tilt[:, pusher] >= 0)[0]
    rising = np.maximum.accumulate(tilt[k, pusher])
    upright = k[rising < TILTED]
    first = upright[-1] if len(upright) else k[0]
    start = int(rows[first])
    x = h.x[:, start]
    c, s = np.cos(x[2]), np.sin(x[2])
    n = normals[k[0], pusher]
    n_o = [c * n[0] + s * n[1], c * n[1] - s * n[0]]
    axis = int(np.argmax(np.abs(n_o)))
    angle = np.interp(np.arange(len(rows)), np.r_[first, k[k > first]],
                      np.r_[0.0, rising[k > first]])  # fmt: skip
    falling = _fall(job, h.theta[[axis, 2]], angle[: k[-1] + 1], len(rows) - k[-1] - 1)
    angle[k[-1] + 1 :] = falling
    return start, Tip(axis, float(np.sign(n_o[axis])), angle)


def _fall(job, size, angle, samples) -> np.ndarray:
    """Return the angles (samples,) [rad] of a box that tips over its edge and lands.

    size: depth and height [m]; angle: so far, one a sample.  At least as fast as it
    takes to get over; what has not landed by the end of the action lands then.
    """
    depth, height = size
    gravity, dt = job.scene.gravity, job.data.dt
    over = np.arctan2(depth, height)
    pull = 1.5 * gravity / np.hypot(depth, height)  # m g r / I about the edge
    now = angle[-1]
    speed = (angle[-1] - angle[-2]) / dt if len(angle) > 1 else 0.0
    if now < over:
        least = np.sqrt(2 * pull * (1 - np.cos(over - now)))
        speed = max(speed, ENOUGH * least)
    out = []
    for _ in range(samples):
        for _ in range(FALL):
            speed += pull * np.sin(now - over) * dt / FALL
            now = min(now + speed * dt / FALL, FLAT)
        out.append(now)
    out[-1:] = [FLAT] * len(out[-1:])
    return np.array(out)


def continuous(R) -> np.ndarray:
    """Return rotation vectors (n, 3) [rad] of rotations (n, 3, 3) without jumps."""
    w = Rotation.from_matrix(np.array(R)).as_rotvec()
    for k in range(1, len(w)):
        angle = np.linalg.norm(w[k])
        if angle > 1e-6:
            turns = [w[k] * (1 + 2 * np.pi * j / angle) for j in (-1, 0, 1)]
            w[k] = min(turns, key=lambda v, k=k: np.linalg.norm(v - w[k - 1]))
    return w


def _matrices(x) -> np.ndarray:
    """Return the rotations (T, 3, 3) of free poses x (6, T)."""
    return Rotation.from_rotvec(x[3:].T).as_matrix()
