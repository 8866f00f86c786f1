r"""Add up the error budget: the covariance that `sigma` reports, as a list of terms.

The inverse Hessian is the covariance of the error only where every term of the
objective is the negative logarithm of a true density.  Penalties of physics are none.
The sandwich covariance (White 1982) is

    C = K^{-1} G K^{-1},   G = sum of the errors in ERROR_TERMS that apply

where G is the covariance of the gradient by each source of error.  ERROR_TERMS is one
list for every class of shapes: a term applies where the programme has what it is about.
Untouched faces and profile likelihoods are added to the covariance of the mixture.
PHYSICS is measured: with it sigma covers the errors of 20 recordings.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from formulations.names import (
    BALL,
    FINGER_FRICTION,
    GROUND_FRICTION,
    GROUND_GAP,
    RADIUS_OF,
    TOUCH_TERM,
)

from ..common.deadline import NEVER, Deadline
from ..nlp.kkt import KKTSystem
from .consider_parameters import Doubt, considered, motions
from .error_budget_terms import (
    TouchedFaces,
    curvature_of_costs,
    friction_error,
    missing_impulses,
    negative_curvature,
    profile_beyond,
    regularisation,
    shape_prior_error,
    stick_slip,
    uneven_ground,
    unseen_motion,
    untouched_faces,
)
from .measurement_noise import (
    MixedDerivatives,
    Sensed,
    mixed_derivatives,
    model_error,
    sensitivity_to_measurements,
    sensor_covariance,
)
from .sensitivity import GroundTilt, ground_tilt
from .tangent_space import pose_jacobians

PHYSICS = 0.3  # [-] share of the curvature of physics that is its error
PRIORS = ("prior", "regulariser")  # roles of costs whose curvature is their error


@dataclass(frozen=True, eq=False)
class Linearisation:
    """A solution to first order: its KKT system, and what its measurements move."""

    kkt: KKTSystem
    sensed: Sensed
    window: object
    shape: object
    deadline: Deadline = NEVER  # checked between the terms of the budget

    @cached_property
    def derivatives(self) -> list[MixedDerivatives]:
        """The mixed derivatives of every term that reads measurements."""
        return mixed_derivatives(self.kkt, self.sensed, self.window)

    @cached_property
    def doubts(self) -> dict[str, Doubt]:
        """The doubts about the consider parameters, by name."""
        return considered(self)

    @cached_property
    def motions(self) -> np.ndarray:
        """The motions (unknowns, 3) of all poses."""
        return motions(self.kkt, self.window, self.sensed)

    @cached_property
    def tilt(self) -> GroundTilt | None:
        """The tilt of the ground about where the body is at the end.

        None where it is known, or there is none.
        """
        scene = self.sensed.scene
        if scene.ground is None or scene.sigma_tilt == 0:
            return None
        if TOUCH_TERM not in self.kkt.problem.costs:
            return None
        sensed = self.sensed
        about = self.end * (1, 1, 0)
        given = self.kkt, sensed.build, self.window, sensed.data, scene, about
        return ground_tilt(*given)

    @property
    def end(self) -> np.ndarray:
        """The body's middle (3,) [m] at the last sample, ground frame."""
        values = self.kkt.problem.unpack(self.kkt.x)
        theta, x = values["theta"], values["x"][:, -1:]
        if self.shape.parameters == "vertices":
            return theta.mean(axis=1)
        return pose_jacobians(self.shape, self.window.motion, theta[:, 0], x)[0][0]

    def costs(self, roles) -> list[str]:
        """Return the names of the costs with one of these roles."""
        costs = self.kkt.problem.costs
        return [name for name, term in costs.items() if term.role in roles]

    def response(self, chosen, jacobian, turned=0.0) -> Response:
        """Return the response of J z, with J (k, n) and z (n,) the chosen unknowns.

        turned (k, 2): how they turn with the frame of the ground itself.
        """
        by_gradient, by_constraint = (
            part @ jacobian.T for part in self.kkt.sensitivity(chosen)
        )
        C = jacobian @ by_gradient[chosen]
        moving = (jacobian @ self.motions[chosen]).T
        hessian = (C + C.T) / 2
        return Response(self, by_gradient, by_constraint, hessian, turned, *moving)


@dataclass(frozen=True, eq=False)
class Response:
    """How k numbers of interest respond to errors: what terms are computed from.

    by_gradient (unknowns, k), by_constraint (rows, k): see KKTSystem.sensitivity;
    hessian (k, k): the covariance by the Hessian alone; turned: see
    Linearisation.response; moving, let_go, ahead (k,): as the columns of
    Linearisation.motions
    """

    at: Linearisation
    by_gradient: np.ndarray
    by_constraint: np.ndarray
    hessian: np.ndarray
    turned: np.ndarray | float
    moving: np.ndarray
    let_go: np.ndarray
    ahead: np.ndarray

    @cached_property
    def by_touches(self) -> tuple[np.ndarray, np.ndarray]:
        """How they move with positions and normals through the touches."""
        return self._moved(lambda name: name == TOUCH_TERM)

    @cached_property
    def by_others(self) -> tuple[np.ndarray, np.ndarray]:
        """How they move with positions and normals through all other terms."""
        return self._moved(lambda name: name != TOUCH_TERM)

    def _moved(self, asked) -> tuple[np.ndarray, np.ndarray]:
        through = [mixed for mixed in self.at.derivatives if asked(mixed.name)]
        return sensitivity_to_measurements(
            through, self.at.sensed, self.by_gradient, self.by_constraint
        )


def sensor_noise(response: Response) -> np.ndarray:
    """Return the covariance (k, k) by the noise of positions and normals."""
    pairs = zip(response.by_touches, response.by_others, strict=True)
    moves = (touched + others for touched, others in pairs)
    return sensor_covariance(*moves, response.at.sensed)


def touch_model(response: Response) -> np.ndarray:
    """Return the covariance (k, k) by touches that are not as modelled."""
    at = response.at
    return model_error(at.kkt, *response.by_touches, at.sensed, at.window, at.shape)


def physics_model(response: Response) -> np.ndarray:
    """Return the covariance (k, k) by a share of the curvature of physics."""
    at = response.at
    names = [*at.costs(["physics"]), *at.kkt.problem.constraints]
    return PHYSICS * curvature_of_costs(at.kkt, response.by_gradient, names)


def priors(response: Response) -> np.ndarray:
    """Return the covariance (k, k) by priors that are off by their deviations."""
    at = response.at
    return curvature_of_costs(at.kkt, response.by_gradient, at.costs(PRIORS))


@dataclass(frozen=True)
class ErrorTerm:
    """One named error: its covariance (k, k), and whether a programme has it.

    covariance: function of a Response; applies: function of a Linearisation.
    """

    name: str
    covariance: Callable
    applies: Callable = lambda at: True


def _given(name: str) -> ErrorTerm:
    """Return the error of a coefficient of friction that was given."""
    return ErrorTerm(
        name,
        lambda r: friction_error(r.at.kkt, r.by_gradient, r.by_constraint, name),
        lambda at: name in at.kkt.problem.parameters,
    )


def _considered(name: str, moved: Callable = lambda r: 0.0) -> ErrorTerm:
    """Return the error by a consider parameter; moved: see Doubt.covariance."""
    return ErrorTerm(
        name,
        lambda r: r.at.doubts[name].covariance(r.by_gradient, moved(r)),
        lambda at: name in at.doubts,
    )


def told_radii(response: Response) -> np.ndarray:
    """Return the covariance (k, k) by radii of fingers that were told wrong."""
    doubts = response.at.doubts
    radii = [doubts[name] for name in doubts if name.startswith(RADIUS_OF)]
    return sum(doubt.covariance(response.by_gradient) for doubt in radii)


def _has_touches(at: Linearisation) -> bool:
    return TOUCH_TERM in at.kkt.problem.costs


ERROR_TERMS = (
    ErrorTerm("sensor noise", sensor_noise),
    ErrorTerm("touch model", touch_model, _has_touches),
    _considered("rounded edges"),
    _considered("late normals"),
    _considered("late touches", lambda r: r.moving),
    ErrorTerm("told radii", told_radii, _has_touches),
    ErrorTerm(
        "tilt of the ground",
        lambda r: r.at.tilt.covariance(r.by_gradient, r.turned),
        lambda at: at.tilt is not None,
    ),
    ErrorTerm("priors", priors),
    ErrorTerm("physics model", physics_model),
    ErrorTerm(
        "missing impulses",
        lambda r: PHYSICS * missing_impulses(r.at.kkt, r.by_constraint),
    ),
    ErrorTerm("regularisation", lambda r: regularisation(r.at.kkt, r.by_gradient)),
    _given(FINGER_FRICTION),
    _given(GROUND_FRICTION),
    ErrorTerm(
        "uneven ground",
        lambda r: uneven_ground(r.at.kkt, r.by_constraint, r.at.window),
        lambda at: GROUND_GAP in at.kkt.problem.constraints,
    ),
    ErrorTerm("negative curvature", lambda r: negative_curvature(r.hessian)),
    ErrorTerm(
        "stick-slip ambiguity",
        lambda r: stick_slip(
            r.at.kkt, r.by_gradient, r.at.window, r.at.sensed.data.action
        ),
        lambda at: len(at.window.push) > 0,
    ),
    ErrorTerm("unseen motion", unseen_motion),
    ErrorTerm(
        "shape prior error",
        lambda r: shape_prior_error(r.at.kkt, r.by_gradient),
        lambda at: BALL in at.kkt.problem.variables,
    ),
)


def error_budget(response: Response) -> np.ndarray:
    """Return the covariance (k, k) of the chosen unknowns, SI: the sum of all terms."""
    found = []
    for term in ERROR_TERMS:
        response.at.deadline.check()
        if term.applies(response.at):
            found.append(term.covariance(response))
    total = sum(found[1:], start=found[0])
    return (total + total.T) / 2


def after_mixture(seen: TouchedFaces, mixture) -> np.ndarray:
    """Return what faces and profiles add to the covariance (k, k) of a mixture."""
    return untouched_faces(seen) + profile_beyond(seen.profile, mixture)
