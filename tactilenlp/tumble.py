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

from .guess import BELOW, carried
from .reduce import SIDE
from .search import Hypothesis, beam, extensions

TOUCH, NORMAL = 0.15e-3, 0.015  # [m], [rad] model errors of a touch of a rigid object
WRONG = 0.8  # [ceilings] a touch that costs more is not explained
TWO, SHARE = 2, 0.2  # so many touches, and this part of an action's, are no accident
TILTED = np.radians(2)  # a side normal that rises further says that the object tilts
ENOUGH = 1.05  # [-] of the speed that just carries the object over its edge
DEPTHS = (1.0, 2 / 3)  # [-] of the guessed depth: where the edge lies is not known yet
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
        over = -self.side * FLAT * np.cross([0, 0, 1.0], np.eye(3)[self.axis])
        return Rotation.from_rotvec(over).as_matrix().round()

    @property
    def landed(self) -> int:
        """Return the first sample of the action at which it lies, or their number."""
        return int(np.count_nonzero(self.angle < FLAT))

    def poses(self, theta, x) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (n + 1, 3), rotations (n + 1, 3, 3) from x (3,); it lies last."""
        R_wo = Rotation.from_euler("z", x[2]).as_matrix()
        fall = -self.side * R_wo[:, self.axis]
        p_wo = np.r_[x[:2], theta[2] / 2]
        edge = np.r_[(p_wo + fall * theta[self.axis] / 2)[:2], 0.0]
        over = np.outer([*self.angle, FLAT], np.cross([0, 0, 1.0], fall))
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

    def lying(self) -> Hypothesis:
        """Return the planar hypothesis of the fallen object, at rest for the action."""
        S, n = self.tip.renamed, len(self.tip.angle)
        p, R = self.tip.poses(self.theta, self.before.x[:, self.start])
        ahead = (R[-1] @ S.T)[:2, 0]
        x = np.r_[p[-1, :2], np.arctan2(ahead[1], ahead[0])]
        path = (*self.before.path, self.name)
        x = np.repeat(x[:, None], n, axis=1)
        return Hypothesis(np.abs(S) @ self.theta, x, np.inf, path)

    def joined(self, later: Hypothesis) -> Hypothesis:
        """Return the whole motion, free: tumbled so as to lie where `later` begins.

        later: planar poses of the renamed object from the action of the tumble on.  How
        tall the object stood, and where the pushed side was, is known from before.
        """
        S, n, k = self.tip.renamed, len(self.tip.angle), self.start + 1
        theta = np.abs(S).T @ later.theta
        theta[2] = max(theta[2], self.theta[2])
        stood, landed = self.before.x[:, self.start], later.x[:, n - 1]
        x = self._upright(theta, stood, landed)
        past = lifted(theta, carried(self.before.x[:, :k], stood, x))
        p, R = self.tip.poses(theta, x)
        off = R[-1].T @ (p[-1] - [*landed[:2], p[-1, 2]])
        after = lifted(np.abs(S) @ theta, later.x[:, n:])
        R_after = _matrices(after) @ S
        tail = slice(n - (self.x.shape[1] - k), n)
        R = np.concatenate([_matrices(past), R[tail], R_after])
        p = np.vstack([past[:3].T, p[tail], after[:3].T + R_after @ off])
        return replace(later, theta=theta, x=np.hstack([p, continuous(R)]).T)

    def _upright(self, theta, stood, landed):
        """Return the planar pose (3,) from which it tips to lie at `landed`.

        Along the fall the pushed side stays where it `stood`; across, it may slide.
        """
        S, tip = self.tip.renamed, self.tip
        p, R = tip.poses(theta, np.zeros(3))
        ahead = (R[-1] @ S.T)[:2, 0]
        yaw = landed[2] - np.arctan2(ahead[1], ahead[0])
        out = tip.side * Rotation.from_euler("z", yaw).as_matrix()[:2, tip.axis]
        x = np.r_[0, 0, yaw]
        x[:2] = landed[:2] - tip.poses(theta, x)[0][-1, :2]
        grown = (theta - self.theta)[tip.axis] / 2
        x[:2] += out * (out @ (stood[:2] - x[:2]) - grown)
        return x

def tumbled(job, kept) -> list[Tumble]:
    """Return guesses of how the object tumbled in the last action of a job.

    kept: planar hypotheses of the actions before, none if it is the first.
    """
    out = []
    for h in extensions(job, kept):
        h = _raised(job, h)
        start, tip = _tipped(job, h)
        for share in DEPTHS if tip is not None else ():
            thin, name = _thinned(h, tip, share), f"tips {len(out)}"
            p, R = tip.poses(thin.theta, thin.x[:, start])
            flat = lifted(thin.theta, thin.x[:, : start + 1])
            fallen = np.hstack([p, continuous(R)])[:-1][start + 1 - h.x.shape[1] :]
            x = np.hstack([flat, fallen.T])
            out.append(Tumble(thin.theta, x, name, thin, start, tip))
    return out


def _raised(job, h: Hypothesis) -> Hypothesis:
    """Return the hypothesis tall enough for the sides that were touched."""
    data = job.data
    touched = data.contact & data.valid & (np.abs(data.normal[..., 2]) < SIDE)
    touched &= (data.action == data.action[-1])[:, None]
    theta = h.theta.copy()
    highest = data.finger_position[touched][:, 2].max(initial=-np.inf)
    theta[2] = max(theta[2], highest + BELOW)
    return replace(h, theta=theta)


def _thinned(h: Hypothesis, tip: Tip, share: float) -> Hypothesis:
    """Return the hypothesis with less depth behind the pushed side, which stays."""
    theta = h.theta.copy()
    theta[tip.axis] *= share
    yaw, moved = h.x[2], tip.side * (h.theta - theta)[tip.axis] / 2
    out = np.array([np.cos(yaw), np.sin(yaw)])
    if tip.axis == 1:
        out = np.array([-out[1], out[0]])
    return replace(h, theta=theta, x=np.vstack([h.x[:2] + moved * out, yaw]))


def continued(job, tumbles, width: int, solves: int, executor=None) -> list[Hypothesis]:
    """Return free hypotheses of all actions of a job: a tumble, then sliding, best first.

    job: the data from the first action on; tumbles: of one action of it.  The planar
    beam searches what comes after; its objective is of that part only.
    """
    action = job.data.action[tumbles[0].x.shape[1] - 1]
    data = job.data.select([a for a in np.unique(job.data.action) if a >= action])
    valid = data.valid.copy()
    valid[: max(t.tip.landed for t in tumbles)] = False
    part = replace(job, data=replace(data, valid=valid))
    lying = [t.lying() for t in tumbles]
    origin = {h.path: t for h, t in zip(lying, tumbles, strict=True)}
    later = beam(part, lying, width, solves, executor)
    length = len(lying[0].path)
    return [origin[h.path[:length]].joined(h) for h in later]


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
    takes to get over.
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
