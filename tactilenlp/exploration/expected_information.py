r"""The expected information gain of an action about shape and final pose (eq:eig).

For every hypothesis, the planned fingers push the body forward (page `pushing`).  The
derivatives of its motion by theta and x_T follow by the implicit function theorem.  The
Fisher information of each sample (page `exploration`) is summed.  A gain is weighed by
the probability that the body slides and does not tip (geometry/support.py).
Gains are in nats.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from formulations.friction import FRICTION_MEAN
from formulations.names import FINGER_FRICTION, GROUND_FRICTION
from formulations.shape import Shape

from ..common.brief import printed
from ..common.threads import on_one_thread
from ..common.validation import (
    check_one_of,
    check_sample,
    check_types,
    check_whole,
)
from ..errors import OptionError, typed_call
from ..geometry.support import Standing
from ..information.comparisons import information_gain
from ..problem.pages import shape_of
from ..tracking.standing import standing_of
from ..tracking.surface import pose_of
from . import beliefs, polytope_beliefs
from .action_space import Action, Workspace, workspace_of
from .beliefs import Belief, has_free_poses
from .push_model import check_predictable, check_workspace, push_function

log = logging.getLogger("tactilenlp")
WEIGHTLESS_GRAVITY = 9.81  # [m/s^2] of the predicted friction where there is none
NEAR_DISTANCE = 0.01  # [m] a finger farther away is not in contact
STEP_MULTIPLE = 5  # steps of a prediction are a multiple: few functions are compiled
MIN_GROUND_FRICTION = 0.02  # [1]: without any friction a pushed body does not stop
# [m] of a predicted centre of pressure: of 720 pushes of known bodies 41 of 94 tip that
# are predicted to (margin below 0), 3 of 53 up to 2 mm within, none of 573 farther in.
MARGIN_SIGMA = 2e-3


@printed
@dataclass(frozen=True, eq=False)
class Prospect:
    """The predicted outcome of an action from one hypothesis, n samples.

    motion:      (n, 3) [m, m, rad], planar displacement of the body since now
    contact:     (n, F) [1], probability of a contact
    information: (k, k), SI, of theta and x_T
    margin:      (n,) [m], how far the centre of pressure is within the polygon on which
                 the body stands: it tips where this is negative; infinite of bodies
                 that roll
    deviation:   (n,) [m], of the margin
    """

    motion: np.ndarray
    contact: np.ndarray
    information: np.ndarray
    margin: np.ndarray
    deviation: np.ndarray

    @property
    def chance_to_slide(self) -> float:
        """The probability [1] that the body slides all the way and does not tip."""
        return float(ndtr((self.margin / self.deviation).min()))


class ExpectedInformation:
    """Expected information gains of actions after an estimate.

    estimate:   an Estimate
    workspace:  Workspace of the actions; None: the default above the scene's ground,
                with as many and as large fingers as the measurements have
    hypotheses: [1], number of hypotheses averaged over, weighted by exp(-objective)
    slopes:     dx_t/dx_T: "motion", of the predicted motion, or "identity" as in the
                paper
    shape:      the Shape of the estimate if it is your own

    For a polytope the gain is about its vertices in the world frame, which include the
    final pose, and about corners that no finger felt; see polytope_beliefs.py.  Raises
    OptionError, SceneError.
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
        shape = shape or shape_of(estimate.shape)
        self.shape = shape.pushed(shape, len(estimate.theta))
        check_predictable(estimate.scene, self.shape)
        radius, ground = estimate.measurements.finger_radius, estimate.scene.ground
        self.workspace = workspace or workspace_of(radius, ground)
        check_workspace(self.workspace, estimate.scene, radius)
        if estimate.scene.finger_length:
            log.warning(
                "actions are predicted with spherical fingertips: capsules meet a body "
                "earlier than that"
            )
        self.estimate, self._sloped = estimate, float(slopes == "motion")
        self._off = estimate.finger_offset is not None
        self._check_fingers(self.workspace)
        self._free = has_free_poses(estimate, self.shape)
        if self.shape.of_vertices:
            self._sensors = polytope_beliefs.hull_sensor_model(estimate)
            self.beliefs = [polytope_beliefs.belief_of(estimate, shape)]
            self.shape = shape.pushed(shape, len(self.beliefs[0].z))
        else:
            self._sensors = beliefs.sensor_model(estimate)
            self.beliefs = beliefs.beliefs_of(
                estimate, self.shape, self.workspace.fingers, hypotheses
            )
        theta = self.shape.theta
        reach = max(self.shape.reach(b.z[:theta]) for b in self.beliefs)
        self.workspace = self.workspace.around(reach)
        self._standing = [self._standing_of(b) for b in self.beliefs]

    @property
    def target(self) -> np.ndarray:
        """Where actions aim (3,) [m], world: the centroid of the best hypothesis."""
        return self.estimate.position[-1]

    def gain(self, action: Action) -> float:
        """Return the expected information gain in nats, over the hypotheses.

        Of a body that tips nothing is counted: where it then lies, no push tells.
        """
        gains = []
        for i, b in enumerate(self.beliefs):
            ahead = self._ahead(i, action)
            told = information_gain(b.information, ahead.information, len(b.z))
            gains.append(b.weight * ahead.chance_to_slide * told)
        return float(sum(gains))

    def prospect(self, action: Action, hypothesis: int = 0) -> Prospect:
        """Return the predicted outcome of the action, from one hypothesis."""
        check_sample(hypothesis, len(self.beliefs), "hypothesis")
        ahead, k = self._ahead(hypothesis, action), len(self.beliefs[hypothesis].z)
        return replace(ahead, information=ahead.information[:k, :k])

    def _ahead(self, hypothesis: int, action: Action) -> Prospect:
        """Return the prospect, its information with that of unknown offsets."""
        check_types(action=(action, Action))
        belief, space = self.beliefs[hypothesis], action.workspace
        k = len(belief.information)
        self._check_fingers(space)
        n = max(1, round(space.duration / self.estimate.measurements.dt))
        path = action.positions(self.target, n + 1)
        path = self.estimate.scene.ground.to_ground(path) + belief.shift
        near, F = self._near(belief, path, space), space.fingers
        r = path[n - near :].reshape(near + 1, -1).T
        step = push_function(self.shape, self._free, F, near, self._off)
        radii = self.estimate.measurements.finger_radius  # of other fingers: all alike
        radii = radii if len(radii) == F else np.full(F, space.finger_radius)
        constants = push_constants(self.estimate, space)
        weight = constants[2]
        rest = np.zeros(3), r[:, 0], np.zeros(3), np.zeros((3, k)), np.zeros((3, 3))
        _, _, s, _, _, p, E, wrench = step(
            *rest, belief.z, r[:, :-1], r[:, 1:],
            radii, constants, self._sensors, self._sloped,
        )  # fmt: skip
        motion, contact = np.zeros((n, 3)), np.zeros((n, F))
        motion[n - near :], contact[n - near :] = s.full().T, p.full().T
        margin, deviation = np.full(n, np.inf), np.full(n, MARGIN_SIGMA)
        if standing := self._standing[hypothesis]:
            room, sigma = standing.margin(motion[n - near :], wrench.full().T, weight)
            margin[n - near :] = room
            deviation[n - near :] = np.hypot(sigma, MARGIN_SIGMA)
        E = E.full().reshape(4 * F, near, k)
        told = np.einsum("ftk,ftl->kl", E, E)
        return Prospect(motion, contact, told, margin, deviation)

    def _standing_of(self, belief: Belief) -> Standing | None:
        """Return a belief as a body that stands; None of one that rolls."""
        centre, ground = self.estimate.centre_of_mass, self.estimate.scene.ground
        if self.shape.of_vertices:
            return polytope_beliefs.standing_hull_of(belief, ground.rotation @ centre)
        if self.shape.rolls:
            return None
        return standing_of(self.shape, belief.z, belief.covariance, centre)

    def _near(self, belief: Belief, path, space) -> int:
        """Return how many last steps of a path (n + 1, F, 3) are near the body."""
        n, (theta, x) = len(path) - 1, np.split(belief.z, [self.shape.theta])
        # Vertices have no pose: they are about their centroid.
        centre = pose_of(self.shape, theta, x)[0] if len(x) else np.zeros(3)
        reach = self.shape.reach(theta) + space.finger_radius + NEAR_DISTANCE
        away = np.linalg.norm(path - centre, axis=2).min(axis=1)
        left = n - np.argmax(away[1:] < reach) if (away[1:] < reach).any() else 1
        return min(n, STEP_MULTIPLE * -(-left // STEP_MULTIPLE))

    def _check_fingers(self, space: Workspace) -> None:
        """Raise OptionError if the estimated offsets are of other fingers."""
        fingers = self.estimate.measurements.fingers if self._off else space.fingers
        if space.fingers != fingers:
            raise OptionError(
                "the estimated finger offsets are of another number of fingers",
                where="workspace.fingers",
                got=space.fingers,
                expected=f"{fingers}, as in the measurements",
                next="plan with as many, or estimate without Scene.sigma_offset",
            )


def _check(estimate, workspace, hypotheses, slopes, shape) -> None:
    """Raise OptionError for unusable arguments."""
    none = type(None)
    check_types(
        estimate=(estimate, "Estimate"), workspace=(workspace, (Workspace, none)),
        shape=(shape, (Shape, none)),
    )  # fmt: skip
    check_one_of("slopes", slopes, ("motion", "identity"), "unknown")
    check_whole("hypotheses", hypotheses, 1, np.inf)
    if shape is not None and shape.name != estimate.shape:
        raise OptionError(
            "another shape", where="shape", got=shape.name, expected=estimate.shape
        )


@typed_call()
@on_one_thread
def expected_information_gain(
    estimate,
    action: Action,
    *,
    hypotheses: int = 3,
    slopes: str = "motion",
    shape: Shape | None = None,
) -> float:
    """Return EIG = (logdet(I + F) - logdet(I)) / 2 of an action, in nats (eq:eig).

    The action aims at the estimated centroid.  hypotheses: how many are averaged over;
    slopes: "motion" or "identity"; shape: the Shape of the estimate if it is your own.
    For many actions of one estimate, and for what is raised, see ExpectedInformation.
    """
    check_types(action=(action, Action))
    space = action.workspace
    return ExpectedInformation(estimate, space, hypotheses, slopes, shape).gain(action)


def push_constants(estimate, space: Workspace) -> np.ndarray:
    """Return mu_g, mu_f, weight [N], stiffness [N/m], max_force [N]."""
    scene = estimate.scene
    ground = _friction(estimate, GROUND_FRICTION, scene.friction_ground)
    finger = _friction(estimate, FINGER_FRICTION, scene.friction_finger)
    weight = scene.mass * (scene.gravity or WEIGHTLESS_GRAVITY)
    ground = max(ground, MIN_GROUND_FRICTION)
    return np.array([ground, finger, weight, space.stiffness, space.max_force])


def _friction(estimate, name: str, told: float | None) -> float:
    """Return a friction coefficient: told, estimated, or the mean of its prior."""
    if told is not None:
        return told
    return float(np.ravel(estimate.unknowns.get(name, FRICTION_MEAN))[0])
