"""Choose the next action of an exploration by a policy."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from formulations.shape import Shape

from ..common.brief import printed
from ..common.validation import check_one_of, check_types
from ..data.contact_segments import lasting_contacts
from ..data.ground import frame_of
from ..interface.result import Estimate
from ..problem.pages import shape_of
from .action_search import choose_action
from .action_space import Action, Workspace
from .optimisers import CrossEntropy
from .push_model import check_predictable

log = logging.getLogger("tactilenlp")
POLICIES = ("eig", "random", "fisher", "farthest")
PREDICTIVE = ("eig", "fisher")  # policies that predict the outcome of actions
DEPTH_BEHIND_CONTACT = 0.015  # [m] at which the next action aims after a lost object
FARTHEST_DRAWS = 400  # actions drawn for the policy "farthest"


@printed
@dataclass(frozen=True, eq=False)
class Plan:
    """The arguments of a policy.

    estimate:  of all measurements so far
    workspace: Workspace of the actions
    past:      the actions so far
    rng:       generator of random numbers for this action
    search:    of the action, as in choose_action
    budget:    [1], evaluations of the expected gain
    shape:     Shape of the estimate
    """

    estimate: Estimate
    workspace: Workspace
    past: tuple[Action, ...]
    rng: np.random.Generator
    search: str | CrossEntropy
    budget: int
    shape: Shape


def check_policy(policy) -> None:
    """Raise OptionError for what is no policy."""
    if not callable(policy):
        what, also = "no such policy", "or a function of a Plan"
        check_one_of("policy", policy, POLICIES, what, unit=also)


def check_predicted(policy, actions, start, shapes, scene) -> None:
    """Raise SceneError or OptionError if a policy needs predictions that do not exist.

    The first action is chosen with the scene and shape of the start, if that is an
    Estimate; the others with those of the exploration, whose shapes are all possible.
    """
    started = isinstance(start, Estimate)
    if policy not in PREDICTIVE:
        return
    if started and actions:
        check_predictable(start.scene, shape_of_start(start, shapes))
    if actions > started:
        for shape in shapes:
            check_predictable(scene, shape)


def shape_of_start(estimate, shapes) -> Shape:
    """Return the shape of an estimate: one of those given, or the one of its name."""
    by_name = {shape.name: shape for shape in shapes}
    return by_name.get(estimate.shape) or shape_of(estimate.shape)


def next_action(estimate, space, past, rng, settings, shapes):
    """Return the next action, its Choice or None, the policy in words, its target.

    settings: ExploreOptions, with a shape of those given.
    """
    reach = float(np.linalg.norm(estimate.vertices, axis=1).max())
    space = space.around(reach)
    target, policy = estimate.position[-1], settings.policy
    lost = why_lost(estimate)
    if lost:
        log.warning("%s: aiming at the last contact", lost)
        target = last_contact(estimate)
        return space.random(rng, None, target), None, "last contact", target
    search, shape = settings.search, shape_of_start(estimate, shapes)
    plan = Plan(estimate, space, tuple(past), rng, search, settings.budget, shape)
    if callable(policy):
        action, name = policy(plan), getattr(policy, "__name__", "own")
        check_types(**{f"the action that {name} returns": (action, Action)})
        return action, None, name, target
    if policy in PREDICTIVE:
        choice = choose_action(
            estimate, space, search=plan.search, budget=plan.budget,
            seed=int(rng.integers(2**31)), shape=plan.shape,
            prior_only=policy == "fisher",
        )  # fmt: skip
        return choice.action, choice, policy, target
    if policy == "random":
        return space.random(rng, None, target), None, policy, target
    return farthest_action(plan), None, policy, target


def why_lost(estimate) -> str:
    """Return in words why the next action should not aim at the estimate, or ""."""
    data = estimate.measurements
    if not lasting_contacts(data)[data.action == data.action[-1]].any():
        return "no contact in the last action"
    apart = last_contact(estimate) - estimate.position[-1]
    if np.linalg.norm(apart) > np.linalg.norm(estimate.vertices, axis=1).max():
        return "the estimate is not where the last contact was"
    if estimate.fit is not None and estimate.fit.verdict == "bad":
        return "the estimate explains the measurements badly"
    return ""


def last_contact(estimate) -> np.ndarray:
    """Return a point (3,) [m] behind the last contact, as high as the body's centroid.

    Contacts of one sample may be wrong booleans.  Without any other, the centroid.
    """
    data, centre = estimate.measurements, estimate.position[-1]
    t, f = np.nonzero(lasting_contacts(data))
    if not len(t):
        return centre
    n, frame = data.normal[t[-1], f[-1]], frame_of(estimate.scene.ground)
    depth = data.finger_radius[f[-1]] + DEPTH_BEHIND_CONTACT
    point = frame.to_ground(data.finger_position[t[-1], f[-1]] - depth * n)
    return frame.from_ground(np.r_[point[:2], frame.to_ground(centre)[2]])


def farthest_action(plan: Plan) -> Action:
    """Draw actions and return the one farthest from others.

    By the sum over fingers of the angle to the nearest direction of a past action;
    without past actions, to the nearest measured normal.
    """
    data = plan.estimate.measurements
    seen = [a.directions[list(a.active)] for a in plan.past]
    R_gw = frame_of(plan.workspace.ground).rotation
    seen = np.concatenate(seen or [data.normal[data.contact] @ R_gw.T])

    def nearest(action) -> float:
        return np.arccos(np.clip(action.directions @ seen.T, -1, 1)).min(axis=1).sum()

    rng, target = plan.rng, plan.estimate.position[-1]
    drawn = (plan.workspace.random(rng, None, target) for _ in range(FARTHEST_DRAWS))
    return max(drawn, key=nearest)
