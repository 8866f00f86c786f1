"""What a solve may begin with: a guess, term functions of earlier solves."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from ..common.brief import printed
from ..common.validation import check_range, checked_place, numbers_of
from ..data.measurements import FARTHEST
from ..errors import StartError, typed_call

MAX_YAW = 2 * np.pi  # [rad] of a guess


@printed
@typed_call()
@dataclass(frozen=True, eq=False)
class Guess:
    """What a user thinks the object is: size and pose at the first sample.

    side_lengths: (3,) [m], or as many sizes as the shape has
    position:     (2,) on the ground or (3,) [m], world frame
    yaw:          [rad], about the ground's normal, ground frame

    Raises StartError.
    """

    side_lengths: np.ndarray
    position: np.ndarray
    yaw: float = 0.0

    def __post_init__(self) -> None:
        of_sizes = "start.side_lengths", self.side_lengths, StartError, "n"
        sides = numbers_of(*of_sizes, unit="[m]", positive=True)
        place = checked_place("start.position", self.position, StartError, FARTHEST)
        check_range("start.yaw", self.yaw, -MAX_YAW, MAX_YAW, "[rad]", StartError)
        object.__setattr__(self, "side_lengths", sides)
        object.__setattr__(self, "position", place)
        object.__setattr__(self, "yaw", float(self.yaw))


class Session:
    """Keep the term functions that estimates were solved with; mutable.

    A solve that starts from an estimate of the same session, scene, shape and page
    reuses them instead of deriving them again.  The caller owns a session and passes it
    to `solve_estimate`; without one, solves share PROCESS.  A session holds estimates
    by weak references: what belongs to an estimate is dropped together with it.
    """

    def __init__(self):
        self._by_origin = WeakKeyDictionary()

    def functions_for(self, start, scene, shape, page) -> dict:
        """Return the term functions of the estimate `start`; new ones of any other."""
        if getattr(start, "origin", None) not in self._by_origin:
            return {}
        solved_as, functions = self._by_origin[start.origin]
        same = solved_as == _solved_as(scene, shape, page)
        return functions if same else {}

    def keep(self, estimate, job) -> None:
        """Keep the term functions of a job for solves that start from its estimate."""
        solved_as = _solved_as(job.scene, job.shape, job.page)
        self._by_origin[estimate.origin] = solved_as, job.functions


def _solved_as(scene, shape, page) -> tuple:
    """Return what term functions depend on.

    A page that was edited and reloaded has another `build`; a constant or a function of
    its module, or of a shipped page, may have been replaced as well.
    """
    name = getattr(page.build, "__module__", None)
    used = [n for n in sys.modules if n == name or n.startswith("formulations.")]
    edited = [
        (key, value if isinstance(value, (int, float, str)) else id(value))
        for n in sorted(used) for key, value in vars(sys.modules[n]).items()
    ]  # fmt: skip
    return scene.as_told, shape, page.build, tuple(edited)


PROCESS = Session()  # the default session: one in every process
