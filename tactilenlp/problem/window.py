"""Define the window, the data as a page reads them: plain arrays and index lists.

Every list may be empty; a term over an empty list costs nothing.  `pose` indexes the
pose unknowns x: all samples of a still span share one.  What pages call the world w is
the frame g of the ground (data/ground.py), in which the ground is z = 0; without a
ground, the world.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from formulations.finger import Finger
from formulations.rigid_body import Motion
from formulations.shape import Shape

from .poses import body_corners


class Rows:
    """Arrays that share their first axis, an instance of a term each."""

    def __len__(self) -> int:
        return len(next(iter(vars(self).values())))

    def pick(self, rows):
        """Return the chosen instances."""
        return type(self)(**{name: a[rows] for name, a in vars(self).items()})

    def since(self, sample: int) -> slice:
        """Return the place of instances, in the order of time, from a sample on."""
        return slice(int((self.sample < sample).sum()), None)


@dataclass(frozen=True, eq=False)
class Samples(Rows):
    """Finger samples: index of the pose, where the finger is, p_wf (as in
    formulations/finger.py: (3,) [m] for a sphere), its radius [m], normal, and late_gap
    [m]: the gap that there may be where a contact is felt late.
    """

    sample: np.ndarray
    finger: np.ndarray
    pose: np.ndarray
    p_wf: np.ndarray
    radius: np.ndarray
    normal: np.ndarray
    late_gap: np.ndarray


@dataclass(frozen=True, eq=False)
class Steps(Rows):
    """Time steps of dt [s]: index of the pose, and of one and two samples before.

    dt_1 [s]: of the step before, dt where there is none, or times are even;
    motion (3,) [m, m, rad]: how the body is predicted to move; zeros: not at all.
    """

    sample: np.ndarray
    pose: np.ndarray
    before: np.ndarray
    before_2: np.ndarray
    dt: np.ndarray
    dt_1: np.ndarray
    motion: np.ndarray


@dataclass(frozen=True, eq=False)
class Pushes(Rows):
    """Finger contacts that may carry an impulse, each within one step.

    p_wf_1: finger position at `before`, the previous sample (repeated ones are
    skipped); tangent (3,): direction of t1.
    """

    sample: np.ndarray
    finger: np.ndarray
    step: np.ndarray
    before: np.ndarray
    p_wf: np.ndarray
    p_wf_1: np.ndarray
    radius: np.ndarray
    tangent: np.ndarray

    def where(self, chosen) -> np.ndarray:
        """Return the rows whose samples are chosen (T, F)."""
        return np.nonzero(chosen[self.sample, self.finger])[0]


@dataclass(frozen=True, eq=False)
class Corners(Rows):
    """Ground contacts, each at one corner of the shape within one step."""

    step: np.ndarray
    signs: np.ndarray


@dataclass(frozen=True, eq=False)
class Rests(Rows):
    """Corners on which the object rests while nothing pushes it, one pose each."""

    pose: np.ndarray
    signs: np.ndarray


@dataclass(frozen=True, eq=False)
class Group:
    """Steps in which equally many fingers push: (n,), (n, fingers), (n, corners)."""

    steps: np.ndarray
    pushes: np.ndarray
    corners: np.ndarray


@dataclass(frozen=True, eq=False)
class Window:
    """The measurements as a page reads them.

    shape: the class, of a hull with the vertices that it starts with and stands on;
    unfelt: the pushes of fingers that feel nothing (rows of push);
    unseen: those of fingers whose samples are missing (rows of push);
    lift: the ground contacts that can leave the ground (none in planar motion);
    rest: corners on the ground at poses without a step (none in planar motion);
    frictionless: "finger", "ground" where these carry no tangential impulse;
    sigma_position [m], sigma_normal [rad]: sensor noise; normal_error: relative
    standard deviation of the latter, where it was estimated; sigma_edge [rad]: noise of
    a normal at an edge by that of smoothed positions;
    outlier_cost: the most that one wrong sample can cost [nats];
    braking [m/s^2]: of an object that slides on, mu g;
    compliant: whether fingertips yield under load; central: whether the centre of mass
    is the centroid; aligned: whether the normals of a finger are not turned;
    lower, upper: bounds of the poses x (unknowns, poses), equal where one is held.
    """

    shape: Shape
    motion: Motion
    finger: Finger
    fingers: int
    poses: int
    pose: np.ndarray
    touch: Samples
    free: Samples
    step: Steps
    gap: Steps
    push: Pushes
    unfelt: np.ndarray
    unseen: np.ndarray
    corner: Corners
    lift: Corners
    rest: Rests
    frictionless: tuple[str, ...]
    sigma_position: float
    sigma_normal: float
    outlier_cost: float
    braking: float
    normal_error: float = 0.0
    sigma_edge: float = 0.0
    compliant: bool = False
    central: bool = True
    aligned: bool = True
    lower: np.ndarray | float = -np.inf
    upper: np.ndarray | float = np.inf

    @property
    def groups(self) -> dict[int, Group]:
        """The steps by number of pushing fingers."""
        steps, groups = len(self.step), {}
        members = [np.nonzero(self.push.step == i)[0] for i in range(steps)]
        count = np.array([len(m) for m in members], int)
        corners = np.arange(len(self.corner)).reshape(max(1, steps), -1)
        for n in np.unique(count).tolist():
            chosen = np.nonzero(count == n)[0]
            pushes = np.array([members[i] for i in chosen], int).reshape(len(chosen), n)
            groups[n] = Group(chosen, pushes, corners[chosen])
        return groups

    def pushes_of(self, sample, finger) -> np.ndarray:
        """Return the row of push of each finger at a sample (n,), -1: it has none."""
        row = np.full((len(self.pose), self.fingers), -1)
        row[self.push.sample, self.push.finger] = np.arange(len(self.push))
        return row[sample, finger]

    @property
    def push_of_touch(self) -> tuple[np.ndarray, np.ndarray]:
        """The row of push of every touch (touches,), and 1 where there is one, else 0.

        A touch that ends no time step has no impulse: its row is 0.
        """
        row = self.pushes_of(self.touch.sample, self.touch.finger)
        return np.maximum(row, 0), (row >= 0).astype(float)

    @property
    def lasting(self) -> tuple[np.ndarray, np.ndarray]:
        """Pushes (n,) that may last since the sample before, and these (rows of push).

        One of the two samples is missing; in neither the finger feels nothing.
        """
        now = np.arange(len(self.push))
        before = self.pushes_of(self.push.sample - 1, self.push.finger)
        pairs = np.stack([now, before])[:, before >= 0]
        missing = np.isin(pairs, self.unseen).any(axis=0)
        return tuple(pairs[:, missing & ~np.isin(pairs, self.unfelt).any(axis=0)])

    @property
    def unseen_steps(self) -> np.ndarray:
        """The steps in which a finger that may push is not seen (rows of step)."""
        return np.unique(self.push.step[self.unseen])

    @property
    def unseen_runs(self) -> list[tuple[np.ndarray, int]]:
        """Runs of unseen steps, each with the step before (rows of step).

        Without those with which an action begins.
        """
        row, before, runs = np.full(self.poses, -1), {}, {}
        row[self.step.pose] = np.arange(len(self.step))
        for k in self.unseen_steps.tolist():
            earlier = int(row[self.step.before[k]])
            before[k] = before.get(earlier, earlier)
            runs.setdefault(before[k], []).append(k)
        return [(np.array(rows), k) for k, rows in runs.items() if k >= 0]

    @property
    def last(self) -> np.ndarray:
        """The last sample of every pose (poses,)."""
        return np.r_[np.nonzero(np.diff(self.pose))[0], len(self.pose) - 1]

    def let_go(self, x) -> np.ndarray:
        """Return how far (unknowns, poses) a body moved that was let go in motion.

        At poses x after the last touch of an action, up to the next touch: what it has
        moved since, and before that in a time step, the longer one of the last two.
        """
        out, touched, end = np.zeros_like(x), self.touch.sample, len(self.pose)
        at, ways = self.step.sample, x[:, self.step.pose] - x[:, self.step.before]
        for begin in (*self.gap.sample, end):  # of the next action
            last = touched[touched < begin].max(initial=-1)
            until = touched[touched >= begin].min(initial=end)
            pushed = ways[:, (last - 2 < at) & (at <= last)].T
            if len(pushed):
                way = max(pushed, key=lambda k: np.linalg.norm(k / self.motion.scale))
                way = way + ways[:, (last < at) & (at < until)].sum(axis=1)
                to = self.pose[until] if until < end else x.shape[1]
                out[:, self.pose[last] + 1 : to] = way[:, None]
        return out

    def of_later_steps(self, samples: int) -> dict:
        """Return the fields of the window that are of steps after so many samples.

        The steps, the gaps between actions, and the pushes within the steps.
        """
        step, push = self.step.since(samples), self.push.since(samples)
        pushes = self.push.pick(push)
        return {
            "step": self.step.pick(step), "gap": self.gap.pick(self.gap.since(samples)),
            "push": replace(pushes, step=pushes.step - step.start),
            "unfelt": self.unfelt[self.unfelt >= push.start] - push.start,
            "unseen": self.unseen[self.unseen >= push.start] - push.start,
        }  # fmt: skip

    def holding(self, x, poses) -> Window:
        """Return the window whose bounds hold some poses of x (unknowns, T)."""
        lower, upper = np.full((2, len(x), self.poses), [[[-np.inf]], [[np.inf]]])
        lower[:, poses] = upper[:, poses] = x[:, self.last[poses]]
        return replace(self, lower=lower, upper=upper)

    def with_fingers(self, change: Callable) -> Window:
        """Return the window with every finger at change(rows, p_wf), not at p_wf.

        rows: the Samples or Pushes of which p_wf (n, numbers) are the places.
        """

        def changed(rows, *names):
            return replace(rows, **{n: change(rows, getattr(rows, n)) for n in names})

        return replace(
            self, touch=changed(self.touch, "p_wf"), free=changed(self.free, "p_wf"),
            push=changed(self.push, "p_wf", "p_wf_1"),
        )  # fmt: skip

    def rigid_moves(self, rows, slopes) -> np.ndarray:
        """Return what moves of corners that can lift (corners, k) do to a rigid body.

        rows (corners, k): what a move of each alone does; slopes: of the corners'
        heights in all poses (corners, unknowns), sparse.  Corners of a shape of few
        sizes always lie as a body has them.
        """
        return rows

    def supports(self, theta) -> np.ndarray:
        """Return the corners (n, 3) [m] that carry a body theta, from its middle."""
        return body_corners(self.shape, theta)

    def seen_by_touches(self, theta) -> np.ndarray:
        """Return what each touch reads (n, touches) of a body theta (rows, columns)."""
        return np.repeat(theta.T.reshape(-1, 1), len(self.touch), axis=1)
