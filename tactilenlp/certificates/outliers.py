"""Tell what the touches that an estimate does not explain contradict.

How many unexplained ones (`unexplained` in problem/fingertips.py) contradict an
assumption depends on what that is:

a touch     MIN_OF_TOUCH samples of a finger in an action (a wrong boolean is fewer)
sliding     MIN_OF_ACTION samples and the share SHARE_OF_ACTION of one action
planar      MIN_OF_PLANAR samples and the share PLANAR_LIMIT of one action, or the share
            PLANAR_TOTAL of all: a wrong mode also leaves some samples unexplained, an
            object that tumbled leaves most of an action so
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from formulations.names import (
    INDENTATION,
    NORMAL_SCALE,
    TOUCH_SCALE,
)
from formulations.violation_implicit import TOUCH

from ..data.contact_segments import SIDE_NORMAL
from ..errors import MotionError
from ..information.measurement_noise import aligned_normals
from ..local.solved import Solved
from ..problem.fingertips import moved, unexplained
from ..problem.job import Job
from ..problem.pages import page_of
from ..problem.window import Window

NORMAL_ERROR = 0.015  # [rad] of a touch model
MIN_OF_TOUCH = 3  # samples
MIN_OF_ACTION, SHARE_OF_ACTION = 2, 0.2  # samples, [-]
MIN_OF_PLANAR, PLANAR_LIMIT, PLANAR_TOTAL = 4, 0.6, 0.25  # samples, [-], [-]


@dataclass(frozen=True)
class Evidence:
    """The evidence against planar sliding in one action.

    touches: touched samples; unexplained: how many of them no planar pose explains;
    tilt [rad]: the largest angle of a side's normal above the ground.
    """

    action: int
    touches: int
    unexplained: int
    tilt: float

    @property
    def against(self) -> bool:
        """Whether the object did something else than slide."""
        return (
            self.unexplained >= MIN_OF_ACTION
            and self.unexplained > SHARE_OF_ACTION * self.touches
        )


def with_ideal_fingertips(solved: Solved) -> Window:
    """Return the window of a solved page as rigid and aligned fingertips would feel it.

    Normals are turned back by the turns that were found; the indentation that the page
    reports moves a finger out along them.
    """
    window, problem, solution = solved.window, solved.problem, solved.solution
    touch = window.touch
    p_wf, n = touch.p_wf, aligned_normals(touch, solution.values)
    if INDENTATION in problem.reports:
        x, data = solution.at(problem)
        p_wf = moved(p_wf, problem.value(INDENTATION, x, data) * n)
    return replace(window, touch=replace(touch, p_wf=p_wf, normal=n))


def unexplained_by_action(job: Job, solved: Solved) -> list[Evidence]:
    """Return what flat motion leaves unexplained in every action that touched.

    solved: a flat solution, of whatever page.
    """
    window, values = with_ideal_fingertips(solved), solved.solution.values
    page = page_of("quasi_static", job.shape)
    problem = replace(job, page=page).build(window)
    shared = {name: values[name] for name in problem.variables if name in values}
    scale = {
        TOUCH_SCALE: np.hypot(TOUCH, window.sigma_position),
        NORMAL_SCALE: np.hypot(NORMAL_ERROR, window.sigma_normal),
    }
    wrong = unexplained(problem, window, problem.pack(shared), problem.data(scale))
    action = job.data.action[window.touch.sample]
    return [
        Evidence(
            int(a), int((action == a).sum()), int(wrong[action == a].sum()),
            side_tilt(window.touch.normal[action == a]).max(initial=0.0),
        )
        for a in np.unique(action)
    ]  # fmt: skip


def planar_share(evidence) -> float:
    """Return the largest share of an action's touches that planar motion leaves open.

    The share of all actions counts in units of PLANAR_TOTAL / PLANAR_LIMIT.
    """
    touches = max(1, sum(e.touches for e in evidence))
    wrong = sum(e.unexplained for e in evidence)
    most = [e for e in evidence if e.unexplained >= MIN_OF_PLANAR]
    shares = [e.unexplained / e.touches for e in most]
    return max([*shares, wrong / touches * PLANAR_LIMIT / PLANAR_TOTAL])


def check_explained(solved: Solved, estimate) -> None:
    """Raise MotionError where touches of a floating object are left unexplained.

    estimate: what the error has, of the same solve.
    """
    evidence = unexplained_by_action(solved.job, solved)
    wrong = [e for e in evidence if e.against]
    if wrong:
        raise MotionError(
            "the motion of the floating object was not found",
            where=f"touch, actions {[e.action for e in wrong]}",
            got=f"{sum(e.unexplained for e in wrong)} touches not explained",
            expected=f"at most {sum(e.touches for e in wrong) * SHARE_OF_ACTION:.0f}",
            next="give start=Guess(...), select fewer actions, or pass throw=False to "
            "look at the estimate",
            problem=solved.problem.describe(),
            solution=solved.solution,
            estimate=estimate,
        )


def side_tilt(n) -> np.ndarray:
    """Return the angles (n,) [rad] of side normals above the ground, else 0."""
    side = np.abs(n[:, 2]) < SIDE_NORMAL
    return np.where(side, np.arctan2(n[:, 2], np.hypot(n[:, 0], n[:, 1])), 0.0)
