"""Search the action space for the largest expected information gain (nlopt)."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from formulations.shape import Shape

from ..common.brief import printed
from ..common.interrupt import interruptible
from ..common.threads import on_one_thread
from ..common.validation import check_types, check_whole
from ..data.ground import frame_of
from ..errors import typed_call
from ..geometry.faces import polygons
from .action_space import Action, Workspace
from .expected_information import ExpectedInformation
from .optimisers import CrossEntropy, Objective, check_search, maximise

# Share of the budget for actions that face corners, edges and faces, by search.
FACING_SHARE = {"facing": 0.4, "direct": 0.3, "direct_l": 0.3}  # [-]
MAX_PERMUTED = 100_000  # [1] combinations of fingers: of more, some are drawn
BOUND_MARGIN = 0.15  # [rad] outside of its bounds, a direction is moved to them


@printed
@dataclass(frozen=True, eq=False)
class Choice:
    """The chosen action, and the search that found it.

    gain:        [nats], the expected information gain of the action
    evaluations: [1], of the gain
    seconds:     [s], CPU time of the search
    search:      its name
    history:     (n,) [nats], the gains of all evaluated actions, in order
    tried:       (n, 2 F) [rad], their angles
    seed:        of the search: choose_action repeats it; None in files without it
    """

    action: Action
    gain: float
    evaluations: int
    seconds: float
    search: str
    history: np.ndarray
    tried: np.ndarray
    seed: int | None = None


@typed_call()
@interruptible()
@on_one_thread
def choose_action(
    estimate,
    workspace: Workspace | None = None,
    *,
    search: str | CrossEntropy = "facing",
    budget: int = 180,
    seed: int = 0,
    hypotheses: int = 3,
    slopes: str = "motion",
    shape: Shape | None = None,
    prior_only: bool = False,
) -> Choice:
    """Return the action with the largest expected information gain (eq:eig).

    search: "facing" (actions that face corners, edges and faces; from the best of them
    COBYLA, then Subplex), "direct" or "direct_l" (facing actions, then dividing
    rectangles, then COBYLA), "crs2", "isres", "mlsl", "bobyqa", "random", "cem" or a
    CrossEntropy (the paper's: the action is drawn from the best of the last iteration).
    budget: evaluations of the gain (a CrossEntropy has its own).  Equal seeds give
    equal choices.  hypotheses, slopes, shape: see ExpectedInformation.  prior_only: the
    gain over the prior, without the measurements so far (D-optimal design).  Lines of
    the action start outside the estimated body: the workspace's radius is enlarged for
    that.  Raises OptionError, SceneError.
    """
    check_types(prior_only=(prior_only, bool))
    began = time.process_time()
    expected = ExpectedInformation(estimate, workspace, hypotheses, slopes, shape)
    if prior_only:
        expected.beliefs = [replace(b, information=b.before) for b in expected.beliefs]
    space, target = expected.workspace, expected.target

    def score(angles) -> float:
        action = space.action(angles)
        return -np.inf if action.blocked(target) else expected.gain(action)

    choice = best_action(
        score, space, search=search, budget=budget, seed=seed,
        facing=facing(estimate, space),
    )  # fmt: skip
    choice.action.trajectory(target)  # raises where every action met an obstacle
    return replace(choice, seconds=time.process_time() - began)


def best_action(
    score: Callable,
    space: Workspace,
    *,
    search: str | CrossEntropy = "facing",
    budget: int = 180,
    seed: int = 0,
    facing: list[np.ndarray] | None = None,
) -> Choice:
    """Return the action whose angles (2 F,) have the largest score.

    NaN and infinity count as the worst score.  facing: for each finger, the angles
    (n, 2) that face the object; the searches "facing" and "direct" begin with them.
    """
    began = time.process_time()
    name = check_search(search, budget)
    check_whole("seed", seed, 0, 2**32 - 1)
    objective = Objective(score, space.lower, space.upper, budget)
    rng = np.random.default_rng(seed)
    if facing and name in FACING_SHARE:
        for angles in combined(facing, round(FACING_SHARE[name] * budget), rng):
            objective(angles)
    best = maximise(objective, search, seed, rng)
    return Choice(
        action=space.action(objective.tried[best]),
        gain=objective.scores[best],
        evaluations=len(objective.scores),
        seconds=time.process_time() - began,
        search=name,
        history=np.array(objective.scores),
        tried=np.array(objective.tried),
        seed=int(seed),
    )


def facing(estimate, space: Workspace) -> list[np.ndarray]:
    """Return for each finger the angles (n, 2) [rad] that face the object.

    They point to its corners, middles of edges and middles of faces.
    """
    vertices, R_wo = estimate.vertices, estimate.rotation()
    points = list(vertices)
    for face, _ in polygons(vertices):
        points.append(vertices[face].mean(axis=0))
        points += [
            (vertices[i] + vertices[j]) / 2 for i, j in pairwise((*face, face[0]))
        ]
    toward = np.unique(np.round(points, 9), axis=0) @ R_wo.T
    toward = toward @ frame_of(space.ground).rotation.T
    azimuth = np.arctan2(toward[:, 1], toward[:, 0])
    declination = np.arcsin(toward[:, 2] / np.linalg.norm(toward, axis=1))
    out = []
    for finger in range(space.fingers):
        heading = 2 * np.pi * finger / space.fingers
        ascension = (azimuth - heading + np.pi) % (2 * np.pi) - np.pi
        at = slice(2 * finger, 2 * finger + 2)
        low, high = space.lower[at], space.upper[at]
        angles = np.stack([ascension, declination], axis=1)
        near = (angles >= low - BOUND_MARGIN) & (angles <= high + BOUND_MARGIN)
        near = np.clip(angles[near.all(axis=1)], low, high)
        out.append(near if len(near) else (low + high)[None] / 2)
    return out


def combined(facing: list[np.ndarray], count: int, rng) -> np.ndarray:
    """Return at most `count` actions (n, 2 F) [rad] of fingers that face the object."""
    sizes = [len(angles) for angles in facing]
    if math.prod(sizes) <= MAX_PERMUTED:
        drawn = rng.permutation(math.prod(sizes))[:count]
        picks = np.unravel_index(drawn, sizes)
    else:
        picks = rng.integers(sizes, size=(count, len(sizes))).T
    return np.hstack([a[i] for a, i in zip(facing, picks, strict=True)])
