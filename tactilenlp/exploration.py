"""Explore: touch, estimate, choose, touch again, until enough is known (the paper)."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from .approach import facing
from .checks import check_numbers, check_path, check_types
from .choose import Choice, CrossEntropy, best_action, check_search, choose_action
from .diary import Exploration, Step, check_same, taken_up
from .errors import OptionError
from .estimate import solve_estimate
from .expected import ExpectedInformation
from .first_touch import first_touch
from .guess import Guess
from .measurements import Measurements
from .options import Options
from .predict import check_ground, check_moves
from .progress import progress, wipe
from .readout import name_of
from .request import asked, check_start, shape_of
from .result import Estimate
from .scene import Scene
from .workspace import Action, Workspace

log = logging.getLogger("tactilenlp")

POLICIES = ("eig", "random", "fisher", "farthest")
PREDICTING = ("eig", "fisher")  # those of them that foresee what an action brings
INWARD = 0.015  # [m] behind a touched point where an object that was lost is sought
TRIES = 400  # actions drawn for the policy "farthest"


@dataclass(frozen=True, eq=False)
class Plan:
    """What a policy is given: estimate, workspace, past actions, its own generator."""

    estimate: Estimate
    workspace: Workspace
    past: tuple[Action, ...]
    rng: np.random.Generator
    search: str | CrossEntropy
    budget: int


def explore(
    world,
    scene: Scene | None = None,
    actions: int = 5,
    policy: str | Callable[[Plan], Action] = "eig",
    shape: str = "cuboid",
    seed: int = 0,
    *,
    workspace: Workspace | None = None,
    formulation="violation_implicit",
    centre=None,
    search: str | CrossEntropy = "facing",
    budget: int = 180,
    options: Options | None = None,
    until: float | Callable[[Step], bool] | None = None,
    file=None,
    start: Estimate | Guess | None = None,
    executor=None,
) -> Iterator[Step]:
    """Touch an object and yield a Step after the first touch and after each action.

    world: anything with `execute(trajectory) -> Measurements`.  centre: where a first
    finger aims, (2,) or (3,) [m], as in the paper; where it meets nothing, or without a
    centre, the workspace is swept until something is touched (not counted).  policy:
    "eig", "random", "fisher" (information of the action alone), "farthest" (from all
    directions so far), or a function of a Plan.  until: a deviation of the sizes [m]
    that is enough, or a function of a Step.  file: keeps every action as soon as it is
    measured, as an Exploration; called again with the same file, it goes on from there.
    start: an Estimate to begin from instead of a first touch, or a Guess of the object.

    An action without contact is data.  After one, or where an estimate lies apart from
    what was touched, the next action is random and aims at the last touched spot.

    While an action runs, whoever has its samples so far may look ahead, repeatedly:
    solve_estimate(estimate.measurements.append(so_far), scene, start=estimate).
    """
    _check(world, actions, seed, workspace, until, file, start)
    settings = {"search": search, "budget": budget, "policy": _known(policy)}
    check_search(search, budget)
    scene, shape, options, page = asked(scene, shape, formulation, options, executor)
    check_start(start, shape, scene)
    _check_predicted(policy, actions, start, shape, scene)
    same = {"scene": scene, "shape": shape.name, "formulation": name_of(page)}
    space = _space(world, scene, workspace)
    estimate, past = start if isinstance(start, Estimate) else None, []
    diary, numbers = taken_up(file), range(0 if estimate is None else 1, actions + 1)
    for number in progress(numbers, "explore"):
        step = diary.at(number)
        if step is None:
            rng = np.random.default_rng([seed, number])
            if estimate is None:
                step = _touch_first(world, space, centre, rng)
            else:
                step = _act(world, space, number, estimate, past, rng, settings)
            diary = _kept(diary.with_step(step), file)
        data = step.measurements
        data = data if estimate is None else estimate.measurements.append(data)
        if step.estimate is None:
            began = time.process_time()
            found = solve_estimate(
                data, scene, shape=shape, formulation=page, options=options,
                start=estimate or start, executor=executor, throw=False,
            )  # fmt: skip
            seconds = step.seconds | {"estimate": time.process_time() - began}
            step = replace(step, estimate=found, seconds=seconds)
            diary = _kept(diary.with_step(step), file)
        check_same(step.estimate, data, same, file)
        estimate = step.estimate
        past += [] if step.action is None else [step.action]
        log.info("action %d (%s): %s", number, step.policy, _headline(estimate))
        wipe()
        yield step
        if until is not None and _enough(step, until):
            return


def _check(world, actions, seed, workspace, until, file, start) -> None:
    """Raise OptionError for what cannot be explored, before anything moves."""
    # A file can stand for a world that is not there: for actions that it has.
    if world is not None and not callable(getattr(world, "execute", None)):
        raise OptionError(
            "nothing to explore", where="world", got=repr(world)[:80],
            expected="an object with execute(trajectory) -> Measurements",
        )  # fmt: skip
    none = type(None)
    check_types(
        workspace=(workspace, (Workspace, none)),
        start=(start, (Estimate, Guess, none)), actions=(actions, (int, np.integer)),
        seed=(seed, (int, np.integer)),
    )  # fmt: skip
    check_numbers("", "a whole number from 0", actions=(actions, -1, np.inf))
    check_numbers("", "a whole number from 0", seed=(seed, -1, np.inf))
    if until is not None and not callable(until):
        check_numbers("", "a deviation above 0 [m], or a function", until=(until, 0, 1))
    if file is not None:
        check_path(file)


def _check_predicted(policy, actions, start, shape, scene) -> None:
    """Raise for a policy that predicts what cannot be predicted.

    The first action is chosen by the start, if that is an Estimate, others by what is
    asked for.
    """
    started = isinstance(start, Estimate)
    if policy not in PREDICTING:
        return
    if started and actions:
        check_ground(start.scene)
        check_moves(shape_of(start.shape))
    if actions > started:
        check_ground(scene)
        check_moves(shape_of(shape.name))  # what it says of itself when it is chosen


def _kept(diary: Exploration, file) -> Exploration:
    """Return the diary, kept in a file if there is to be one."""
    if file is not None:
        diary.save(file)
    return diary


def _touch_first(world, space, centre, rng) -> Step:
    began = time.process_time()
    action, data, told = first_touch(world, space, centre, rng)
    seconds = {"choose": 0.0, "act": time.process_time() - began}
    return Step(0, action, data, None, None, "first touch", seconds, told)


def _act(world, space, number, estimate, past, rng, settings) -> Step:
    began = time.process_time()
    action, choice, words, target = _next(estimate, space, past, rng, settings)
    chosen, told = time.process_time(), action.trajectory(target)
    data = world.execute(told)
    seconds = {"choose": chosen - began, "act": time.process_time() - chosen}
    return Step(number, action, data, None, choice, words, seconds, (told,))


def _headline(estimate) -> str:
    return estimate.summary().partition("\n")[0]


def _space(world, scene, workspace) -> Workspace:
    """Return the workspace: as given, or with the fingers and the ground that are."""
    if workspace is not None:
        return workspace
    ground = scene.ground
    radius = getattr(world, "finger_radius", None)
    if radius is None:
        return Workspace(ground=ground)
    radius = np.atleast_1d(radius)
    return Workspace(
        fingers=len(radius), finger_radius=float(radius.max()), ground=ground
    )


def _known(policy):
    if callable(policy) or policy in POLICIES:
        return policy
    raise OptionError(
        "no such policy",
        where="policy",
        got=policy,
        expected=f"one of {POLICIES}, or a function of a Plan",
    )


def _next(estimate, space, past, rng, settings):
    """Return the next action, how it was chosen, in words, and where it aims."""
    target, policy = estimate.position[-1], settings["policy"]
    data = estimate.measurements
    lost = _lost(estimate)
    if lost:
        log.warning("%s: aiming at the last touched spot", lost)
        return space.random(rng), None, "sought again", last_touched(data, target)
    plan = Plan(
        estimate, space, tuple(past), rng, settings["search"], settings["budget"]
    )
    if callable(policy):
        return policy(plan), None, getattr(policy, "__name__", "own"), target
    if policy == "eig":
        given = {"search": plan.search, "budget": plan.budget}
        given["seed"] = int(rng.integers(2**31))
        choice = choose_action(estimate, space, **given)
    elif policy == "fisher":
        choice = _most_fisher(plan)
    else:
        draw = space.random if policy == "random" else _farthest(plan)
        return draw(rng), None, policy, target
    return choice.action, choice, policy, target


def _lost(estimate) -> str:
    """Return in words why the estimate cannot be aimed at, or nothing."""
    data = estimate.measurements
    if not (data.contact & data.valid)[data.action == data.action[-1]].any():
        return "nothing was touched"
    apart = (last_touched(data, estimate.position[-1]) - estimate.position[-1])[:2]
    if np.linalg.norm(apart) > np.linalg.norm(estimate.vertices, axis=1).max():
        return "the estimate lies apart from what was touched"
    return ""


def last_touched(data: Measurements, otherwise: np.ndarray) -> np.ndarray:
    """Return a point (3,) [m] a little behind the spot that was touched last."""
    t, f = np.nonzero(data.contact & data.valid)
    if not len(t):
        return otherwise
    n = data.normal[t[-1], f[-1]]
    depth = data.finger_radius[f[-1]] + INWARD
    point = data.finger_position[t[-1], f[-1]] - depth * n
    return np.r_[point[:2], otherwise[2]]


def _most_fisher(plan: Plan) -> Choice:
    """Return the action that tells most to one who knows nothing but a rough size."""
    expected = ExpectedInformation(plan.estimate, plan.workspace)
    prior = expected.vague()
    expected.beliefs = [replace(b, information=prior) for b in expected.beliefs]
    return best_action(
        lambda angles: expected.gain(plan.workspace.action(angles)),
        plan.workspace, search=plan.search, budget=plan.budget,
        seed=int(plan.rng.integers(2**31)),
        facing=facing(plan.estimate, plan.workspace),
    )  # fmt: skip


def _farthest(plan: Plan) -> Callable:
    """Return a draw of the action whose directions are farthest from all before.

    Without actions to look back on, from the normals that were felt.
    """
    data = plan.estimate.measurements
    seen = [a.directions[list(a.active)] for a in plan.past]
    seen = np.concatenate(seen or [data.normal[data.contact & data.valid]])

    def nearest(action) -> float:
        return np.arccos(np.clip(action.directions @ seen.T, -1, 1)).min(axis=1).sum()

    def draw(rng) -> Action:
        return max((plan.workspace.random(rng) for _ in range(TRIES)), key=nearest)

    return draw


def _enough(step: Step, until) -> bool:
    if callable(until):
        return bool(until(step))
    deviation = step.estimate.information.sigma("side_lengths")
    return bool(np.nanmax(deviation) <= until)
