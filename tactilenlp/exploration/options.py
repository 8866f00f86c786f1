"""The settings of an exploration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from ..common.validation import check_numbers, check_types, checked_place
from ..errors import OptionError, did_you_mean, typed_call
from ..problem.options import Options
from ..problem.pages import shape_of
from ..refinement.model_selection import classes_of
from .action_space import Workspace
from .optimisers import CrossEntropy, check_search
from .policies import check_policy

POSITIONAL = 4  # settings that `explore` takes by position, after world and scene


@typed_call()
@dataclass(frozen=True, eq=False)
class ExploreOptions:
    """The settings of `explore`.

    actions:     [1], number of actions after the first touch
    policy:      "eig" (expected information gain), "random", "fisher" (information of
                 the action alone), "farthest" (from all directions so far), or a
                 function of a Plan that returns an Action
    shape:       "cuboid", "polytope", a Shape, "auto" or a list of them: every estimate
                 is of the class with the largest evidence
    seed:        [1], of all random numbers; equal seeds give equal actions
    workspace:   Workspace of the actions; None: that of the world's fingers and ground
    formulation: the page that estimates, by name or as a module
    centre:      (2,) or (3,) [m], at which the first finger aims; None: the workspace
                 is swept until a contact
    search:      of the best action: a name of choose_action, or a CrossEntropy
    budget:      [1], evaluations of the expected gain for each choice
    options:     of every estimate; None: Options()
    until:       [m], stop when the standard deviations of all sizes (vertices of a
                 polytope) are at most this; or a function of a Step; None: do not stop
    """

    actions: int = 5
    policy: str | Callable = "eig"
    shape: object = "cuboid"
    seed: int = 0
    workspace: Workspace | None = None
    formulation: object = "violation_implicit"
    centre: object = None
    search: str | CrossEntropy = "facing"
    budget: int = 180
    options: Options | None = None
    until: float | Callable | None = None

    def __post_init__(self) -> None:
        whole = (int, np.integer)
        check_types(
            workspace=(self.workspace, (Workspace, type(None))),
            options=(self.options, (Options, type(None))),
            actions=(self.actions, whole), seed=(self.seed, whole),
        )  # fmt: skip
        if not classes_of(self.shape):
            shape_of(self.shape)
        if self.centre is not None:
            checked_place("centre", self.centre)
        check_numbers("a whole number from 0", actions=(self.actions, -1, np.inf))
        check_numbers("a whole number from 0", seed=(self.seed, -1, np.inf))
        if self.until is not None and not callable(self.until):
            expected = "a standard deviation above 0 [m], or a function"
            check_numbers(expected, until=(self.until, 0, 1))
        check_search(self.search, self.budget)
        check_policy(self.policy)

    @classmethod
    def of(cls, settings, positional: tuple, keywords: dict) -> ExploreOptions:
        """Return the settings, or those of other arguments; OptionError for both."""
        names = [f.name for f in fields(cls)]
        if len(positional) > POSITIONAL:
            raise OptionError(
                "too many positional arguments", where="explore",
                got=len(positional) + 2,
                expected=f"world, scene, {', '.join(names[:POSITIONAL])}",
            )  # fmt: skip
        first = dict(zip(names, positional, strict=False))
        if twice := [name for name in first if name in keywords]:
            raise OptionError(
                "given twice", where=twice[0], got="by position and by name",
                next="leave one of them out",
            )  # fmt: skip
        keywords = first | keywords
        if unknown := [name for name in keywords if name not in names]:
            raise OptionError(
                "no such setting", where="explore", got=unknown,
                expected=f"settings, file, start, executor, or one of {names}",
                next=did_you_mean(unknown[0], names),
            )  # fmt: skip
        check_types(settings=(settings, (cls, type(None))))
        if settings is not None and keywords:
            raise OptionError(
                "settings are given twice", where="settings", got=[*keywords],
                expected="settings=ExploreOptions(...) or keyword arguments",
                next="put all of them into ExploreOptions",
            )  # fmt: skip
        return cls(**keywords) if settings is None else settings
