"""Soft fingertips in a search: hypotheses of how deep they sit in a body.

A fingertip of compliance c [m per weight] that slides a body on a ground of friction
mu_g pushes with about mu_g weights, so that it sits D = c mu_g deep.  Up to there it
sinks in as far as it approaches, and it comes out as far as it retreats, while the body
rests (the play operator, Prandtl's model of a dry friction):

    d_k = min(max(d_{k-1} - n_k . (r_k - r_{k-1}), 0), D)

A rigid fingertip at r + d n would have felt the same: a search for rigid fingertips is
made of these positions, one for each c.  Which c is right the first actions tell: the
objective of the planes rises by tens of nats where it is off by a factor of two
(results/EXPERIMENTS.md).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from formulations.indentation import COMPLIANCE_SIGMA, told

from ..data.scene import typical_friction
from ..problem.fingertips import yields
from ..tracking.felt_pushes import HALF

SOFTNESS = 0.0, 0.5, 1.0, 2.0  # [-] compliances, in deviations of their prior


def compliances_of(job, known: float | None = None) -> dict[float, float]:
    """Return likely compliances [m per weight] of the fingertips, and their costs.

    Costs [nats] are of their prior; known: that of an earlier estimate, if any.  Zero
    alone for rigid fingertips, and for a body that no friction holds; beside others it
    competes, as a path that was lost may look like soft fingertips.
    """
    scene = job.scene
    if scene.ground is None or not yields(scene, job.reductions):
        return {0.0: 0.0}
    if scene.compliance is not None:
        return {told(scene): 0.0}
    if known is not None:
        return {known: 0.0}
    return {k * COMPLIANCE_SIGMA: k**2 / 2 for k in SOFTNESS}


def as_of_rigid_fingertips(job, compliance: float | None):
    """Return the job with its fingers where rigid ones would have felt the same.

    compliance [m per weight]: None or zero of rigid fingertips.
    """
    job = job.with_reductions(rigid=True)
    depth = (compliance or 0.0) * typical_friction(job.scene)[0]
    if depth == 0:
        return job
    data = job.data
    way = indentations(data, depth)[:, :, None] * data.normal
    return replace(job, data=replace(data, finger_position=data.finger_position + way))


def indentations(data, depth: float) -> np.ndarray:
    """Return how deep (T, F) [m] fingertips sit that slide the body at a depth [m].

    In an action that begins in contact, as deep as when they slide.
    """
    felt, action = data.contact & data.valid, data.action
    d, n, touched = np.zeros(felt.shape), data.normal[0], felt[0]
    for t in range(len(d)):
        n = np.where(felt[t, :, None], data.normal[t], n)
        if t == 0 or action[t] != action[t - 1]:
            d[t], touched = depth * felt[t], felt[t]
            continue
        way = data.finger_position[t - 1] - data.finger_position[t]
        approach = (way * n).sum(axis=1) * np.where(touched, 1.0, HALF)
        touched = np.where(data.valid[t], felt[t], touched)
        d[t] = touched * np.clip(d[t - 1] + approach, 0.0, depth)
    return d
