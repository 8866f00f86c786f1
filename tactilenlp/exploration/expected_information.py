r"""Compute the expected information gain of an action (eq:eig), in nats.

The body of every kept hypothesis is pushed forward by the planned fingers (page
`pushing`), the slopes of its way by theta and x_T are carried along by the implicit
function theorem, and each sample's Fisher information (page `exploration`) is summed.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from formulations.friction import FRICTION
from formulations.polytope import polytope
from formulations.pushed_hull import as_pushed
from formulations.rigid_body import PLANAR
from formulations.shape import Shape

from ..common.validation import check_sample, check_types
from ..errors import OptionError
from ..information.information import information_gain
from ..problem.pages import shape_of
from .action_space import Action, Workspace
from .beliefs import Belief, believed, freely, sensors
from .polytope_beliefs import hull_believed, hull_sensors
from .push_model import check_ground, check_moves, pushed

GRAVITY_FREE = 9.81  # [m/s^2] makes a weight where nothing falls
CONTACT_RANGE = (
    0.01  # [m] a finger further off than this feels nothing and pushes nothing
)
STEPS_PER_BLOCK = (
    5  # steps: a prediction takes a multiple of these, so that few are built
)
LEAST_FRICTION = 0.02  # [1] without any friction, a pushed body would not stop


@dataclass(frozen=True, eq=False)
class Prospect:
    """What an action is predicted to do, n samples, from one hypothesis.

    motion (n, 3): planar way of the body since now [m, m, rad]; contact (n, F): the
    probability that a finger feels it; information (k, k): of theta and x_T, SI.
    """

    motion: np.ndarray
    contact: np.ndarray
    information: np.ndarray


class ExpectedInformation:
    """Compute the expected information gain of actions, in nats.

    estimate: an Estimate; workspace: what the fingers can do; hypotheses: how many of
    the estimate's are averaged over, weighted by exp(-objective); slopes: "motion", of
    the predicted way, or "identity", dx_t/dx_T = I as in the paper; shape: the Shape of
    the estimate where it is one of your own.

    Of a polytope the gain is about its vertices where they lie now, the final pose
    with them.  The information on them is that of polytope_beliefs.py: a ball
    before any touch, planes where faces were touched.
    """

    def __init__(
        self,
        estimate,
        workspace: Workspace | None = None,
        hypotheses: int = 3,
        slopes: str = "motion",
        shape: Shape | None = None,
    ) -> None:
        _check(estimate, workspace, hypotheses, slopes, shape)
        check_ground(estimate.scene)
        self.workspace = workspace or Workspace(ground=estimate.scene.ground)
        self.estimate, self._sloped = estimate, float(slopes == "motion")
        self.shape = shape_seen(estimate, shape)
        check_moves(self.shape)
        self._off = estimate.finger_offset is not None
        self._check_fingers(self.workspace)
        if self.shape.parameters == "vertices":
            self._free, self._sensors = False, hull_sensors(estimate)
            self.beliefs = hull_believed(estimate, self.shape)
        else:
            self._free, self._sensors = freely(estimate, self.shape), sensors(estimate)
            fingers = self.workspace.fingers
            self.beliefs = believed(estimate, self.shape, fingers, hypotheses)
        self._known = _known(estimate.scene, self.workspace)

    @property
    def target(self) -> np.ndarray:
        """Where actions aim (3,) [m], world: the centroid of the best hypothesis."""
        return self.estimate.position[-1]

    def gain(self, action: Action) -> float:
        """Return the expected information gain in nats, over the hypotheses."""
        gains = [
            information_gain(b.information, self._ahead(b, action)[2], len(b.z))
            for b in self.beliefs
        ]
        return float(np.dot([b.weight for b in self.beliefs], gains))

    def prospect(self, action: Action, hypothesis: int = 0) -> Prospect:
        """Return what the action is predicted to do, from one hypothesis."""
        check_sample(hypothesis, len(self.beliefs), "hypothesis")
        b = self.beliefs[hypothesis]
        motion, contact, F = self._ahead(b, action)
        return Prospect(motion, contact, F[: len(b.z), : len(b.z)])

    def _ahead(self, belief: Belief, action: Action):
        """Return its way (n, 3), contacts (n, F) and what they tell (k, k)."""
        check_types(action=(action, Action))
        space, k = action.workspace, len(belief.information)
        self._check_fingers(space)
        n = max(1, round(space.duration / self.estimate.measurements.dt))
        path = action.positions(self.target, n + 1)
        path = self.estimate.scene.ground.to_ground(path) + belief.shift
        near, F = self._near(belief, path, space), space.fingers
        r = path[n - near :].reshape(near + 1, -1).T
        step = pushed(self.shape, self._free, F, near, self._off)
        rest = np.zeros(3), r[:, 0], np.zeros(3), np.zeros((3, k)), np.zeros((3, 3))
        _, _, s, _, _, p, E = step(
            *rest, belief.z, r[:, :-1], r[:, 1:],
            np.full(F, space.finger_radius), self._known, self._sensors, self._sloped,
        )  # fmt: skip
        motion, contact = np.zeros((n, 3)), np.zeros((n, F))
        motion[n - near :], contact[n - near :] = s.full().T, p.full().T
        E = E.full().reshape(4 * F, near, k)
        return motion, contact, np.einsum("ftk,ftl->kl", E, E)

    def _near(self, belief: Belief, path, space) -> int:
        """Return how many last steps of a path (n + 1, F, 3) come near the body."""
        n, theta = len(path) - 1, belief.z[: self.shape.theta]
        pose, centre = belief.z[len(theta) :], np.zeros(3)
        centre[: len(pose)] = pose[:3]
        if len(pose) == len(PLANAR.scale):  # of a hull, there is none
            centre[2] = float(self.shape.rest_height(ca.DM(theta)))
        reach = self.shape.reach(theta) + space.finger_radius + CONTACT_RANGE
        away = np.linalg.norm(path - centre, axis=2).min(axis=1)
        left = n - np.argmax(away[1:] < reach) if (away[1:] < reach).any() else 1
        return min(n, STEPS_PER_BLOCK * -(-left // STEPS_PER_BLOCK))

    def _check_fingers(self, space: Workspace) -> None:
        """Raise OptionError where the offsets known are those of other fingers."""
        fingers = self.estimate.measurements.fingers if self._off else space.fingers
        if space.fingers != fingers:
            raise OptionError(
                "the offsets that the estimate knows are of other fingers",
                where="workspace.fingers",
                got=space.fingers,
                expected=f"{fingers}, as were measured",
                next="plan with these, or estimate without Scene.sigma_offset",
            )


def shape_seen(estimate, shape: Shape | None = None) -> Shape:
    """Return the shape of an estimate as the page `pushing` takes it."""
    shape = shape_of(estimate.shape) if shape is None else shape
    if shape.parameters != "vertices":
        return shape
    return as_pushed(polytope(len(estimate.theta) // 3))


def _check(estimate, workspace, hypotheses, slopes, shape) -> None:
    """Raise OptionError for what no gain can be computed with."""
    none = type(None)
    check_types(
        estimate=(estimate, "Estimate"), workspace=(workspace, (Workspace, none)),
        slopes=(slopes, str), shape=(shape, (Shape, none)),
    )  # fmt: skip
    if slopes not in ("motion", "identity"):
        expected = "'motion' or 'identity'"
        raise OptionError("unknown", where="slopes", got=slopes, expected=expected)
    if not (isinstance(hypotheses, int) and hypotheses >= 1):
        expected = "an integer >= 1"
        raise OptionError(
            "out of range", where="hypotheses", got=hypotheses, expected=expected
        )
    if shape is not None and shape.name != estimate.shape:
        raise OptionError(
            "another shape", where="shape", got=shape.name, expected=estimate.shape
        )


def expected_information_gain(
    estimate,
    action: Action,
    *,
    hypotheses: int = 3,
    slopes: str = "motion",
    shape: Shape | None = None,
) -> float:
    """Return EIG = (logdet(I + F) - logdet(I)) / 2 of an action, in nats (eq:eig).

    It aims at the estimated centroid.  See ExpectedInformation for the options, and use
    that to ask for many actions of one estimate.
    """
    check_types(action=(action, Action))
    given = estimate, action.workspace, hypotheses, slopes, shape
    return ExpectedInformation(*given).gain(action)


def _known(scene, space: Workspace) -> np.ndarray:
    """Return mu_g, mu_f, weight [N], stiffness [N/m], max_force [N]."""
    ground = FRICTION if scene.friction_ground is None else scene.friction_ground
    finger = FRICTION if scene.friction_finger is None else scene.friction_finger
    weight = scene.mass * (scene.gravity or GRAVITY_FREE)
    ground = max(ground, LEAST_FRICTION)
    return np.array([ground, finger, weight, space.stiffness, space.max_force])
