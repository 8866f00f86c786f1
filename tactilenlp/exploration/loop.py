"""Explore: touch, estimate, choose, touch again, until enough is known (the paper)."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..common.progress import progress, wipe
from ..common.validation import check_path, check_types
from ..data.scene import Scene
from ..errors import OptionError, StartError
from ..estimation.options import Guess
from ..estimation.readout import name_of
from ..estimation.request import asked, check_start
from ..estimation.result import Estimate
from ..estimation.solver import solve_estimate
from ..evaluation.ground_truth import errors_of
from .action_space import Workspace
from .first_touch import first_touch
from .log import (
    Exploration,
    Step,
    check_file,
    check_same,
    continued_in_time,
    load_or_new,
)
from .options import ExploreOptions
from .policies import check_predicted, checked_policy, next_action

log = logging.getLogger("tactilenlp")

POSITIONAL = ("actions", "policy", "shape", "seed")  # settings after world and scene


def explore(
    world,
    scene: Scene | None = None,
    *positional,
    settings: ExploreOptions | None = None,
    file=None,
    start: Estimate | Guess | None = None,
    executor=None,
    **keywords,
) -> Iterator[Step]:
    """Touch an object and yield a Step after the first touch and after each action.

    world: anything with `execute(trajectory) -> Measurements`; one that keeps a truth,
    as World does, is compared with it in step.errors.  scene: what is known (default
    Scene()).  settings: ExploreOptions; each of them may be given as a keyword instead
    (actions, policy, shape, seed also by position, in this order), but not both.  file:
    keeps every action as soon as it is measured, as an Exploration; called again with
    the same file, it goes on from there.  start: an Estimate to begin from instead of a
    first touch, or a Guess of the object.  executor: any concurrent.futures executor.

    Where a first finger aimed at `centre` meets nothing, the workspace is swept.  An
    action without contact is data.  After one, or where an estimate lies apart from
    what was touched, the next action is random and aims at the last touched spot.

    While an action runs, its samples so far can be estimated, repeatedly:
    solve_estimate(estimate.measurements.append(so_far), scene, start=estimate).
    Raises OptionError, SceneError, StartError and FileError before anything moves.
    """
    given = _by_name(positional, keywords)
    settings = ExploreOptions.of(settings, given)
    loop = _prepared(world, scene, settings, file, start, executor)
    estimate, past = start if isinstance(start, Estimate) else None, []
    kept, first = load_or_new(file), 0 if estimate is None else 1
    again = bool(kept.steps) or estimate is not None
    _check_fingers(world, loop.space, kept)
    for number in progress(range(first, settings.actions + 1), "explore"):
        step = kept.at(number)
        before = None if estimate is None else estimate.measurements
        if step is None or step.estimate is None:  # or the process ended in the solve
            step = loop.acted(number, estimate, past) if step is None else step
            step = continued_in_time(step, before, again)
            kept = _saved(kept.with_step(step), file)
        data = step.measurements
        data = data if before is None else before.append(data)
        if step.estimate is None:
            step = loop.estimated(step, data, estimate or start)
            kept = _saved(kept.with_step(step), file)
        check_same(step.estimate, data, loop.same, file)
        estimate = step.estimate
        past += [] if step.action is None else [step.action]
        log.info("action %d (%s): %s", number, step.policy, _headline(estimate))
        wipe()
        yield step
        if settings.until is not None and _enough(step, settings.until):
            return


@dataclass(frozen=True, eq=False)
class _Loop:
    """What every step needs: solve(data, start=...) and the arguments of `chosen`.

    same: what a kept estimate must be of, by field.
    """

    world: object
    space: Workspace
    settings: ExploreOptions
    choice: dict
    solve: Callable
    same: dict

    def acted(self, number: int, estimate, past) -> Step:
        """Return the step of the first touch or of a chosen action, not yet solved."""
        rng = np.random.default_rng([self.settings.seed, number])
        if estimate is None:
            return _touch_first(self.world, self.space, self.settings.centre, rng)
        return _act(self.world, self.space, number, estimate, past, rng, self.choice)

    def estimated(self, step: Step, data, start) -> Step:
        """Return the step with the estimate of all data so far, and its errors."""
        began = time.process_time()
        found = self.solve(data, start=start)
        seconds = step.seconds | {"estimate": time.process_time() - began}
        errors = errors_of(self.world, found)
        return replace(step, estimate=found, seconds=seconds, errors=errors)


def _prepared(world, scene, settings: ExploreOptions, file, start, executor) -> _Loop:
    """Return what the steps need; raise for what cannot be explored."""
    _check(world, file, start)
    policy = checked_policy(settings.policy)
    scene, shape, options, page = asked(
        scene, settings.shape, settings.formulation, settings.options, executor
    )
    check_start(start, shape, scene)
    check_predicted(policy, settings.actions, start, shape, scene)
    choice = {"search": settings.search, "budget": settings.budget}
    choice |= {"policy": policy, "shape": shape}
    solve = partial(
        solve_estimate, scene=scene, shape=shape, formulation=page, options=options,
        executor=executor, throw=False,
    )  # fmt: skip
    same = {"scene": scene, "shape": shape.name, "formulation": name_of(page)}
    space = _space(world, scene, settings.workspace)
    return _Loop(world, space, settings, choice, solve, same)


def _by_name(positional, keywords: dict) -> dict:
    """Return settings by name, of positional and keyword arguments."""
    if len(positional) > len(POSITIONAL):
        raise OptionError(
            "too many positional arguments", where="explore", got=len(positional) + 2,
            expected=f"world, scene, {', '.join(POSITIONAL)}",
        )  # fmt: skip
    given = dict(zip(POSITIONAL, positional, strict=False))
    if twice := [name for name in given if name in keywords]:
        raise OptionError("given twice", where=twice[0], got="by position and by name")
    return given | keywords


def _check(world, file, start) -> None:
    """Raise OptionError for what cannot be explored, before anything moves."""
    # A file can stand for a world that is not there: for actions that it has.
    if world is not None and not callable(getattr(world, "execute", None)):
        raise OptionError(
            "nothing to explore", where="world", got=repr(world)[:80],
            expected="an object with execute(trajectory) -> Measurements",
        )  # fmt: skip
    check_types(start=(start, (Estimate, Guess, type(None))))
    if file is not None:
        check_path(file)
        if world is not None:
            check_file(file)


def _check_fingers(world, space: Workspace, kept: Exploration) -> None:
    """Raise unless the world has the fingers of the workspace and of what is kept."""
    radius = getattr(world, "finger_radius", None)
    if radius is None:
        return
    if np.ndim(radius) and len(radius) != space.fingers:
        raise OptionError(
            "another number of fingers", where="workspace.fingers", got=space.fingers,
            expected=f"{len(radius)}, as the world has",
        )  # fmt: skip
    for step in kept.steps:
        kept = step.measurements.finger_radius
        if len(kept) != space.fingers or not np.all(kept == radius):
            raise StartError(
                "kept measurements of other fingers", where=f"step {step.number}",
                got=f"finger_radius {kept.tolist()}", expected=f"{radius} [m]",
                next="explore into another file",
            )  # fmt: skip


def _saved(kept: Exploration, file) -> Exploration:
    """Return the steps so far, saved if there is a file for them."""
    if file is not None:
        kept.save(file)
    return kept


def _touch_first(world, space, centre, rng) -> Step:
    began = time.process_time()
    action, data, told = first_touch(world, space, centre, rng)
    seconds = {"choose": 0.0, "act": time.process_time() - began}
    return Step(0, action, data, None, None, "first touch", seconds, told)


def _act(world, space, number, estimate, past, rng, settings) -> Step:
    began = time.process_time()
    action, choice, words, target = next_action(estimate, space, past, rng, settings)
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
