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
    soft fingertips         fingertips are taken as rigid
    late normals            error of the lag of normals, zero or estimated
    late touches            error of the latency of touches, zero, told or estimated
    radii of fingers        radii may be told wrong
    tilt of the ground      and of a body on it: uneven, or tipped by a finger

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
    unseen motion           motion while no finger touches
    prior of a hull         vertices are not distributed as the ball prior says

Added to their sum:

    other optima            local optima and their distance (mixture.py)
    untouched faces         faces that nothing touched
    profile likelihood      what it has beyond the mixture
    bound of the pose       the weak prior of the final pose (`bounded_pose`)
    active bounds           sizes or vertices that a bound holds
    poor fit                what the Birge ratio adds (goodness_of_fit.py)
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

import numpy as np

from formulations.names import (
    BALL,
    FINGER_FRICTION,
    GROUND_FRICTION,
    GROUND_GAP,
    LATE_NORMALS,
    LATE_TOUCHES,
    PRESSES,
    RADIUS_OF,
    ROUNDED_EDGES,
    SOFT_FINGERTIPS,
    TOUCH_TERM,
)

from .error_budget_terms import (
    curvature_of_costs,
    friction_error,
    missing_impulses,
    positive_semidefinite,
    regularisation,
    shape_prior_error,
    stick_slip,
    uneven_ground,
    unseen_motion,
)
from .linearisation import Response
from .measurement_noise import model_error, sensor_covariance

PHYSICS = 0.3  # [-] share of the curvature of physics that is its error
PRIORS = ("prior", "regulariser")  # roles of costs whose curvature is their error
OF_PRIORS, GROUND_TILT, POOR_FIT = "priors", "tilt of the ground", "poor fit"


def errors_of_sensing(response: Response) -> Iterator[tuple[str, np.ndarray]]:
    """Yield name and covariance (k, k) of each error of what is measured or told."""
    linearisation, by_gradient = response.linearisation, response.by_gradient
    kkt, job = linearisation.kkt, linearisation.job
    by_touches, by_others = (response.to_measurements(touch) for touch in (True, False))
    both = (touch + other for touch, other in zip(by_touches, by_others, strict=True))
    yield "sensor noise", sensor_covariance(*both, job)
    if TOUCH_TERM in kkt.problem.costs:
        off = model_error(kkt, *by_touches, job, linearisation.window)
        yield "touches off the model", off
    given = linearisation.consider_parameters
    for name in (ROUNDED_EDGES, SOFT_FINGERTIPS, PRESSES, LATE_NORMALS, LATE_TOUCHES):
        if name in given:
            velocities = response.motions[:1].T if name == LATE_TOUCHES else 0.0
            yield name, given[name].covariance(by_gradient, velocities)
    if radii := [given[name] for name in given if name.startswith(RADIUS_OF)]:
        yield "radii of fingers", sum(one.covariance(by_gradient) for one in radii)
    if (tilt := linearisation.tilt) is not None:
        yield GROUND_TILT, tilt.covariance(by_gradient, response.by_ground)


def errors_of_model(response: Response) -> Iterator[tuple[str, np.ndarray]]:
    """Yield name and covariance (k, k) of each error of priors and physics."""
    kkt, window = response.linearisation.kkt, response.linearisation.window
    problem = kkt.problem
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
        yield "uneven ground", uneven_ground(kkt, by_constraint, window)
    # No error enters along directions that the data do not determine: the sandwich
    # alone would take them for known.
    yield "negative curvature", positive_semidefinite(-response.hessian)
    if len(window.push):
        action = response.linearisation.job.data.action
        yield "stick or slip", stick_slip(kkt, by_gradient, window, action)
    yield "unseen motion", unseen_motion(response)
    if BALL in problem.variables:
        yield "prior of a hull", shape_prior_error(kkt, by_gradient)


def errors_by_name(response: Response) -> dict[str, np.ndarray]:
    """Return the covariance (k, k) of the chosen unknowns, SI, by each error alone."""
    errors, every = {}, chain(errors_of_sensing(response), errors_of_model(response))
    for name, covariance in every:
        response.linearisation.job.deadline.check()
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
    each = {name: variances(C, maps) for name, C in errors.items()}
    return {name: v for name, v in each.items() if np.nan_to_num(v).any()}


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
