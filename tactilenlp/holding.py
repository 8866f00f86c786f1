"""Check that friction holds what shares a pose: the certificate of still spans.

Were a body at rest to move within a span that nothing touches, the objective would
fall by its pull, in nats per metre, and friction would dissipate more than that.  It is
rounded where a page is solved: poses of their own would creep, which no body does.  The
pull at a sample is the slope of the objective in the poses before it in its span: along
the ground, the weight holds the body down.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from formulations.violation_implicit import WEIGHTS

from .body_frame import planar
from .guess import body_corners
from .polytopes import is_polytope
from .reduce import SLIPPERY
from .rotations import turning

BY_METRE = 1e3  # [mm / m]: the page weighs friction in nats per mm
HARDLY = 0.5  # [-] what is pulled so hard may give way when another span is cut
LEAST = 1.0  # [nats / m] on ice a body at rest is pulled by nothing, up to rounding


@dataclass(frozen=True, eq=False)
class Hold:
    """How hard still spans are pulled: largest share of what friction holds [-].

    cuts: the samples of the hardest pull in each span that friction hardly holds, if it
    does not hold one of them.
    """

    share: float
    cuts: tuple[int, ...]


def held(scene, solved, whole) -> Hold:
    """Return how well friction holds the still spans of a solved page.

    whole: the problem with a pose for every sample, at the solution (Expansion).
    """
    v = whole.problem.variables["x"]
    slope = whole.whole_slope[v.span].reshape(v.columns, v.rows)
    slope = _along(whole.x[v.span].reshape(slope.shape).T, slope)[whole.window.pose]
    pose, arm = solved.window.pose, _arm(solved, whole.window)
    price, cuts, worst = _price(scene, solved.solution), [], 0.0
    for k in np.unique(pose):
        rows = np.nonzero(pose == k)[0]
        pull = np.cumsum(slope[rows[:-1]], axis=0)
        pull = np.hypot(np.linalg.norm(pull[:, :2], axis=1), pull[:, 2] / arm) / price
        worst = max(worst, pull.max(initial=0.0))
        if pull.max(initial=0.0) > HARDLY:
            cuts.append(int(rows[1 + np.argmax(pull)]))
    return Hold(float(worst), tuple(cuts) if worst > 1 else ())


def _along(x, slope) -> np.ndarray:
    """Return slopes (n, 3) along the ground: two ways and a turn, of all (n, u)."""
    if planar(x):
        return slope
    turn = np.linalg.solve(turning(x).transpose(0, 2, 1), slope[:, 3:, None])
    return np.c_[slope[:, :2], turn[:, 2]]


def _arm(solved, window) -> float:
    """Return the arm [m] at which the ground's friction resists a turn."""
    if is_polytope(solved.job.shape):
        legs = window.start[window.legs] - window.body[1:4]
    else:
        legs = body_corners(solved.job.shape, solved.at.theta)
    return float(np.linalg.norm(legs[:, :2], axis=1).mean())


def _price(scene, solution) -> float:
    """Return what friction takes of a body that slides [nats / m].

    The price is that of the physics (violation_implicit) whatever page was solved, also
    one that weighs no dissipation; only its own `kappa` and coefficient come first.
    """
    known = {"kappa": WEIGHTS["kappa"][0], "ground friction": scene.friction_ground}
    if known["ground friction"] is None:
        known["ground friction"] = SLIPPERY
    known |= solution.parameters | solution.values
    kappa, mu = (float(np.ravel(known[k])[0]) for k in ("kappa", "ground friction"))
    return max(BY_METRE * kappa * mu * (scene.gravity > 0), LEAST)
