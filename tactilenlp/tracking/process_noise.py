"""Process noise of the search: how a body may move otherwise than its tracks predict.

The pose (x, y, yaw) of a track gets Gaussian noise of the variances

    (s (least + share way (1, 1, 1 / ARM)))^2 + ADDED_VARIANCE

where way = |(x, y)| + ARM |yaw| of a motion, and

                        least                share       motion
    fingers push        TOUCHED              PUSH_ERROR  the larger of the predicted
                                                         and LAST_SHARE of the last
    no finger touches   RELEASED             STOP_ERROR  of the last step
    between actions     GAP (1, 1, 1 / ARM)  0

A body that is pushed as an action ends stops, or goes one more step on as the last one,
each as likely as the other: half of that motion is its mean, and its deviation.  Each
track draws s anew, s^2 = nu / chi^2(nu): together such Gaussians are Student's t
of nu = STEP_FREEDOM, between actions GAP_FREEDOM, a Cauchy density.  Most steps are as
predicted, but a body may slip, or snap between two fingers.  A second search is less
sure of pushes (refinement/refinement.py): it has PROCESS_NOISE_FACTOR s in place of s
in steps.  GAP is that of formulations/between_actions.py: editing it changes the prior
of the pages as well.  Polytopes are not tracked: their paths are predicted with the
constants of search/predicted_motion.py, and formulations/quasi_static.py prices motion
other than predicted (UNPREDICTED).
"""

from __future__ import annotations

import numpy as np

from formulations.between_actions import GAP
from formulations.rigid_body import ARM

TURN_LENGTH = np.array([[1.0], [1.0], [1 / ARM]])  # [m, m, rad] of a way [m]
TOUCHED = np.array([[1e-4], [1e-4], [5e-3]])  # [m, m, rad] of a sample
RELEASED = np.array([[5e-5], [5e-5], [2e-3]])  # [m, m, rad] of a sample
PUSH_ERROR, STOP_ERROR = 0.10, 0.20  # [-] of a way
LAST_SHARE = 0.5  # [-] of the last way: the least that fingers are taken to push
GAP_POSE = GAP * TURN_LENGTH  # [m, m, rad] between actions
ADDED_VARIANCE = 1e-14  # [m^2, rad^2]
STEP_FREEDOM, GAP_FREEDOM = 3, 1  # degrees of freedom
LARGEST_SCALE = 100.0  # [-] of s: 50 mm between two actions
PROCESS_NOISE_FACTOR = 3.0  # [-] in a second search


def deviation(least, share, way):
    """Return the deviations [m, m, rad] of a pose whose motion has a way, of s = 1."""
    return least + share * way * TURN_LENGTH


def way_of(distance, turn):
    """Return the way [m] of motions by a distance |(x, y)| [m] and a turn [rad]."""
    return distance + ARM * abs(turn)


def drawn_scales(freedom: int, count: int, rng) -> np.ndarray:
    """Return a scale s (count,) of each track."""
    return np.minimum(np.sqrt(freedom / rng.chisquare(freedom, count)), LARGEST_SCALE)
