"""Explore: touch, estimate, choose, touch again, until enough is known (the paper)."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from ..common.progress import progress, wipe
from ..common.validation import check_numbers, check_path, check_types
from ..data.scene import Scene
from ..errors import OptionError, StartError
from ..estimation.options import Guess, Options
from ..estimation.readout import name_of
from ..estimation.request import asked, check_start
from ..estimation.result import Estimate
from ..estimation.solver import solve_estimate
from ..evaluation.ground_truth import errors_of
from .action_search import CrossEntropy, check_search
from .action_space import Action, Workspace
from .first_touch import first_touch
from .log import Exploration, Step, check_file, check_same, onward, taken_up
from .policies import Plan, check_predicted, chosen, known_policy

log = logging.getLogger("tactilenlp")


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

    world: anything with `execute(trajectory) -> Measurements`; one that keeps a truth,
    as World does, is compared with it in step.errors.  centre: where a first
    finger aims, (2,) or (3,) [m], as in the paper; where it meets nothing, or without a
    centre, the workspace is swept until something is touched (not counted).  policy:
    "eig", "random", "fisher" (information of the action alone), "farthest" (from all
    directions so far), or a function of a Plan.  until: a deviation [m] of the sizes,
    or of the vertices of a polytope, that is enough, or a function of a Step.  file:
    keeps every action as soon as it is measured, as an Exploration; called again with
    the same file, it goes on from there.
    start: an Estimate to begin from instead of a first touch, or a Guess of the object.

    An action without contact is data.  After one, or where an estimate lies apart from
    what was touched, the next action is random and aims at the last touched spot.

    While an action runs, whoever has its samples so far may look ahead, repeatedly:
    solve_estimate(estimate.measurements.append(so_far), scene, start=estimate).
    """
    _check(world, actions, seed, workspace, until, file, start)
    check_search(search, budget)
    policy = known_policy(policy)
    scene, shape, options, page = asked(scene, shape, formulation, options, executor)
    check_start(start, shape, scene)
    check_predicted(policy, actions, start, shape, scene)
    settings = {"search": search, "budget": budget, "policy": policy, "shape": shape}
    solve = partial(
        solve_estimate, scene=scene, shape=shape, formulation=page, options=options,
        executor=executor, throw=False,
    )  # fmt: skip
    same = {"scene": scene, "shape": shape.name, "formulation": name_of(page)}
    space = _space(world, scene, workspace)
    estimate, past = start if isinstance(start, Estimate) else None, []
    diary, numbers = taken_up(file), range(0 if estimate is None else 1, actions + 1)
    again = bool(diary.steps) or estimate is not None
    _check_fingers(world, space, diary)
    for number in progress(numbers, "explore"):
        step = diary.at(number)
        before = None if estimate is None else estimate.measurements
        if step is None:
            rng = np.random.default_rng([seed, number])
            if estimate is None:
                step = _touch_first(world, space, centre, rng)
            else:
                step = _act(world, space, number, estimate, past, rng, settings)
            step = onward(step, before, again)
            diary = _kept(diary.with_step(step), file)
        elif step.estimate is None:  # the process ended while it was solved
            step = onward(step, before, again)
        data = step.measurements
        data = data if before is None else before.append(data)
        if step.estimate is None:
            step = _estimated(world, step, solve, data, estimate or start)
            diary = _kept(diary.with_step(step), file)
        check_same(step.estimate, data, same, file)
        estimate = step.estimate
        past += [] if step.action is None else [step.action]
        log.info("action %d (%s): %s", number, step.policy, _headline(estimate))
        wipe()
        yield step
        if until is not None and _enough(step, until):
            return


def _estimated(world, step: Step, solve, data, start) -> Step:
    """Return the step with the estimate of all data so far, and how far off it is."""
    began = time.process_time()
    found = solve(data, start=start)
    seconds = step.seconds | {"estimate": time.process_time() - began}
    errors = errors_of(world, found)
    return replace(step, estimate=found, seconds=seconds, errors=errors)


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
        if world is not None:
            check_file(file)


def _check_fingers(world, space: Workspace, diary: Exploration) -> None:
    """Raise unless the world has the fingers of the workspace and of what is kept."""
    radius = getattr(world, "finger_radius", None)
    if radius is None:
        return
    if np.ndim(radius) and len(radius) != space.fingers:
        raise OptionError(
            "another number of fingers", where="workspace.fingers", got=space.fingers,
            expected=f"{len(radius)}, as the world has",
        )  # fmt: skip
    for step in diary.steps:
        kept = step.measurements.finger_radius
        if len(kept) != space.fingers or not np.all(kept == radius):
            raise StartError(
                "kept measurements of other fingers", where=f"step {step.number}",
                got=f"finger_radius {kept.tolist()}", expected=f"{radius} [m]",
                next="explore into another file",
            )  # fmt: skip


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
    action, choice, words, target = chosen(estimate, space, past, rng, settings)
    acts, told = time.process_time(), action.trajectory(target)
    data = world.execute(told)
    seconds = {"choose": acts - began, "act": time.process_time() - acts}
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


def _enough(step: Step, until) -> bool:
    if callable(until):
        return bool(until(step))
    information = step.estimate.information
    size = "vertices" if "vertices" in information.maps else "side_lengths"
    return bool(np.nanmax(information.sigma(size)) <= until)
