"""Tell which touches say that an object did something else than slide."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import MotionError
from ..nlp.problem import Problem
from .pages import page_of
from .reductions import SIDE

TOUCH, NORMAL = 0.15e-3, 0.015  # [m], [rad] model errors of a touch of a rigid object
WRONG = 0.8  # [outlier costs] a touch that costs more is not explained
TWO, SHARE = 2, 0.2  # so many touches, and this part of an action's, are no accident


@dataclass(frozen=True)
class Evidence:
    """What speaks against sliding in one action.

    touches: how many; unexplained: how many of them no flat pose explains; tilt [rad]:
    how far the normals of a side rise.
    """

    action: int
    touches: int
    unexplained: int
    tilt: float

    @property
    def against(self) -> bool:
        """Whether the object did something else than slide."""
        return self.unexplained >= TWO and self.unexplained > SHARE * self.touches


def contradicts(job, window, values) -> list[Evidence]:
    """Return the evidence against flat motion in every action that touched.

    values: theta and x of a flat solution, of whatever page.
    """
    page = page_of("quasi_static", job.shape)
    problem = Problem(kinds=job.kinds_of(page, window))
    page.build(problem, window, job.scene, job.shape)
    known = {name: values[name] for name in problem.variables if name in values}
    scale = {
        "touch scale": np.hypot(TOUCH, window.sigma_position),
        "normal scale": np.hypot(NORMAL, window.sigma_normal),
    }
    cost = problem.value("touch", problem.pack(known), problem.data(scale))[:, 0]
    wrong = cost > WRONG * window.outlier_cost
    action = job.data.action[window.touch.sample]
    return [
        Evidence(
            int(a), int((action == a).sum()), int(wrong[action == a].sum()),
            tilt_of(window.touch.normal[action == a]).max(initial=0.0),
        )
        for a in np.unique(action)
    ]  # fmt: skip


def check_explained(solved) -> None:
    """Raise MotionError where touches of a floating object are left unexplained."""
    evidence = contradicts(solved.job, solved.window, solved.solution.values)
    wrong = [e for e in evidence if e.against]
    if wrong:
        raise MotionError(
            "the motion of the floating object was not found",
            where=f"touch, actions {[e.action for e in wrong]}",
            got=f"{sum(e.unexplained for e in wrong)} touches not explained",
            expected=f"at most {sum(e.touches for e in wrong) * SHARE:.0f}",
            next="give start=Guess(...), select fewer actions, or pass throw=False to "
            "look at the estimate",
            problem=solved.problem.describe(),
            solution=solved.solution,
        )


def tilt_of(n) -> np.ndarray:
    """Return how far side normals (n, 3) rise [rad]; 0 for those of other faces."""
    side = np.abs(n[:, 2]) < SIDE
    return np.where(side, np.arctan2(n[:, 2], np.hypot(n[:, 0], n[:, 1])), 0.0)
