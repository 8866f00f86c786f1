"""The exploration log: the steps, and the file from which an exploration resumes."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace

import numpy as np

from ..common.brief import printed, same_content
from ..common.npz import read_result, write_result
from ..common.validation import check_types
from ..data.measurements import Measurements
from ..errors import StartError, typed_call
from ..interface.result import ESTIMATE_CLASSES, Estimate
from .action_search import Choice
from .action_space import Action, Trajectory, Workspace

FORMAT, VERSION = "exploration", 1  # of the files
ROUNDING = 1e-9  # [s] of times that were shifted
RESUMED_AFTER = 1.0  # [s] between samples of two processes


@printed
@dataclass(frozen=True, eq=False)
class Step:
    """The record of one action; number 0 is the first touch.

    number:       [1]
    action:       Action; None after a sweep
    measurements: of this action only
    estimate:     of all measurements so far; None in a file whose process ended during
                  the solve
    choice:       Choice; None where no search was made
    policy:       in words
    seconds:      [s] CPU time by name: choose, act, estimate
    told:         the trajectories that the world executed, several in a sweep
    errors:       of the estimate by name, SI, if the world has a truth
    """

    number: int
    action: Action | None
    measurements: Measurements
    estimate: Estimate | None
    choice: Choice | None
    policy: str
    seconds: dict[str, float]
    told: tuple[Trajectory, ...] = ()
    errors: dict[str, float] = field(default_factory=dict)


@printed
@typed_call()
@dataclass(frozen=True, eq=False)
class Exploration:
    """The steps of an exploration, in order, as `explore(file=...)` saves them."""

    steps: tuple[Step, ...] = ()

    def __post_init__(self):
        check_types(steps=(self.steps, tuple))
        check_types(**{f"steps[{k}]": (s, Step) for k, s in enumerate(self.steps)})

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Exploration) and same_content(self, other)

    def __hash__(self) -> int:
        return hash(tuple(step.number for step in self.steps))

    @property
    def estimate(self) -> Estimate | None:
        """The last estimate, None if there is none."""
        found = [step.estimate for step in self.steps if step.estimate is not None]
        return found[-1] if found else None

    def at(self, number: int) -> Step | None:
        """Return the step of this number, or None."""
        return next((step for step in self.steps if step.number == number), None)

    def with_step(self, step: Step) -> Exploration:
        """Return the exploration with this step; it replaces one of the same number."""
        check_types(step=(step, Step))
        others = [s for s in self.steps if s.number != step.number]
        return Exploration(tuple(sorted([*others, step], key=lambda s: s.number)))

    def replay(self, world) -> None:
        """Let a world execute the saved actions, so that it is in the state after them.

        world: a simulated one, made anew as it was before the first action; its clock
        may begin elsewhere.  Raises StartError if it measures anything else.
        """
        for step in self.steps:
            felt = [world.execute(told) for told in step.told]
            if not felt or not _alike(felt[-1], step.measurements):
                raise StartError(
                    "saved with another object or another seed",
                    where=f"step {step.number}",
                    got="other measurements", expected="those that were saved",
                    next="make the world with the object, scene and noise of this file",
                )  # fmt: skip

    def save(self, path) -> None:
        """Write one .npz: plain arrays and a JSON header."""
        write_result(path, FORMAT, VERSION, self, KINDS)

    @classmethod
    def load(cls, path) -> Exploration:
        """Read what `save` wrote, to the last digit; FileError for anything else."""
        return read_result(path, FORMAT, VERSION, KINDS, cls)


def _alike(felt: Measurements, saved: Measurements) -> bool:
    """Tell whether the same was measured; clocks and numbers may begin elsewhere."""
    if felt.samples != saved.samples:
        return False
    (a, i), (b, j) = (
        (data.time - data.time[0], data.action - data.action[0])
        for data in (felt, saved)
    )
    if np.abs(a - b).max() >= ROUNDING:
        return False
    return replace(felt, time=b, action=i) == replace(saved, time=b, action=j)


KINDS = ESTIMATE_CLASSES | {
    kind.__name__: kind
    for kind in (Exploration, Step, Action, Choice, Trajectory, Workspace)
}


def continued_in_time(step: Step, past: Measurements | None, again: bool) -> Step:
    """Return a step whose measurements begin after those of the past, checked.

    Its actions are counted on from those, or from 0, whatever a world has executed
    before.  again: the past may be of another process.  A world that was made anew
    counts time from 0: its samples are shifted to begin RESUMED_AFTER after the past.
    Raises MeasurementError if the measurements cannot be appended.
    """
    data = step.measurements
    if past is None:
        data = replace(data, action=data.action - data.action[0])
    else:
        if again and data.time[0] <= past.time[-1]:
            later = data.time - data.time[0] + past.time[-1] + RESUMED_AFTER
            data = replace(data, time=later)
        joined = past.append(data)
        data = replace(data, action=joined.action[past.samples :])
    return replace(step, measurements=data)


def load_or_new(file) -> Exploration:
    """Return the exploration of a file, an empty one if there is no file."""
    if file is None or not os.path.exists(file):
        return Exploration()
    return Exploration.load(file)


def check_same(estimate: Estimate, data: Measurements, asked: dict, file) -> None:
    """Raise StartError unless a saved estimate is of these data and settings.

    asked: the required scene, and lists of shapes and formulations, by name.  The page
    of an estimate that the time limit ended first was not solved.
    """
    for name, value in {"measurements": data, **asked}.items():
        if name == "formulation" and not estimate.success:
            continue
        saved = estimate.scene.as_told if name == "scene" else getattr(estimate, name)
        if saved not in value if isinstance(value, list) else saved != value:
            other = "other data" if name == "measurements" else f"another {name}"
            raise StartError(
                f"the saved estimate is of {other}",
                where=str(file), got=f"{name} {saved!r}", expected=repr(value),
                next="explore into another file, or with the settings of this one",
            )  # fmt: skip
