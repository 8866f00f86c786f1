"""Keep an exploration in one file, step by step, so that it can be taken up again."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryFile

from ..common.npz import check_folder, read_result, write_result
from ..common.validation import check_types
from ..data.measurements import Measurements
from ..errors import FileError, StartError
from ..estimation.result import ESTIMATE_CLASSES, Estimate
from .action_search import Choice
from .action_space import Action, Trajectory, Workspace

FORMAT, VERSION = "exploration", 1  # of the files that are kept
GAP_BETWEEN_PROCESSES = (
    1.0  # [s] between the last kept sample and the first one of another process
)
SPACE = 10e6  # [bytes] that are free where an exploration is to be kept
OTHER = {"measurements": "other data"}  # what is said of a field that differs


@dataclass(frozen=True, eq=False)
class Step:
    """What one action brought: 0 is the first touch.

    measurements: of this action only; estimate: of all data so far, None in a file that
    was left before it was found; choice: how it was chosen, None where nothing was
    searched; policy: in words; seconds (CPU): choose, act, estimate; told: the
    trajectories that the world was given, more than one where it was swept; errors
    [SI]: how far off the estimate is, where the world knows its truth (`ground_truth`).
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


@dataclass(frozen=True, eq=False)
class Exploration:
    """The steps of an exploration, in order, as `explore(file=...)` keeps them."""

    steps: tuple[Step, ...] = ()

    def __post_init__(self):
        check_types(steps=(self.steps, tuple))
        check_types(**{f"steps[{k}]": (s, Step) for k, s in enumerate(self.steps)})

    @property
    def estimate(self) -> Estimate | None:
        """The last estimate, of all data that it was made of; None if there is none."""
        found = [step.estimate for step in self.steps if step.estimate is not None]
        return found[-1] if found else None

    def at(self, number: int) -> Step | None:
        """Return the step of this number, or None."""
        return next((step for step in self.steps if step.number == number), None)

    def with_step(self, step: Step) -> Exploration:
        """Return the exploration with this step in place of its number's, or added."""
        check_types(step=(step, Step))
        others = [s for s in self.steps if s.number != step.number]
        return Exploration(tuple(sorted([*others, step], key=lambda s: s.number)))

    def save(self, path) -> None:
        """Write one .npz: plain arrays and a JSON header, without pickles."""
        write_result(path, FORMAT, VERSION, self, KINDS)

    @classmethod
    def load(cls, path) -> Exploration:
        """Read what `save` wrote, to the last digit; FileError of anything else."""
        return read_result(path, FORMAT, VERSION, KINDS, cls)


KINDS = ESTIMATE_CLASSES | {
    kind.__name__: kind
    for kind in (Exploration, Step, Action, Choice, Trajectory, Workspace)
}


def onward(step: Step, past: Measurements | None, again: bool) -> Step:
    """Return a step whose measurements go on after those of the past, checked.

    again: the past may be of another process.  The world was then made anew and counts
    time from zero again: the step is moved so that it begins PAUSE after the past.
    Raises MeasurementError where the measurements cannot be appended.
    """
    data = step.measurements
    if past is None:
        return step
    if again and data.time[0] <= past.time[-1]:
        data = replace(
            data, time=data.time - data.time[0] + past.time[-1] + GAP_BETWEEN_PROCESSES
        )
        step = replace(step, measurements=data)
    past.append(data)
    return step


def check_file(file) -> None:
    """Raise FileError unless an exploration can be kept in this file."""
    check_folder(file, str(file))
    folder = Path(file).absolute().parent
    try:
        with TemporaryFile(dir=folder):
            free = shutil.disk_usage(folder).free
    except OSError as bad:
        raise FileError(
            "cannot be written", where=str(file), got=f"{type(bad).__name__}: {bad}",
            expected="a folder in which files can be made", next="write elsewhere",
        ) from bad  # fmt: skip
    if free < SPACE:
        raise FileError(
            "too little space", where=str(file), got=f"{free / 1e6:.1f} MB",
            expected=f"{SPACE / 1e6:.0f} MB or more", next="write elsewhere",
        )  # fmt: skip


def taken_up(file) -> Exploration:
    """Return the exploration that a file keeps; an empty one where there is no file."""
    if file is None or not os.path.exists(file):
        return Exploration()
    return Exploration.load(file)


def check_same(estimate: Estimate, data: Measurements, asked: dict, file) -> None:
    """Raise StartError unless a kept estimate is of these data and of what is asked.

    asked: what its scene, shape and formulation are to be.
    """
    for name, value in {"measurements": data, **asked}.items():
        kept = getattr(estimate, name)
        if kept != value:
            raise StartError(
                f"the kept estimate is of {OTHER.get(name, f'another {name}')}",
                where=str(file), got=f"{name} {kept!r}", expected=repr(value),
                next="explore into another file, or ask for what this one is of",
            )  # fmt: skip
