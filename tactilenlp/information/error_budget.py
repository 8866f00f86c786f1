r"""Add up the error budget: the covariance that `sigma` reports, term by term.

The inverse Hessian is the covariance of the error only where every term of the
objective is the negative logarithm of a true density.  Penalties of physics are none.
The sandwich covariance (White 1982) is

    C = K^{-1} G K^{-1},   G = sum of the errors that apply

where G is the covariance of the gradient by each source of error: of sensing, and of
the model.  A term applies where the programme has what it is about, in any class.
PHYSICS is measured: with it sigma covers the errors of 20 recordings.

Of sensing:

    sensor noise            of measured positions and normals
    touches off the model   gaps and normals of touches that no body explains
    rounded edges           edges are taken as sharp
    late normals            normals are taken as of the instant of contacts
    late touches            touches are taken as of the instant of positions
    radii of fingers        radii may be told wrong
    tilt of the ground      and of a body that stands on an uneven one

Of priors and physics:

    priors                  of sizes and poses, and regularisers
    physics                 balances and laws of contact do not hold exactly
    missing impulses        of contacts that a hard balance does not have
    regularisation          of the KKT matrix, a weak prior
    finger friction         a coefficient that was given
    ground friction         a coefficient that was given
    uneven ground           corners off the plane of a hard ground
    negative curvature      directions along which the Hessian is negative
    stick or slip           fingers that may stick instead of slide
    unseen motion           bodies that move on, or stop, unseen
    prior of a hull         bodies are no balls

Added to their sum:

    other optima            local optima and their distance (mixture.py)
    untouched faces         faces that nothing touched
    profile likelihood      what it has beyond the mixture
    bound of the pose       the weak prior of the final pose (`bounded_pose`)
    active bounds           vertices of a hull that a bound holds
    poor fit                what the Birge ratio adds (goodness_of_fit.py)
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

from ..data.ground import frame_of
from ..data.sensor_noise import reported_late
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
    mixed_derivatives,
    model_error,
    sensitivity_to_measurements,
    sensor_covariance,
)
from .sensitivity import GroundTilt, ground_tilt
from .tangent_space import pose_jacobians

PHYSICS = 0.3  # [-] share of the curvature of physics that is its error
PRIORS = ("prior", "regulariser")  # roles of costs whose curvature is their error
OF_PRIORS, GROUND_TILT, POOR_FIT = "priors", "tilt of the ground", "poor fit"


@dataclass(frozen=True, eq=False)
class Linearisation:
    """A solution to first order: its KKT system, and what its measurements move.

    job: the search's Job, whose deadline is checked between the terms of the budget.
    """

    kkt: KKTSystem
    job: object
    window: object

    @cached_property
    def derivatives(self) -> list[MixedDerivatives]:
        """The mixed derivatives of every term that reads measurements."""
        return mixed_derivatives(self.kkt, self.job, self.window)

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
        kkt, window, latency = self.kkt, self.window, self.job.precision.latency
        pose, step = kkt.problem.variables["x"], window.step
        x = kkt.x[pose.span].reshape(pose.columns, pose.rows)
        v, ahead, of_all = np.zeros_like(x), np.zeros_like(x), np.zeros((len(kkt.x), 3))
        v[step.pose] = (x[step.pose] - x[step.before]) / step.dt[:, None]
        unknown = window.pose[reported_late(self.job.data, latency)]
        ahead[unknown] = latency * v[unknown]
        ways = v.ravel(), window.let_go(x.T).T.ravel(), ahead.ravel()
        of_all[pose.span] = np.stack(ways, axis=1)
        return of_all

    @cached_property
    def tilt(self) -> GroundTilt | None:
        """The tilt of the ground about where the body is at the end.

        None where it is known, or there is none.
        """
        job, scene = self.job, self.job.scene
        known = scene.ground is None or scene.sigma_tilt == 0
        if known or TOUCH_TERM not in self.kkt.problem.costs:
            return None
        given = self.kkt, job.build, self.window, job.data, scene
        return ground_tilt(*given, self.end * (1, 1, 0))

    @cached_property
    def values(self) -> dict[str, np.ndarray]:
        """The unknowns by name, as in a Solution."""
        return self.kkt.problem.unpack(self.kkt.x)

    @property
    def R_wg(self) -> np.ndarray:
        """The rotation (3, 3) from the ground's frame, of the problem, to the world."""
        return frame_of(self.job.scene.ground).rotation.T

    @property
    def end(self) -> np.ndarray:
        """The body's middle (3,) [m] at the last sample, ground frame."""
        theta, x = self.values["theta"], self.values["x"][:, -1:]
        shape, motion = self.window.shape, self.window.motion
        if shape.last_pose_held:
            return theta.mean(axis=1)
        return pose_jacobians(shape, motion, theta[:, 0], x)[0][0]

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
            through, self.at.job.data, self.by_gradient, self.by_constraint
        )


def errors_of_sensing(response: Response) -> Iterator[tuple[str, np.ndarray]]:
    """Yield name and covariance (k, k) of each error of what is measured or told."""
    at, by_gradient, doubts = response.at, response.by_gradient, response.at.doubts
    touched, others = response.moved(True), response.moved(False)
    both = (by + by_other for by, by_other in zip(touched, others, strict=True))
    yield "sensor noise", sensor_covariance(*both, at.job)
    if TOUCH_TERM in at.kkt.problem.costs:
        off = model_error(at.kkt, *touched, at.job, at.window)
        yield "touches off the model", off
    for name in (ROUNDED_EDGES, LATE_NORMALS, LATE_TOUCHES):
        if name in doubts:
            moved = response.motions[0] if name == LATE_TOUCHES else 0.0
            yield name, doubts[name].covariance(by_gradient, moved)
    if radii := [doubts[name] for name in doubts if name.startswith(RADIUS_OF)]:
        yield "radii of fingers", sum(one.covariance(by_gradient) for one in radii)
    if at.tilt is not None:
        yield GROUND_TILT, at.tilt.covariance(by_gradient, response.turned)


def errors_of_model(response: Response) -> Iterator[tuple[str, np.ndarray]]:
    """Yield name and covariance (k, k) of each error of priors and physics."""
    at, kkt, problem = response.at, response.at.kkt, response.at.kkt.problem
    by_gradient, by_constraint = response.by_gradient, response.by_constraint
    priors = problem.costs_of(*PRIORS)
    yield OF_PRIORS, curvature_of_costs(kkt, by_gradient, priors)
    physics = [*problem.costs_of("physics"), *problem.constraints]
    yield "physics", PHYSICS * curvature_of_costs(kkt, by_gradient, physics)
    yield "missing impulses", PHYSICS * missing_impulses(kkt, by_constraint)
    yield "regularisation", regularisation(kkt, by_gradient)
    for name in (FINGER_FRICTION, GROUND_FRICTION):
        if name in problem.parameters:  # it was given
            yield name, friction_error(kkt, by_gradient, by_constraint, name)
    if GROUND_GAP in problem.constraints:
        yield "uneven ground", uneven_ground(kkt, by_constraint, at.window)
    yield "negative curvature", negative_curvature(response.hessian)
    if len(at.window.push):
        action = at.job.data.action
        yield "stick or slip", stick_slip(kkt, by_gradient, at.window, action)
    yield "unseen motion", unseen_motion(response)
    if BALL in problem.variables:
        yield "prior of a hull", shape_prior_error(kkt, by_gradient)


def errors_by_name(response: Response) -> dict[str, np.ndarray]:
    """Return the covariance (k, k) of the chosen unknowns, SI, by each error alone."""
    errors, every = {}, chain(errors_of_sensing(response), errors_of_model(response))
    for name, covariance in every:
        response.at.job.deadline.check()
        errors[name] = covariance
    return errors


def summed(errors: dict[str, np.ndarray]) -> np.ndarray:
    """Return the covariance (k, k) by all errors."""
    total = sum(errors.values())
    return (total + total.T) / 2


def variances(C, maps: dict[str, np.ndarray]) -> np.ndarray:
    """Return the variances (n,) by C (k, k): of the k numbers, then by every map."""
    return np.concatenate([np.diag(C), *(np.diag(J @ C @ J.T) for J in maps.values())])


def variances_by_name(errors: dict, maps: dict) -> dict[str, np.ndarray]:
    """Return the variances (n,) by covariances (k, k), by name, but those of zero."""
    found = {name: variances(C, maps) for name, C in errors.items()}
    return {name: v for name, v in found.items() if np.nan_to_num(v).any()}


def with_ground(errors: dict, ground, traces: dict) -> dict[str, np.ndarray]:
    """Return variances (3,) of a pose by error, with those (3,) that the ground adds.

    traces: of all unknowns, by error: a poor fit has its share of what is added.
    """
    errors = {name: np.nan_to_num(variance) for name, variance in errors.items()}
    share = traces.get(POOR_FIT, 0.0) / sum(traces.values())
    for name, part in ((GROUND_TILT, 1 - share), (POOR_FIT, share)):
        errors[name] = errors.get(name, 0.0) + part * ground
    return errors


def deviations(errors: dict[str, np.ndarray], unit=1.0) -> dict[str, np.ndarray]:
    """Return standard deviations (n,) by each error alone, the largest first.

    errors: variances (n,) by each; unit (n,): in which these are compared.
    """
    order = sorted(errors, key=lambda name: -np.nansum(errors[name] / unit))
    sigma = {name: np.sqrt(np.maximum(errors[name], 0.0)) for name in order}
    return {name: s for name, s in sigma.items() if np.nansum(s) > 0}
