r"""What an action is expected to tell of shape and final pose (eq:eig), in nats.

The body of every kept hypothesis is pushed forward by the planned fingers (page
`pushing`), the slopes of its way by theta and x_T are carried along by the implicit
function theorem, and each sample's Fisher information (page `exploration`) is summed.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np

from formulations import quasi_static, violation_implicit
from formulations.friction import FRICTION

from .checks import check_sample, check_types
from .errors import OptionError
from .hypothesis import Hypothesis, distinct
from .kind import mapped
from .nats import information_gain
from .offset import prior_of_offsets
from .predict import check_ground, check_moves, pushed, sampled
from .request import shape_of
from .workspace import Action, Workspace

log = logging.getLogger("tactilenlp")

RATE = 30  # [Hz] of the samples, as the record
GRAVITY_FREE = 9.81  # [m/s^2] makes a weight where nothing falls
SLIPPERY = 0.02  # [1] at least: without any friction a push has no end
VAGUE = 0.1, 3.0  # [m], [rad] of a pose of which nothing is known
NEGLIGIBLE = 0.02  # [-] of the best's weight: a hypothesis that is not followed


@dataclass(frozen=True, eq=False)
class Prospect:
    """What an action is predicted to do, n samples, from one hypothesis.

    motion (n, 3): planar way of the body since now [m, m, rad]; contact (n, F): the
    probability that a finger feels it; information (k, k): of theta and x_T, SI.
    """

    motion: np.ndarray
    contact: np.ndarray
    information: np.ndarray


@dataclass(frozen=True, eq=False)
class Belief:
    """One hypothesis: theta and x_T (k,), what is known of them, its weight.

    offset (F, 3) [m]: of the fingers; where that is unknown, information (k + 3 F,
    k + 3 F) is about it, too.
    """

    z: np.ndarray
    information: np.ndarray
    weight: float
    offset: np.ndarray


class ExpectedInformation:
    """Tell of any action what it is expected to tell, in nats.

    estimate: an Estimate; workspace: what the fingers can do; hypotheses: how many of
    the estimate's are averaged over, weighted by exp(-objective); slopes: "motion", of
    the predicted way, or "identity", dx_t/dx_T = I as in the paper.
    """

    def __init__(
        self,
        estimate,
        workspace: Workspace | None = None,
        hypotheses: int = 3,
        slopes: str = "motion",
    ) -> None:
        check_types(
            estimate=(estimate, "Estimate"),
            workspace=(workspace, (Workspace, type(None))),
            slopes=(slopes, str),
        )
        if slopes not in ("motion", "identity"):
            expected = "'motion' or 'identity'"
            raise OptionError("unknown", where="slopes", got=slopes, expected=expected)
        if not (isinstance(hypotheses, int) and hypotheses >= 1):
            expected = "an integer >= 1"
            raise OptionError(
                "out of range", where="hypotheses", got=hypotheses, expected=expected
            )
        check_ground(estimate.scene)
        self.workspace = workspace or Workspace(ground=estimate.scene.ground)
        self.estimate, self._sloped = estimate, float(slopes == "motion")
        self.shape = shape_of(estimate.shape)
        check_moves(self.shape)
        k = len(estimate.information.names)
        self._off = estimate.finger_offset is not None
        self._free = k > self.shape.theta + 3
        self._check_fingers(self.workspace)
        self._size = k + self._off * 3 * self.workspace.fingers
        self._sensors = _sensors(estimate)
        self.beliefs = self._believed(hypotheses)
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
        space, k = action.workspace, self._size
        self._check_fingers(space)
        path = action.positions(self.target, round(space.duration * RATE) + 1)
        path = self.estimate.scene.ground.to_ground(path) + belief.offset
        r, F = path.reshape(len(path), -1).T, space.fingers
        step = pushed(self.shape, self._free, F, len(path) - 1, self._off)
        rest = np.zeros(3), r[:, 0], np.zeros(3), np.zeros((3, k)), np.zeros((3, 3))
        _, _, s, _, _, told, p = step(
            *rest, np.zeros((k, k)), belief.z, r[:, :-1], r[:, 1:],
            np.full(F, space.finger_radius), self._known, self._sensors, self._sloped,
        )  # fmt: skip
        return s.full().T, p.full().T, told[:, -k:].full()

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

    def _believed(self, count: int) -> list[Belief]:
        """Return the hypotheses to follow, best first, weights summing to one."""
        estimate, n = self.estimate, self.shape.theta
        best = np.r_[estimate.theta, estimate.unknowns["x"][:, -1]]
        none = np.zeros((3, 1))
        offset = estimate.unknowns.get("finger offset", none).T
        rest = []
        if not self._free:  # of two pasts that end alike, the better one
            here = Hypothesis(best[:n], best[n:, None], -np.inf, ())
            ended = here, *estimate.hypotheses
            rest = distinct(self.shape, ended, count, np.inf, samples=(-1,))[1:]
        weights = [np.exp(min(0.0, estimate.objective - h.objective)) for h in rest]
        found = [Belief(best, self._known_of_best(), 1.0, offset)]
        for h, weight in zip(rest, weights, strict=True):
            if weight > NEGLIGIBLE:
                off = (none if h.offset is None else h.offset).T
                found.append(Belief(h.end, self._told(h.theta, h.x, off), weight, off))
        total = sum(b.weight for b in found)
        return [
            replace(b, information=_loosened(b, n), weight=b.weight / total)
            for b in found
        ]

    def _known_of_best(self) -> np.ndarray:
        """Return the information of the estimate; eq:obsinfo where it is indefinite.

        What curves down by less than a vague prior of the pose curves up is not known,
        no more.  Priors of sizes and offsets are in the estimate's programme already.
        """
        here = slice(self.shape.theta, len(self.estimate.information.names))
        anywhere = np.zeros((self._size, self._size))
        anywhere[here, here] = self.vague()[here, here]
        matrix = self.estimate.information.matrix
        matrix = self.estimate.information.with_offsets if self._off else matrix
        for known in (matrix, matrix + anywhere):
            least = np.linalg.eigvalsh(_scaled(known))[0]
            if least > 0:
                return known
        log.warning(
            "the information of the estimate is indefinite (least eigenvalue %.2g): "
            "choosing by the sum of its samples' (eq:obsinfo)", least,
        )  # fmt: skip
        offset = self.estimate.unknowns.get("finger offset", np.zeros((3, 1))).T
        x = _poses(self.estimate, self._free)
        return self._told(self.estimate.theta, x, offset)

    def _told(self, theta, x: np.ndarray, offset: np.ndarray) -> np.ndarray:
        """Return eq:obsinfo of all samples at poses x (u, T), and the priors."""
        shape, data = self.shape, self.estimate.measurements
        points = self.estimate.scene.ground.to_ground(data.finger_position) + offset
        t, f = np.nonzero(data.valid)
        k = len(theta) + len(x)
        z = np.vstack([np.repeat(theta[:, None], len(t), axis=1), x[:, t]])
        found = mapped(sampled(shape, self._free), len(t))(
            z, points[t, f].T, data.finger_radius[f][None],
            data.contact[t, f][None].astype(float), self._sensors,
        )  # fmt: skip
        found = found.full().reshape(k + 3, len(t), k + 3)
        information = self.vague()
        information[:k, :k] += found[:k, :, :k].sum(axis=1)
        for finger in range(data.fingers) if self._off else ():
            mine, at = f == finger, k + 3 * finger + np.arange(3)
            both = np.r_[:k, at]
            part = found[:, mine].sum(axis=1)
            part[:k, :k] = 0.0
            information[np.ix_(both, both)] += part
        return information

    def vague(self) -> np.ndarray:
        """Return the information before any touch, of the offsets as well."""
        k = len(self.estimate.information.names)
        information = np.eye(self._size)
        information[:k, :k] = vague(self.shape, k - self.shape.theta)
        if self._off:
            known = prior_of_offsets(self.estimate.scene, self.workspace.fingers)
            information[k:, k:] = known
        return information


def expected_information_gain(
    estimate, action: Action, *, hypotheses: int = 3, slopes: str = "motion"
) -> float:
    """Return EIG = (logdet(I + F) - logdet(I)) / 2 of an action, in nats (eq:eig).

    It aims at the estimated centroid.  See ExpectedInformation for the options, and use
    that to ask for many actions of one estimate.
    """
    check_types(action=(action, Action))
    expected = ExpectedInformation(estimate, action.workspace, hypotheses, slopes)
    return expected.gain(action)


def vague(shape, unknowns: int) -> np.ndarray:
    """Return the information (k, k) before any touch: rough sizes, a pose anywhere."""
    turns = unknowns // 2  # 1 of 3 planar, 3 of 6 free unknowns
    pose = np.r_[np.full(unknowns - turns, VAGUE[0]), np.full(turns, VAGUE[1])]
    return np.diag(1 / np.r_[np.full(shape.theta, shape.size_prior[1]), pose] ** 2)


def _poses(estimate, free: bool) -> np.ndarray:
    """Return the poses of an estimate as unknowns (u, T), ground frame."""
    from scipy.spatial.transform import Rotation

    ground = estimate.scene.ground
    position = ground.to_ground(estimate.position)
    turn = Rotation.from_quat(np.roll(estimate.quaternion, -1, axis=1))
    turn = Rotation.from_matrix(ground.rotation) * turn
    x = np.hstack([position, turn.as_rotvec()]).T
    return x if free else x[[0, 1, 5]]


def _scaled(matrix: np.ndarray) -> np.ndarray:
    scale = 1 / np.sqrt(np.abs(np.diag(matrix)))
    return matrix * np.outer(scale, scale)


def _loosened(belief: Belief, theta: int) -> np.ndarray:
    """Return the information once the fingers have gone: the pose may slip a little."""
    information, k = belief.information, len(belief.z)
    slip = np.zeros(len(information))
    slip[theta:k] = quasi_static.GAP
    slip[k - (1 if k == theta + 3 else 3) : k] /= quasi_static.ARM
    loosened = np.linalg.inv(np.linalg.inv(information) + np.diag(slip**2))
    return (loosened + loosened.T) / 2


def _sensors(estimate) -> np.ndarray:
    """Return alpha [1/m], sigma [m] of a felt gap, sigma_n [rad], as the pages have."""
    p, n = estimate.precision["position"], estimate.precision["normal"]
    alpha = 1 / np.hypot(1 / quasi_static.ALPHA, p / 1.7)
    touch, normal = violation_implicit.TOUCH, violation_implicit.NORMAL
    return np.array([alpha, np.hypot(touch, p), np.hypot(normal, n)])


def _known(scene, space: Workspace) -> np.ndarray:
    """Return mu_g, mu_f, weight [N], stiffness [N/m], max_force [N]."""
    ground = FRICTION if scene.friction_ground is None else scene.friction_ground
    finger = FRICTION if scene.friction_finger is None else scene.friction_finger
    weight = scene.mass * (scene.gravity or GRAVITY_FREE)
    ground = max(ground, SLIPPERY)
    return np.array([ground, finger, weight, space.stiffness, space.max_force])
