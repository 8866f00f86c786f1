"""How far off an estimate may be where what it weighs together disagrees.

At an optimum the gradients of all terms add up to nothing: those of the touches of one
finger in one action, and the forces that physics puts on the poses of one action, are
balanced by all the rest.  Each of these groups g errs as a whole: a wrong pose moves
all of its touches, a wrong coefficient of friction all of its impulses.  Hence

    K^{-1} ( sum_g  s_g s_g' ) K^{-1},        s_g = sum of the gradients of the group,

the middle of a sandwich whose errors are shared within a group (cluster-robust, Liang
and Zeger 1986): small where all say the same, large where they pull at each other.

How far off an estimate may be where a finger slides: it may have stuck instead.

A finger that moves along a face slides on it or takes the body along.  No sensor tells
which; the physics of a solve holds to one of them with a curvature that is only that of
a rounded |v|.  Had a finger f stuck in action a, the body would have come by its slip
u in that action, and all poses before would lie by -u from where they are: a move e of
the poses against which the physics' Hessian H pulls by H e.  Hence

    K^{-1} ( sum_{a, f}  STUCK  H e e' H ) K^{-1},

nothing where touches alone hold the poses: a move that physics does not resist.

How far off an estimate may be where nothing was felt: its ball is but a guess.

There the vertices lie about a sphere (m, r) and near where they started, which is what
a page's prior says, each for itself.  A body differs from its ball otherwise: by INSIDE
radii, and alike in directions alike.  With u_j the direction of vertex j from m,

    v_j = start_j + r INSIDE g_j u_j,    cov(g_i, g_j) = exp(-|u_i - u_j|^2 / 2 ALIKE^2)

By such errors e of where it pulls to, the prior's Hessian H moves the estimate by
K^{-1} H e, nothing where touches hold the vertices:

    K^{-1} H cov(e) H K^{-1}
"""

from __future__ import annotations

import numpy as np

from ..geometry.convex_hull import INSIDE
from ..geometry.transforms import is_planar, matrices, points_in_body
from ..nlp.kkt_sensitivity import Curvature

STUCK = 0.1  # [-] of the fingers that seem to slide did not
ALIKE = 1.0  # [-] on the unit sphere: as far apart as directions to one face are
PRIOR = ("ball prior", "stay")  # what holds a vertex that nothing touches
TINY = 1e-9  # [-] of the covariance of g: it is singular where vertices coincide


def tension(curvature: Curvature, pulls, window, action) -> np.ndarray:
    """Return the covariance (k, k) of the chosen unknowns that disagreement tells, SI.

    pulls: see Curvature.response_of; action (T,): of every sample.
    """
    groups = [*_touches(curvature, window, action)]
    groups += _physics(curvature, window, action)
    moved = np.array([pulls.T @ s for s in groups]).reshape(-1, pulls.shape[1])
    return moved.T @ moved


def _touches(curvature, window, action):
    """Return the gradients (n,) of the touches of each finger in each action."""
    if "touch" not in curvature.problem.terms:
        return
    each = curvature.problem.jacobian("touch", curvature.x, curvature.data)
    touch = window.touch
    key = np.stack([action[touch.sample], touch.finger])
    for pair in np.unique(key, axis=1).T:
        yield _sum(each[np.flatnonzero((key == pair[:, None]).all(axis=0))])


def _physics(curvature, window, action) -> list[np.ndarray]:
    """Return what physics pulls (n,) at the poses of each action, and at the rest."""
    problem = curvature.problem
    pull = np.zeros(problem.size)
    for name, term in problem.costs.items():
        if term.role == "physics":
            pull += _sum(problem.jacobian(name, curvature.x, curvature.data))
    for name in problem.constraints:
        slope = problem.jacobian(name, curvature.x, curvature.data)
        pull += slope.T @ curvature.multipliers[name].ravel()
    x, of = problem.variables["x"], np.full(problem.size, -1)
    of[x.span] = np.repeat(action[window.last], x.rows)
    return [np.where(of == a, pull, 0.0) for a in np.unique(of)]


def _sum(rows) -> np.ndarray:
    return np.asarray(rows.sum(axis=0)).ravel()


def dragging(curvature: Curvature, pulls, window, action) -> np.ndarray:
    """Return the covariance (k, k) of the chosen unknowns if fingers stuck, SI.

    pulls: see Curvature.response_of; action (T,): of every sample.
    """
    problem, push = curvature.problem, window.push
    names = [n for n, term in problem.costs.items() if term.role == "physics"]
    H = curvature.hessian(names)
    x, slip = problem.variables["x"], slips(curvature, window)
    own, moved = action[push.sample], []
    for a, f in np.unique(np.stack([own, push.finger]), axis=1).T:
        rows = np.flatnonzero((own == a) & (push.finger == f))
        later = push.sample[rows] > window.last[:, None]  # (poses, rows)
        move = np.zeros((x.columns, x.rows))
        move[:, : slip.shape[1]] = -(later @ slip[rows])
        e = np.zeros(problem.size)
        e[x.span] = move.ravel()
        moved.append(pulls.T @ (H @ e))
    moved = np.array(moved).reshape(-1, pulls.shape[1])
    return STUCK * moved.T @ moved


def slips(curvature: Curvature, window) -> np.ndarray:
    """Return how far [m] each pushing finger slid over the body.

    (pushes, 2) over the ground, in planar motion; else (pushes, 3).
    """
    x, push = curvature.problem.unpack(curvature.x)["x"], window.push
    step = push.step
    now, before = (x[:, k[step]] for k in (window.step.pose, window.step.before))
    if not is_planar(x):
        met = points_in_body(before, slice(None), push.p_wf_1)
        return push.p_wf - now[:3].T - np.einsum("nij,nj->ni", matrices(now), met)
    arm = (push.p_wf_1[:, :2] - before[:2].T).T
    c, s = np.cos(now[2] - before[2]), np.sin(now[2] - before[2])
    carried = now[:2] + np.stack([c * arm[0] - s * arm[1], s * arm[0] + c * arm[1]])
    return push.p_wf[:, :2] - carried.T


def guessed(curvature: Curvature, pulls) -> np.ndarray:
    """Return the covariance (k, k) of the chosen unknowns by a wrong ball, SI.

    pulls: see Curvature.response_of.
    """
    problem, values = curvature.problem, curvature.problem.unpack(curvature.x)
    V, (*middle, radius) = values["theta"].T, np.ravel(values["ball"])
    u = V - middle
    u /= np.maximum(np.linalg.norm(u, axis=1, keepdims=True), radius * TINY)
    apart = np.linalg.norm(u[:, None] - u[None], axis=2)
    alike = np.exp(-((apart / ALIKE) ** 2) / 2)
    root = np.linalg.cholesky(alike + TINY * np.eye(len(u)))
    errors = np.zeros((problem.size, len(u)))
    errors[problem.variables["theta"].span] = (
        radius * INSIDE * (u[:, :, None] * root[:, None]).reshape(u.size, -1)
    )
    moved = pulls.T @ (curvature.hessian(PRIOR) @ errors)
    return moved @ moved.T
