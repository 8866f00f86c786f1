"""Whether a box was carried between two actions, by hand: tracks with such a motion.

Nothing is recorded between two actions; the prior of a motion there is a Cauchy density
(formulations/between_actions.py).  Tracks stay where they are.  Where an action costs
them more than to be carried would, it is tracked also from where its own first touch
may be, with the sizes of the tracks; if that explains it better, all actions are.  Soft
fingertips, which tracks take for rigid, cost as much as a body that was carried: the
action must be explained better by as much again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from formulations.between_actions import CAUCHY, GAP

from ..data.contact_segments import first_contact
from .initial_states import START_SIGMA, places_of
from .tracking import between_actions, tracks_after
from .tracks import KalmanFilter, Tracks

REACH = 0.05  # [m] a body that is carried is about so far from where it was
CARRIED = CAUCHY * np.log(1 + (REACH / GAP) ** 2)  # [nats] by the prior of the motion
FARTHEST_PLACE = 20.0  # [REACH] of a place without a touch
PLACES = 2  # of each track, one per naming of the horizontal sides


def was_carried(ekf: KalmanFilter, before: Tracks, after: Tracks, samples) -> bool:
    """Tell whether an action is explained better by a body that was carried.

    before, after: the tracks without and with the samples of the action.
    """
    if before.evidence.max() - after.evidence.max() < CARRIED:
        return False
    rng = np.random.default_rng(0)
    *begun, _ = with_carried(ekf, before, ekf.data.action[samples[0]], rng)
    either, _ = tracks_after(ekf, before, samples, rng, begun)
    return either.evidence.max() > after.evidence.max() + CARRIED


def with_carried(ekf: KalmanFilter, tracks: Tracks, action: int, rng):
    """Return tracks at the first sample of an action, slopes of the motion, parents.

    Tracks that stayed, then those that were carried to where the first touch of the
    action may be, or anywhere if nothing was touched; slopes (3, n + 3, S): minus one
    where the place is forgotten.
    """
    n, S = len(tracks.z) - 3, tracks.z.shape[1]
    rows = np.repeat(np.arange(S), PLACES)
    theta, carried = tracks.z[:n, rows], tracks.pick(rows)
    if ekf.felt[ekf.data.action == action].any():
        swapped = np.arange(len(rows)) % PLACES == 1  # the side y was touched
        a, b = (np.where(swapped, theta[i], theta[1 - i]) for i in (1, 0))
        pose = places_of(a, b, first_contact(ekf.data, [action]), rng)
        pose[2] -= np.where(swapped, np.pi / 2, 0.0)
    else:
        away = REACH * np.clip(
            rng.standard_cauchy((2, len(rows))), -FARTHEST_PLACE, FARTHEST_PLACE
        )
        turn = rng.uniform(-np.pi, np.pi, len(rows))
        pose = carried.z[n:] + np.vstack([away, turn])
    P = carried.P.copy()
    P[n:], P[:, n:] = 0.0, 0.0
    P[n:, n:] = np.diag(START_SIGMA[3:] ** 2)[..., None]
    carried = replace(
        carried, z=np.vstack([theta, pose]), P=P, evidence=carried.evidence - CARRIED
    )
    slopes = np.zeros((3, n + 3, S + len(rows)))
    slopes[:, n:, S:] = -np.eye(3)[..., None]
    pairs = zip(vars(tracks).values(), vars(carried).values(), strict=True)
    both = Tracks(*(np.concatenate(pair, axis=-1) for pair in pairs))
    return between_actions(both, rng), slopes, np.r_[np.arange(S), rows]
