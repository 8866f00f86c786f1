"""The exploration loop: touch, estimate, choose the next touch, repeat (the paper)."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..common.file_lock import can_be_written, locked
from ..common.progress import progress, wipe
from ..common.validation import check_path, check_types
from ..common.whole_file import check_file
from ..data.scene import Scene
from ..errors import OptionError, StartError
from ..estimation.solver import solve_estimate
from ..evaluation.metrics import errors_of
from ..information.information import POSE
from ..interface.request import check_start, checked_request
from ..interface.result import Estimate
from ..interface.session import Guess
from ..output.summary import headline
from ..problem.pages import name_of
from ..refinement.model_selection import classes_of
from .action_space import Workspace, workspace_of
from .log import (
    Exploration,
    Step,
    check_same,
    continued_in_time,
    load_or_new,
)
from .options import ExploreOptions
from .policies import check_predicted, next_action, shape_of_start
from .push_model import check_workspace
from .sweep import TouchedWorld, check_reach, check_world, execute, first_touch

log = logging.getLogger("tactilenlp")


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

    world: a TouchedWorld: `execute(trajectory) -> Measurements`; where its method
    `true_body(time)` tells the truth, step.errors are the errors of the estimate; its
    `check(trajectory)` raises for what it cannot reach.  scene: by default Scene().
    settings: ExploreOptions; or its fields as keywords (actions, policy, shape, seed
    also by position, in this order), but not both.  file: every action is saved there,
    as an Exploration, as soon as it is measured; a call with an existing file resumes
    from it (a simulated world that was made anew: Exploration.load(file).replay(world)
    first).  start: an Estimate instead of a first touch, or a Guess of the object.
    executor: any concurrent.futures executor.

    If the first finger, aimed at `centre`, makes no contact, the workspace is swept.
    Actions without contact are measurements too.  After one, or if the estimate is not
    where the last contact was or explains the measurements badly (`estimate.fit`), the
    next action is random and aims at the last contact.  `until` is not met while the
    fit is not good.

    While an action runs, its samples so far can be estimated, repeatedly:
    solve_estimate(estimate.measurements.append(so_far), scene, start=estimate).
    Raises OptionError, SceneError, StartError and FileError before the first command;
    FileError too while another process explores into this file.
    """
    settings = ExploreOptions.of(settings, positional, keywords)
    loop = _loop_of(world, scene, settings, file, start, executor)
    # Steps that a folder has, which cannot be written, are read without a world.
    written = file is not None and (world is not None or can_be_written(file))
    with locked(file) if written else nullcontext():
        yield from _steps(loop, file, start)


def _steps(loop: _Loop, file, start) -> Iterator[Step]:
    """Yield the steps of an exploration, those of a file first."""
    settings, world = loop.settings, loop.world
    estimate, past = start if isinstance(start, Estimate) else None, []
    exploration, first = load_or_new(file), 0 if estimate is None else 1
    again = bool(exploration.steps) or estimate is not None
    radius = getattr(world, "finger_radius", None)
    _check_fingers(radius, loop.space, exploration, estimate)
    check_workspace(loop.space, loop.same["scene"], radius)
    check_reach(world, loop.space, settings.centre, exploration.estimate or estimate)
    for number in progress(range(first, settings.actions + 1), "explore"):
        step = exploration.at(number)
        before = None if estimate is None else estimate.measurements
        if step is None:
            _check_state(world, exploration)
            step = loop.act(number, estimate, past)
        if step.estimate is None:  # measured now, or the process ended in the solve
            step = continued_in_time(step, before, again)
            exploration = _save(exploration.with_step(step), file)
        data = step.measurements
        data = data if before is None else before.append(data)
        if step.estimate is None:
            step = loop.with_estimate(step, data, estimate or start)
            exploration = _save(exploration.with_step(step), file)
        check_same(step.estimate, data, loop.same, file)
        estimate = step.estimate
        past += [] if step.action is None else [step.action]
        log.info("action %d (%s): %s", number, step.policy, headline(estimate))
        wipe()
        yield step
        if settings.until is not None and _enough(step, settings.until):
            return


@dataclass(frozen=True, eq=False)
class _Loop:
    """What every step needs.

    shapes: those possible; solve: function of data and start; same: the scene of saved
    estimates, their possible shapes and formulations, by name.
    """

    world: TouchedWorld | None
    space: Workspace
    settings: ExploreOptions
    shapes: list
    solve: Callable
    same: dict

    def act(self, number: int, estimate, past) -> Step:
        """Return the step of a first touch or a chosen action, without estimate."""
        if self.world is None:
            raise OptionError(
                "no world that executes an action", where="world", got="None",
                expected=f"a world, since the file has no step {number}",
            )  # fmt: skip
        rng = np.random.default_rng([self.settings.seed, number])
        world, space, began = self.world, self.space, time.process_time()
        if estimate is None:
            action, data, paths = first_touch(world, space, self.settings.centre, rng)
            acts, choice, words = began, None, "first touch"
        else:
            action, choice, words, target = next_action(
                estimate, space, past, rng, self.settings, self.shapes
            )
            acts, path = time.process_time(), action.trajectory(target)
            data, paths = execute(world, path), (path,)
        seconds = {"choose": acts - began, "act": time.process_time() - acts}
        return Step(number, action, data, None, choice, words, seconds, paths)

    def with_estimate(self, step: Step, data, start) -> Step:
        """Return the step with the estimate of all data so far and its errors."""
        began = time.process_time()
        estimate = self.solve(data, start=start)
        seconds = step.seconds | {"estimate": time.process_time() - began}
        try:
            errors = errors_of(self.world, estimate)
        except Exception:  # of the world's own code: the estimate is kept without them
            log.exception("world.true_body failed: errors are not known")
            errors = {}
        return replace(step, estimate=estimate, seconds=seconds, errors=errors)


def _loop_of(world, scene, settings: ExploreOptions, file, start, executor) -> _Loop:
    """Return what the steps need; raise for unusable arguments."""
    if world is not None:  # none is needed for actions that the file has
        check_world(world)
    check_types(start=(start, (Estimate, Guess, type(None))))
    if file is not None:
        check_path(file)
        if world is not None:
            check_file(file, str(file))
    several = classes_of(settings.shape)
    readings = [
        checked_request(scene, one, settings.formulation, settings.options, executor)
        for one in several or [settings.shape]
    ]
    scene, shape, options, _ = readings[0]
    classes = several or [shape]
    if several and isinstance(start, Estimate):
        shape = shape_of_start(start, classes)
    check_start(start, shape, scene)
    check_predicted(settings.policy, settings.actions, start, classes, scene)
    solve = partial(
        solve_estimate, scene=scene, shape=several or shape, options=options,
        formulation=settings.formulation, executor=executor, throw=False,
    )  # fmt: skip
    names = [one.name for one in classes]
    pages = [name_of(page) for *_, page in readings]
    same = {"scene": scene, "shape": names, "formulation": pages}
    radius = getattr(world, "finger_radius", None)
    space = settings.workspace or workspace_of(radius, scene.ground)
    return _Loop(world, space, settings, classes, solve, same)


def _check_fingers(radius, space: Workspace, exploration: Exploration, start) -> None:
    """Raise unless a world's fingers are those of workspace and earlier measurements.

    radius [m]: of the world's, a number or (F,); None: it does not tell; start: an
    Estimate, or None.
    """
    if np.ndim(radius) and len(radius) != space.fingers:
        raise OptionError(
            "another number of fingers", where="workspace.fingers", got=space.fingers,
            expected=f"{len(radius)}, as the world has",
        )  # fmt: skip
    earlier = [(f"step {s.number}", s.measurements) for s in exploration.steps]
    if start is not None:
        earlier.append(("start", start.measurements))
    for where, data in earlier:
        told = data.finger_radius if radius is None else radius
        if data.fingers != space.fingers or not np.all(data.finger_radius == told):
            raise StartError(
                "saved measurements of other fingers", where=where,
                got=f"finger_radius {data.finger_radius.tolist()}",
                expected=f"{space.fingers} fingers, {told} [m]",
                next="explore into another file, or from the first touch",
            )  # fmt: skip


def _check_state(world, kept: Exploration) -> None:
    """Raise where a world that knows the truth has not executed the saved actions."""
    if not kept.steps or getattr(world, "true_body", None) is None:
        return
    last = kept.steps[-1]
    if world.true_body(float(last.measurements.time[-1])) is None:
        raise StartError(
            "the world has not executed the saved actions", where="world",
            got="an object where the world was made",
            expected=f"one moved by the actions up to step {last.number}",
            next="Exploration.load(file).replay(world) repeats them",
        )  # fmt: skip


def _save(kept: Exploration, file) -> Exploration:
    """Save the steps so far, if there is a file; return them."""
    if file is not None:
        kept.save(file)
    return kept


def _enough(step: Step, until) -> bool:
    """Tell whether a step is the last: by a function, or by the sigmas of sizes."""
    if callable(until):
        return bool(until(step))
    information, fit = step.estimate.information, step.estimate.fit
    if fit is not None and fit.verdict != "good":
        return False
    sizes = [information.sigma(name) for name in information.maps if name not in POSE]
    return bool(sizes) and bool(np.nanmax(np.concatenate(sizes)) <= until)
