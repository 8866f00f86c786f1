"""Keep an exploration in one file, step by step, so that it can be taken up again."""

from __future__ import annotations

import os
from dataclasses import dataclass, field

from ..common.npz import read_result, write_result
from ..common.validation import check_types
from ..data.measurements import Measurements
from ..errors import StartError
from ..estimation.result import ESTIMATE_CLASSES, Estimate
from .action_search import Choice
from .action_space import Action, Trajectory, Workspace

FORMAT, VERSION = "exploration", 1  # of the files that are kept
OTHER = {"measurements": "other data"}  # what is said of a field that differs


@dataclass(frozen=True, eq=False)
class Step:
    """What one action brought: 0 is the first touch.

    measurements: of this action only; estimate: of all data so far, None in a file that
    was left before it was found; choice: how it was chosen, None where nothing was
    searched; policy: in words; seconds (CPU): choose, act, estimate; told: the
    trajectories that the world was given, more than one where it was swept; errors
    [SI]: how far off the estimate is, where the world knows its truth (judge.py).
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
        """Write one .npz: plain arrays and a JSON header, readable without us."""
        write_result(path, FORMAT, VERSION, self, KINDS)

    @classmethod
    def load(cls, path) -> Exploration:
        """Read what `save` wrote, to the last digit; FileError of anything else."""
        return read_result(path, FORMAT, VERSION, KINDS, cls)


KINDS = ESTIMATE_CLASSES | {
    kind.__name__: kind
    for kind in (Exploration, Step, Action, Choice, Trajectory, Workspace)
}


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
