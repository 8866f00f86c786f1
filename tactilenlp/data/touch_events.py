"""Events of touch: onsets, releases, and pairs of touches of a body at rest.

The check for mistakes in a recording reads them (mistakes.py).  A single sample makes
no event: it may be a flipped boolean.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import permutations

import numpy as np

LASTING = 2  # samples on each side of an event
MEAN_OF = 3  # samples that are averaged at each end of a displacement


@dataclass(frozen=True, eq=False)
class Record:
    """Measurements as the check for mistakes takes them: arrays that it transforms.

    position (T, F, 3) [m]; felt, valid (T, F); normal (T, F, 3), zero without contact
    or where unknown; radius (F,) [m]; action (T,) and time (T,) [s]; sigma_position
    [m], sigma_normal [rad]: noise; up (3,), level [m]: the ground; slack [m]: by which
    a contact point may lie elsewhere (length of a capsule, offset of a finger).
    """

    position: np.ndarray
    felt: np.ndarray
    valid: np.ndarray
    normal: np.ndarray
    radius: np.ndarray
    action: np.ndarray
    time: np.ndarray
    sigma_position: float
    sigma_normal: float
    up: np.ndarray
    level: float = 0.0
    slack: float = 0.0

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """The first and the last sample (T,) of the action of each sample."""
        last = np.searchsorted(self.action, self.action, side="right") - 1
        return np.searchsorted(self.action, self.action), last

    def with_same_touches(self, **changes) -> Record:
        """Return the record with changes that leave its events as they are."""
        changed = replace(self, **changes)
        vars(changed)["events"] = self.events
        return changed

    @cached_property
    def events(self) -> Events:
        """The events of this record."""
        felt, valid, action = self.felt, self.valid, self.action
        free = valid & ~felt

        def at(mask, step):
            """Return the mask so many samples later, False in another action."""
            later = np.zeros_like(mask)
            same = (action[abs(step) :] == action[: -abs(step)])[:, None]
            if step > 0:
                later[:-step] = mask[step:] & same
            else:
                later[-step:] = mask[:step] & same
            return later

        onset = felt & at(felt, 1) & at(free, -1) & at(free, -2)
        release = free & at(free, 1) & at(felt, -1) & at(felt, -2)
        first = np.diff(action, prepend=action[0] - 1) != 0
        begun = int((felt & at(felt, 1) & first[:, None]).sum())
        pairs, before = _between_actions(felt, valid, onset, np.flatnonzero(first))
        pairs = np.vstack([_at_once(felt, action), *pairs]).T
        before = np.vstack([np.zeros((0, 4), int), *before]).T
        samples_and_fingers = tuple(pairs[:4].astype(int))
        return Events(
            np.nonzero(onset), np.nonzero(release), begun,
            (*samples_and_fingers, pairs[4]), tuple(before),
        )  # fmt: skip

    def place(self, t, f, steps: int) -> np.ndarray:
        """Return where finger f is so many samples after t, within the action."""
        first, last = self.bounds
        return self.position[np.clip(t + steps, first[t], last[t]), f]

    def way_before(self, t, f, steps: int) -> tuple[np.ndarray, float]:
        """Return how far (N,) [m] fingers f move in so many samples, and its sigma.

        Between means of a few samples, which noise moves less.
        """
        around = np.arange(MEAN_OF) - MEAN_OF // 2
        now = sum(self.place(t, f, k) for k in around)
        before = sum(self.place(t, f, k - steps) for k in around)
        way = np.linalg.norm(now - before, axis=1) / MEAN_OF
        return way, self.sigma_position * np.sqrt(2 / MEAN_OF)

    def usual_way(self, steps: int) -> float:
        """Return how far fingers move in so many samples: the root mean square [m]."""
        before = self.place(np.arange(len(self.position)), slice(None), -steps)
        return float(np.sqrt(((self.position - before) ** 2).sum(axis=2).mean()))

    def contact_point(self, t, f) -> np.ndarray:
        """Return the point of the body that finger f touches at sample t."""
        return self.position[t, f] - self.radius[f, None] * self.normal[t, f]


@dataclass(frozen=True)
class Events:
    """Where fingers began and ceased to touch, and which touches can be compared.

    onset, release: (samples, fingers); begun: how many actions a finger began in
    contact; pairs: (t, f, u, g, weight), finger f at sample t and g at u touched the
    body in the same place; before: (t, f, u, g), f was free at t while the body lay
    where g touched it at u.
    """

    onset: tuple
    release: tuple
    begun: int
    pairs: tuple
    before: tuple


def _at_once(felt, action) -> np.ndarray:
    """Return pairs (N, 5) of fingers that touch at the same samples; a run weighs 1."""
    pairs = [np.zeros((0, 5))]
    for f, g in permutations(range(felt.shape[1]), 2):
        both = np.flatnonzero(felt[:, f] & felt[:, g])
        if len(both):
            breaks = np.diff(both, prepend=-2) > 1
            breaks |= np.diff(action[both], prepend=action[0] - 1) > 0
            run = np.cumsum(breaks) - 1
            weight = 1 / np.bincount(run)[run]
            one = np.ones(len(both))
            pairs.append(np.stack([both, f * one, both, g * one, weight], axis=1))
    return np.concatenate(pairs)


def _between_actions(felt, valid, onset, starts) -> tuple[list, list]:
    """Return what can be compared since the body rests between two actions.

    Pairs (N, 5) of the last touches of an action and the first of the next, and the
    free samples (N, 4) up to the latter.
    """
    fingers, pairs, before = range(felt.shape[1]), [], []
    stops = np.r_[starts, len(felt)]
    for begin, here, end in zip(stops[:-2], stops[1:-1], stops[2:], strict=True):
        lasting = felt[max(begin, here - LASTING) : here].all(axis=0)
        touched = np.flatnonzero(felt[here:end].any(axis=1))
        if not lasting.any() or not len(touched):
            continue
        first = here + touched[0]
        for g in np.flatnonzero(lasting):
            for f in np.flatnonzero(onset[first]):
                there, back = (first, f), (here - 1, g)
                pairs.append(np.array([[*there, *back, 1], [*back, *there, 1]]))
            for f in fingers:
                t = here + np.flatnonzero(valid[here:first, f])
                one = np.ones(len(t), int)
                rows = [t, f * one, (here - 1) * one, g * one]
                before.append(np.stack(rows, axis=1))
    return pairs, before
