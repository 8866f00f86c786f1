"""Compute the covariance of constant offsets of the finger positions, world frame."""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag

from formulations.finger_offset import NAME

from .error_budget import Linearisation, error_budget


def offsets_of(values: dict, R_wg) -> np.ndarray | None:
    """Return by how much each finger is off (F, 3) [m]; None where that is known."""
    return (R_wg @ values[NAME]).T if NAME in values else None


def covariance_of_offsets(at: Linearisation, R_wg) -> np.ndarray | None:
    """Return the covariance (3 F, 3 F) [m^2], finger by finger; None: all are known."""
    variables = at.kkt.problem.variables
    if NAME not in variables:
        return None
    span = variables[NAME].span
    chosen = np.arange(span.start, span.stop)
    turn = np.kron(np.eye(len(chosen) // 3), R_wg)
    return error_budget(at.response(chosen, turn))


def covariance_with_offsets(kkt, tangent) -> np.ndarray:
    """Return the covariance (k + 3 F, k + 3 F) by the Hessian, offsets last.

    Of shape and final pose in their tangent space, and of the page's own offsets.
    """
    span = kkt.problem.variables[NAME].span
    chosen = np.r_[tangent.chosen, span.start : span.stop]
    C = kkt.sensitivity(chosen)[0][chosen]
    jacobian, k = np.eye(len(chosen)), len(tangent.chosen)
    jacobian[:k, :k] = tangent.jacobian
    C = jacobian @ C @ jacobian.T
    return (C + C.T) / 2


def prior_of_offsets(scene, fingers: int) -> np.ndarray:
    """Return the information (3 F, 3 F) [1 / m^2] before any touch, ground's frame."""
    if scene.joints is None:
        return np.eye(3 * fingers) / scene.sigma_offset**2
    return block_diag(*scene.joints.information.reshape(-1, 3, 3))
