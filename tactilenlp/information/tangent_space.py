"""Describe the tangent space of shape and pose; name what the data leave open.

Coordinates of the pose are its position and a small rotation about the world's axes;
of planar motion they are its unknowns, in the frame of the ground.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from .measurement_noise import KNOWN_FACE

AXES = ("x", "y", "z")
UNKNOWNS = {  # the words for the unknowns of a pose, by motion
    "planar": ("position x", "position y", "rotation z"),
    "free": tuple(f"{what} {w}" for what in ("position", "rotation") for w in AXES),
}

KNOWN_SIZE = 0.1  # [prior deviations] a size with a smaller deviation is observed
OPEN_POSITION = 0.05  # [m] a position with a larger deviation is not observed
LEAST_SIGMA = 1e-12  # [SI] a deviation below which a number is known exactly
LEAST_VARIANCE = 1e-12  # [-] of the others: a direction below is known exactly
OPEN_ROTATION = np.radians(45)  # a rotation with a larger deviation is not observed


@dataclass(frozen=True, eq=False)
class TangentSpace:
    """Coordinates z (k,) of shape and final pose, SI.

    names (k,); chosen (k,): indices into all unknowns; jacobian (k, k): from a change
    of those to one of z; maps: (3, k) Jacobian of each quantity by z; fixed: words for
    what the motion fixes, whose rows are NaN; R, R_first (3, 3): the final and the
    first rotation; up (3,): the vertical in the frame of both; turning: how many of the
    last entries of z turn the body.
    """

    names: tuple[str, ...]
    chosen: np.ndarray
    jacobian: np.ndarray
    maps: dict[str, np.ndarray]
    fixed: tuple[str, ...]
    z: np.ndarray
    R: np.ndarray
    R_first: np.ndarray
    up: np.ndarray
    turning: int

    @property
    def inverse(self) -> np.ndarray:
        """From a change of z to one of the chosen unknowns (k, k)."""
        return np.linalg.inv(self.jacobian)


def final_unknowns(problem) -> np.ndarray:
    """Return the indices (k,) of shape and last pose in the vector of all unknowns."""
    theta, x = problem.variables["theta"].span, problem.variables["x"]
    return np.r_[theta.start : theta.stop, x.span.stop - x.rows : x.span.stop]


def tangent_space_of(problem, solution, window, shape, R_wg) -> TangentSpace:
    """Return the tangent space at a solution; R_wg (3, 3): from ground to world."""
    motion, n, chosen = window.motion, shape.theta, final_unknowns(problem)
    at = np.r_[solution.values["theta"][:, 0], solution.values["x"][:, -1]]
    p, R, quantities, position, rotation = _maps(shape, motion, at)
    position, rotation = R_wg @ position, R_wg @ rotation
    values = (ca.DM(solution.values[name][:, 0]) for name in ("theta", "x"))
    first = np.asarray(ca.DM(motion.pose(shape, *values)[1]))
    names = (*shape.names, *UNKNOWNS[motion.name])
    tangent, up = np.eye(len(at)), np.eye(3)[2]
    if motion.name == "free":
        tangent = _tangent(n, position, rotation)
        back = np.linalg.inv(tangent)
        position, rotation = position @ back, rotation @ back
        quantities = {name: J @ back for name, J in quantities.items()}
        at, R = np.r_[at[:n], R_wg @ p, np.zeros(3)], R_wg @ R
        first, up = R_wg @ first, R_wg[:, 2]
    still = np.all(np.abs(rotation) < 1e-12, axis=1)
    rotation[still] = np.nan
    fixed = [f"rotation {w}" for w, held in zip(AXES, still, strict=True) if held]
    if motion.name == "planar" and not fixed:
        fixed = ["tilt against the ground"]
    maps = quantities | {"position": position, "rotation": rotation}
    turning = 1 if motion.name == "planar" else 3
    return TangentSpace(
        names, chosen, tangent, maps, tuple(fixed), at, R, first, up, turning
    )


def tangent_of(shape, motion, at, R_wg) -> np.ndarray:
    """Return from a change of theta and a pose's unknowns, `at` (k,), to one of z."""
    if motion.name != "free":
        return np.eye(len(at))
    *_, position, rotation = _maps(shape, motion, at)
    return _tangent(shape.theta, R_wg @ position, R_wg @ rotation)


def _tangent(n: int, position, rotation) -> np.ndarray:
    return np.vstack([np.eye(n, n + 6), position, rotation])


def _maps(shape, motion, at):
    """Return p (3,), R (3, 3), and Jacobians of quantities, position and turn, (3, k).

    A turn is a rotation vector in the frame of the problem.
    """
    n = shape.theta
    z = ca.SX.sym("z", len(at))
    p, R, position, rotation = _pose_slopes(shape, motion, z, n)
    asked = dict(getattr(shape, "quantities", ()))
    jacobians = [ca.jacobian(ca.SX(f(z[:n])), z) for f in asked.values()]
    out = [p, R, position, rotation, *jacobians]
    found = [np.asarray(ca.DM(m)) for m in ca.Function("maps", [z], out)(at)]
    p, R, position, rotation, *jacobians = found
    quantities = dict(zip(asked, jacobians, strict=True))
    return p[:, 0], R, quantities, position, rotation


def _pose_slopes(shape, motion, z, n: int):
    """Return p (3,), R (3, 3) and the Jacobians (3, k) of position and turn by z (k,).

    z: n unknowns of the shape, then those of a pose.
    """
    p, R = motion.pose(shape, z[:n], z[n:])
    slopes = [ca.jacobian(ca.vec(ca.densify(R)), z[i]) for i in range(z.numel())]
    turns = [ca.inv_skew(ca.reshape(dR, 3, 3) @ R.T) for dR in slopes]
    return p, R, ca.jacobian(p, z), ca.horzcat(*turns)


def pose_jacobians(shape, motion, theta, x):
    """Return p (s, 3), R (s, 3, 3) and Jacobians of position and turn (s, 3, k).

    theta (n,); x (unknowns of a pose, s).  The Jacobians are by (theta, column of x).
    """
    n, (unknowns, samples) = len(theta), x.shape
    z = ca.SX.sym("z", n + unknowns)
    out = [ca.vec(ca.densify(M)) for M in _pose_slopes(shape, motion, z, n)]
    function = ca.Function("poses", [z], out).map(samples)
    at = np.vstack([np.repeat(theta[:, None], samples, axis=1), x])
    p, R, *jacobians = (np.asarray(o).T for o in function(at))
    matrices = [M.reshape(samples, -1, 3).swapaxes(1, 2) for M in (R, *jacobians)]
    return p, *matrices


def widest_deviations(shape, k: int, place: float, turn: float) -> np.ndarray:
    """Return prior deviations (k,) of sizes, position [m] and rotation [rad].

    Those of the sizes are the shape's, those of the pose are `place` and `turn`.
    """
    turns = (k - shape.theta) // 2  # 1 of 3 planar, 3 of 6 free unknowns
    sigma = np.full(k, place)
    sigma[: shape.theta] = shape.size_prior[1]
    sigma[k - turns :] = turn
    return sigma


def open_directions(tangent, C, shape, faces) -> tuple[tuple, np.ndarray]:
    """Return words and unit vectors (k, r) for what only the prior determines."""
    n = shape.theta
    prior = widest_deviations(shape, len(C), OPEN_POSITION, OPEN_ROTATION)
    values, vectors = np.linalg.eigh(C / np.outer(prior, prior))
    directions = vectors[:, values > KNOWN_SIZE**2]
    deviation = np.sqrt(np.abs(np.diag(C)))
    turn, way = (
        tangent.maps[name] @ np.diag(deviation) for name in ("rotation", "position")
    )
    off = deviation[:n] / shape.size_prior[1]
    pose = np.linalg.norm(np.nan_to_num(turn)), np.linalg.norm(way)
    if shape.is_box:
        return unobserved(faces, off, *pose), directions
    sizes = tuple(
        f"{name}: touches leave it open"
        for name in np.array(shape.names)[off > KNOWN_SIZE]
    )
    heading = 0.0 if shape.round else pose[0]  # of a round body means nothing
    return (*sizes, *unobserved((), None, heading, pose[1])), directions


def unobserved(faces, sides=None, turn=0.0, way=0.0) -> tuple[str, ...]:
    """Name what touches do not determine.

    faces (axes, 2): samples that touched each face; sides (axes,): sigma of each size
    in deviations of its prior, small where edges or physics determine it; turn [rad]
    and way [m]: sigma of rotation and position.
    """
    words = []
    for axis, (low, high) in enumerate(faces):
        if sides is not None and sides[axis] < KNOWN_SIZE:
            continue
        missing = [s for s, n in (("-", low), ("+", high)) if n < KNOWN_FACE]
        if axis == 2:
            if high < KNOWN_FACE:
                words.append("side z: top never touched")
        elif len(missing) == 2:
            words.append(f"side {AXES[axis]}: neither face touched")
        elif missing:
            face = f"{missing[0]}{AXES[axis]}"
            words.append(f"side {AXES[axis]}: face {face} never touched")
    if turn > OPEN_ROTATION:
        words.append(f"rotation: sigma above {np.degrees(OPEN_ROTATION):.0f} deg")
    if way > OPEN_POSITION:
        words.append(f"position: sigma above {1e3 * OPEN_POSITION:.0f} mm")
    return tuple(words)


def untouched_polygons(faces) -> tuple[str, ...]:
    """Name how many faces were never touched."""
    missing = int(np.count_nonzero(faces == 0))
    return (f"{missing} of {len(faces)} faces never touched",) if missing else ()


def inverse(C) -> np.ndarray:
    """Return the inverse of a covariance, finite also where a direction is known."""
    d = np.sqrt(np.maximum(np.abs(np.diag(C)), LEAST_SIGMA**2))
    values, vectors = np.linalg.eigh(C / np.outer(d, d))
    values = np.where(np.abs(values) < LEAST_VARIANCE, LEAST_VARIANCE, values)
    return (vectors / values) @ vectors.T / np.outer(d, d)
