r"""Add up the error budget: the covariance that `sigma` reports, as a list of terms.

The inverse Hessian is the covariance of the error only where every term of the
objective is the negative logarithm of a true density.  Here the middle of the sandwich

    C = K^{-1} G K^{-1},   G = sum of the errors in TERMS that apply to the shape

is what each part is known to err by.  TERMS is the one list, for boxes and for hulls:
`shapes` says to which class of shapes a term applies.  The terms of AFTER_MIXTURE are
added to the covariance of the mixture of local optima.  The shares are measured: they
are chosen such that sigma covers the errors of 20 recordings.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..nlp.kkt_sensitivity import KKTSystem
from .error_budget_terms import (
    GROUND_GAP,
    cluster_robust,
    curvature_of_costs,
    friction_error,
    missing_impulses,
    negative_curvature,
    profile_beyond,
    regularisation,
    shape_prior_error,
    stick_slip,
    uneven_ground,
    untouched_faces,
)
from .measurement_noise import (
    Sensed,
    measurement_numbers,
    model_error,
    sensitivity_to_measurements,
    sensor_covariance,
)

PHYSICS = (
    0.3  # [-] of the curvature of physics is its error: penalties are no densities
)
PRIORS = ("prior", "regulariser")  # roles of costs whose curvature is their error
REACHED = 0.1  # [m] a body that a finger felt is at most this far from there
ANY_ROTATION = np.pi / np.sqrt(3)  # [rad] deviation of a uniformly distributed rotation
FOR_SIZES, FOR_VERTICES = ("sizes",), ("vertices",)  # Shape.parameters
EVERY_SHAPE = (*FOR_SIZES, *FOR_VERTICES)


@dataclass(frozen=True, eq=False)
class Linearisation:
    """What the terms of an error budget are computed from, at a solution.

    pulls (unknowns, k), held (rows, k): see KKTSystem.sensitivity; sensed: the
    measurements and their noise; hessian (k, k): the covariance by the Hessian alone,
    None where its negative directions are of no interest.
    """

    curvature: KKTSystem
    pulls: np.ndarray
    held: np.ndarray
    sensed: Sensed
    window: object
    shape: object
    hessian: np.ndarray | None = None

    @cached_property
    def by_touches(self) -> tuple[np.ndarray, np.ndarray]:
        """How the unknowns move with positions and normals through the touches."""
        return self._moved([n for n in self.curvature.hessians if n == "touch"])

    @cached_property
    def by_others(self) -> tuple[np.ndarray, np.ndarray]:
        """How the unknowns move with positions and normals through all other terms."""
        return self._moved([n for n in self.curvature.hessians if n != "touch"])

    @cached_property
    def _sources(self) -> np.ndarray:
        return measurement_numbers(self.curvature, self.sensed, self.window)

    def _moved(self, terms) -> tuple[np.ndarray, np.ndarray]:
        given = self.curvature, self.pulls, self.held, self.sensed, self._sources
        return sensitivity_to_measurements(*given, terms=terms)

    def costs(self, roles) -> list[str]:
        """Return the names of the costs with one of these roles."""
        costs = self.curvature.problem.costs
        return [name for name, term in costs.items() if term.role in roles]

    @property
    def clusters(self) -> tuple:
        """What the terms over fingers and actions take."""
        return self.curvature, self.pulls, self.window, self.sensed.data.action


def sensor_noise(at: Linearisation) -> np.ndarray:
    """Return the covariance (k, k) by the noise of positions and normals."""
    pairs = zip(at.by_touches, at.by_others, strict=True)
    return sensor_covariance(
        *(touched + others for touched, others in pairs), at.sensed
    )


def touch_model(at: Linearisation) -> np.ndarray:
    """Return the covariance (k, k) by touches that are not as modelled."""
    return model_error(at.curvature, *at.by_touches, at.sensed, at.window, at.shape)


def physics_model(at: Linearisation) -> np.ndarray:
    """Return the covariance (k, k) by a share of the curvature of physics."""
    names = [*at.costs(["physics"]), *at.curvature.problem.constraints]
    return PHYSICS * curvature_of_costs(at.curvature, at.pulls, names)


@dataclass(frozen=True)
class ErrorTerm:
    """One named error: its covariance (k, k), where it applies and to which shapes.

    covariance, applies: functions of a Linearisation.  shapes: those values of
    Shape.parameters to which the term applies.
    """

    name: str
    covariance: Callable
    applies: Callable = lambda at: True
    shapes: tuple[str, ...] = EVERY_SHAPE


def _given(name: str) -> ErrorTerm:
    """Return the error of a coefficient of friction that was given."""
    return ErrorTerm(
        name,
        lambda at: friction_error(at.curvature, at.pulls, at.held, name),
        lambda at: name in at.curvature.problem.parameters,
    )


TERMS = (
    ErrorTerm("sensor noise", sensor_noise),
    ErrorTerm("touch model", touch_model, lambda at: "touch" in at.curvature.hessians),
    ErrorTerm(
        "priors",
        lambda at: curvature_of_costs(at.curvature, at.pulls, at.costs(PRIORS)),
    ),
    ErrorTerm("physics model", physics_model),
    ErrorTerm(
        "missing impulses",
        lambda at: PHYSICS * missing_impulses(at.curvature, at.held),
    ),
    ErrorTerm("regularisation", lambda at: regularisation(at.curvature, at.pulls)),
    _given("finger friction"),
    _given("ground friction"),
    ErrorTerm(
        "uneven ground",
        lambda at: uneven_ground(at.curvature, at.held, at.window),
        lambda at: GROUND_GAP in at.curvature.problem.constraints,
    ),
    ErrorTerm(
        "negative curvature",
        lambda at: negative_curvature(at.hessian),
        lambda at: at.hessian is not None,
        shapes=FOR_SIZES,
    ),
    ErrorTerm(
        "cluster-robust covariance",
        lambda at: cluster_robust(*at.clusters),
        shapes=FOR_VERTICES,
    ),
    ErrorTerm(
        "stick-slip ambiguity", lambda at: stick_slip(*at.clusters), shapes=FOR_VERTICES
    ),
    ErrorTerm(
        "shape prior error",
        lambda at: shape_prior_error(at.curvature, at.pulls),
        shapes=FOR_VERTICES,
    ),
)
AFTER_MIXTURE = (  # functions of TouchedFaces and of the mixture's covariance
    ErrorTerm("untouched faces", lambda seen, C: seen.untouched(), shapes=FOR_SIZES),
    ErrorTerm(
        "profile likelihood", lambda seen, C: profile_beyond(seen.profile, C),
        shapes=FOR_SIZES,
    ),
)  # fmt: skip


def error_budget(at: Linearisation) -> np.ndarray:
    """Return the covariance (k, k) of the chosen unknowns, SI: the sum of TERMS."""
    terms = [t for t in TERMS if at.shape.parameters in t.shapes and t.applies(at)]
    total = _sum(t.covariance(at) for t in terms if t.shapes == EVERY_SHAPE)
    own = [t.covariance(at) for t in terms if t.shapes != EVERY_SHAPE]
    return _sum([(total + total.T) / 2, *own])


@dataclass(frozen=True, eq=False)
class TouchedFaces:
    """What a shape of sizes is known by: touched faces, profile likelihood.

    faces (axes, 2): samples that touched each; noise [m] of finger positions; grounded:
    whether a ground carries the body; profile (k, k) of sizes and final pose, or None.
    """

    tangent: object
    shape: object
    faces: np.ndarray
    noise: float
    grounded: bool
    profile: np.ndarray | None

    def untouched(self) -> np.ndarray:
        """Return the covariance (k, k) of faces that nothing touched."""
        given = self.tangent, self.shape, self.faces, self.noise, self.grounded
        return untouched_faces(*given)


def after_mixture(seen: TouchedFaces, mixture) -> np.ndarray:
    """Return what AFTER_MIXTURE adds to the covariance (k, k) of a mixture."""
    terms = [t for t in AFTER_MIXTURE if seen.shape.parameters in t.shapes]
    return _sum(t.covariance(seen, mixture) for t in terms)


def _sum(matrices) -> np.ndarray:
    """Return the sum of at least one matrix, added in the order given."""
    first, *others = matrices
    return sum(others, start=first)


def bounded_pose(C, sizes: int, turning: int) -> np.ndarray:
    """Return the covariance (k, k) given that the final position lies within REACHED.

    sizes, turning: how many of the first and of the last of k are no position.  Where
    the data leave the pose open, rounding errors make the matrix indefinite: negative
    eigenvalues count as large variances.
    """
    widest = np.full(len(C) - sizes, REACHED)
    widest[-turning:] = ANY_ROTATION
    pose, unit = slice(sizes, None), np.outer(widest, widest)
    values, vectors = np.linalg.eigh(C[pose, pose] / unit)
    C = C.copy()
    C[pose, pose] = (vectors * np.abs(values)) @ vectors.T * unit
    less = C[:, pose] @ np.linalg.solve(C[pose, pose] + np.diag(widest**2), C[pose])
    return C - (less + less.T) / 2
