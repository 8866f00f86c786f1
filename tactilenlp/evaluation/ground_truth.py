"""Compare an estimate with the ground truth of a simulated world.

A world tells the truth by a method, `true_body(time)`: the TrueBody at a time [s] of
its measurements, None where it is not known.  No estimate and no choice of an action
calls it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..common.brief import printed
from ..errors import OptionError

if TYPE_CHECKING:
    from trimesh import Trimesh


@printed
@dataclass(frozen=True, eq=False)
class TrueBody:
    """The true body at an instant.

    mesh: its surface, in the world frame [m]; position (3,) [m] and quaternion (4,)
    wxyz of its body frame; side_lengths (3,) [m] of a cuboid, else None.
    """

    mesh: Trimesh
    position: np.ndarray
    quaternion: np.ndarray
    side_lengths: np.ndarray | None = None


def errors_of(world, estimate) -> dict[str, float]:
    """Return the errors of an estimate at its last sample, SI; empty without a truth.

    surface, surface_max [m]: exact distance, mean and largest; position [m] of the
    centroid; of two cuboids side_lengths [m], the largest, and rotation [rad], modulo
    symmetry.  Raises OptionError if `true_body` returns anything else.
    """
    from .metrics import cuboid_errors, surface_distance

    if getattr(world, "true_body", None) is None:
        return {}
    true = world.true_body(float(estimate.measurements.time[-1]))
    if true is None:
        return {}
    if not isinstance(true, TrueBody):
        raise OptionError(
            "no truth", where="world.true_body", got=repr(true)[:80],
            expected="a tactilenlp.TrueBody, or None where it is not known",
        )  # fmt: skip
    distance = surface_distance(estimate.mesh(), true.mesh)
    errors = {"surface": distance.mean, "surface_max": distance.maximum}
    off = np.linalg.norm(estimate.position[-1] - true.position)
    errors["position"] = float(off)
    if true.side_lengths is not None and estimate.shape == "cuboid":
        found = estimate.side_lengths, estimate.position[-1], estimate.quaternion[-1]
        truth = true.side_lengths, true.position, true.quaternion
        apart = cuboid_errors(*found, *truth)
        errors["side_lengths"] = float(np.abs(apart.side_lengths).max())
        errors["rotation"] = float(apart.rotation_angle)
    return errors
