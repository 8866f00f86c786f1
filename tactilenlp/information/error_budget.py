r"""Add up the error budget: the covariance that `sigma` reports, term by term.

The inverse Hessian is the covariance of the error only where every term of the
objective is the negative logarithm of a true density.  Penalties of physics are none.
The sandwich covariance (White 1982) is

    C = K^{-1} G K^{-1},   G = sum of the errors that apply

where G is the covariance of the gradient by each source of error: of sensing, and of
the model.  A term applies where the programme has what it is about, in any class.
Untouched faces and profile likelihoods are added to the covariance of the mixture.
PHYSICS is measured: with it sigma covers the errors of 20 recordings.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import numpy as np

from formulations.names import (
    BALL,
    FINGER_FRICTION,
    GROUND_FRICTION,
    GROUND_GAP,
    LATE_NORMALS,
    LATE_TOUCHES,
    RADIUS_OF,
    ROUNDED_EDGES,
    TOUCH_TERM,
)

from ..common.deadline import NEVER, Deadline
from ..data.ground import frame_of
from ..data.sensor_noise import told_later
from ..nlp.kkt import KKTSystem
from .consider_parameters import Doubt, considered
from .error_budget_terms import (
    curvature_of_costs,
    friction_error,
    missing_impulses,
    negative_curvature,
    regularisation,
    shape_prior_error,
    stick_slip,
    uneven_ground,
    unseen_motion,
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
        """How poses move (unknowns, 3), zero for other unknowns.

        Their velocities; by how far a body may be off that was let go in motion; and
        how far poses are moved on for which late sensors have told nothing yet.
        """
        kkt, window, latency = self.kkt, self.window, self.sensed.precision.latency
        pose, step = kkt.problem.variables["x"], window.step
        x = kkt.x[pose.span].reshape(pose.columns, pose.rows)
        v, ahead, of_all = np.zeros_like(x), np.zeros_like(x), np.zeros((len(kkt.x), 3))
        v[step.pose] = (x[step.pose] - x[step.before]) / step.dt[:, None]
        unknown = window.pose[told_later(self.sensed.data, latency)]
        ahead[unknown] = latency * v[unknown]
        ways = v.ravel(), window.let_go(x.T).T.ravel(), ahead.ravel()
        of_all[pose.span] = np.stack(ways, axis=1)
        return of_all

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

    @cached_property
    def values(self) -> dict[str, np.ndarray]:
        """The unknowns by name, as in a Solution."""
        return self.kkt.problem.unpack(self.kkt.x)

    @property
    def R_wg(self) -> np.ndarray:
        """The rotation (3, 3) from the ground's frame, of the problem, to the world."""
        return frame_of(self.sensed.scene.ground).rotation.T

    @property
    def end(self) -> np.ndarray:
        """The body's middle (3,) [m] at the last sample, ground frame."""
        theta, x = self.values["theta"], self.values["x"][:, -1:]
        if self.shape.parameters == "vertices":
            return theta.mean(axis=1)
        return pose_jacobians(self.shape, self.window.motion, theta[:, 0], x)[0][0]

    def response(self, chosen, jacobian, turned=0.0) -> Response:
        """Return the response of J z, with J (k, n) and z (n,) the chosen unknowns.

        turned (k, 2): how they turn with the frame of the ground itself.
        """
        by_gradient, by_constraint = (
            part @ jacobian.T for part in self.kkt.sensitivity(chosen)
        )
        C = jacobian @ by_gradient[chosen]
        motions = (jacobian @ self.motions[chosen]).T
        hessian = (C + C.T) / 2
        return Response(self, by_gradient, by_constraint, hessian, turned, motions)


@dataclass(frozen=True, eq=False)
class Response:
    """How k numbers of interest respond to errors: what terms are computed from.

    by_gradient (unknowns, k), by_constraint (rows, k): see KKTSystem.sensitivity;
    hessian (k, k): the covariance by the Hessian alone; turned: see
    Linearisation.response; motions (3, k): see Linearisation.motions.
    """

    at: Linearisation
    by_gradient: np.ndarray
    by_constraint: np.ndarray
    hessian: np.ndarray
    turned: np.ndarray | float
    motions: np.ndarray

    def moved(self, by_touches: bool) -> tuple[np.ndarray, np.ndarray]:
        """Return how they move with positions and normals, (k, T, F, 3) each.

        Through the touches alone, or through all other terms.
        """
        derivatives = self.at.derivatives
        through = [d for d in derivatives if (d.term.name == TOUCH_TERM) == by_touches]
        return sensitivity_to_measurements(
            through, self.at.sensed, self.by_gradient, self.by_constraint
        )


def errors_of_sensing(response: Response) -> Iterator[np.ndarray]:
    """Yield the covariance (k, k) by each error of what is measured or was told."""
    at, by_gradient, doubts = response.at, response.by_gradient, response.at.doubts
    touched, others = response.moved(True), response.moved(False)
    both = (by + by_other for by, by_other in zip(touched, others, strict=True))
    yield sensor_covariance(*both, at.sensed)
    if TOUCH_TERM in at.kkt.problem.costs:
        yield model_error(at.kkt, *touched, at.sensed, at.window, at.shape)
    for name in (ROUNDED_EDGES, LATE_NORMALS, LATE_TOUCHES):
        if name in doubts:
            moved = response.motions[0] if name == LATE_TOUCHES else 0.0
            yield doubts[name].covariance(by_gradient, moved)
    if radii := [doubts[name] for name in doubts if name.startswith(RADIUS_OF)]:
        yield sum(doubt.covariance(by_gradient) for doubt in radii)
    if at.tilt is not None:
        yield at.tilt.covariance(by_gradient, response.turned)


def errors_of_model(response: Response) -> Iterator[np.ndarray]:
    """Yield the covariance (k, k) by each error of priors and physics."""
    at, kkt, problem = response.at, response.at.kkt, response.at.kkt.problem
    by_gradient, by_constraint = response.by_gradient, response.by_constraint
    roles = {name: term.role for name, term in problem.costs.items()}
    priors = [name for name, role in roles.items() if role in PRIORS]
    yield curvature_of_costs(kkt, by_gradient, priors)
    physics = [name for name, role in roles.items() if role == "physics"]
    physics += problem.constraints
    yield PHYSICS * curvature_of_costs(kkt, by_gradient, physics)
    yield PHYSICS * missing_impulses(kkt, by_constraint)
    yield regularisation(kkt, by_gradient)
    for name in (FINGER_FRICTION, GROUND_FRICTION):
        if name in problem.parameters:  # it was given
            yield friction_error(kkt, by_gradient, by_constraint, name)
    if GROUND_GAP in problem.constraints:
        yield uneven_ground(kkt, by_constraint, at.window)
    yield negative_curvature(response.hessian)
    if len(at.window.push):
        yield stick_slip(kkt, by_gradient, at.window, at.sensed.data.action)
    yield unseen_motion(response)
    if BALL in problem.variables:
        yield shape_prior_error(kkt, by_gradient)


def error_budget(response: Response) -> np.ndarray:
    """Return the covariance (k, k) of the chosen unknowns, SI: the sum of all terms."""
    total = np.zeros_like(response.hessian)
    for covariance in chain(errors_of_sensing(response), errors_of_model(response)):
        response.at.deadline.check()
        total += covariance
    return (total + total.T) / 2
