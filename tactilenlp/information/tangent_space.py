"""Describe the tangent space of shape and pose; name unobserved directions.

Coordinates of the pose are its position and a small rotation about the world's axes;
of planar motion they are its unknowns, in the frame of the ground.  The last pose of a
polytope is held: its vertices at the last sample carry all of the uncertainty.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from formulations.sensing import FREEDOM

from ..geometry.convex_hull import centroid
from ..geometry.faces import KNOWN_FACE

AXES = ("x", "y", "z")
UNKNOWNS = {  # the words for the unknowns of a pose, by motion
    "planar": ("position x", "position y", "rotation z"),
    "free": tuple(f"{what} {w}" for what in ("position", "rotation") for w in AXES),
}

VERTICAL = 0.99  # [-] cosine between the vertical and the axis of a face on the ground
KNOWN_SIZE = 0.1  # [prior deviations] a size with a smaller deviation is observed
OPEN_POSITION = 0.05  # [m] a position with a larger deviation is not observed
LEAST_SIGMA = 1e-12  # [SI] a deviation below which a number is known exactly
LEAST_VARIANCE = 1e-12  # [-] of the others: a direction below is known exactly
VERTEX_STEP = 1e-6  # [m] of a difference quotient by a vertex
OPEN_ROTATION = np.radians(45)  # a rotation with a larger deviation is not observed


@dataclass(frozen=True, eq=False)
class TangentSpace:
    """Coordinates z (k,) of shape and final pose, SI.

    names (k,); chosen (k,): indices into all unknowns; jacobian (k, k): from a change
    of those to one of z; maps: (3, k) Jacobian of each quantity by z; fixed: words for
    what the motion fixes, whose rows are NaN; R, R_first (3, 3): the final and the
    first rotation; up (3,): the vertical in the frame of both.  From z on, None where
    these are vertices.
    """

    names: tuple[str, ...]
    chosen: np.ndarray
    jacobian: np.ndarray
    maps: dict[str, np.ndarray]
    fixed: tuple[str, ...]
    z: np.ndarray | None = None
    R: np.ndarray | None = None
    R_first: np.ndarray | None = None
    up: np.ndarray | None = None

    @property
    def inverse(self) -> np.ndarray:
        """From a change of z to one of the chosen unknowns (k, k)."""
        return np.linalg.inv(self.jacobian)


def final_unknowns(problem) -> np.ndarray:
    """Return the indices (k,) of shape and last pose in the vector of all unknowns."""
    theta, x = problem.variables["theta"].span, problem.variables["x"]
    return np.r_[theta.start : theta.stop, x.span.stop - x.rows : x.span.stop]


def tangent_space_of(problem, solution, window, R_wg) -> TangentSpace:
    """Return the tangent space at a solution; R_wg (3, 3): from ground to world."""
    shape, motion, chosen = window.shape, window.motion, final_unknowns(problem)
    n = shape.theta
    theta, x = solution.values["theta"][:, 0], solution.values["x"][:, [0, -1]]
    p, (first, R), position, rotation = pose_jacobians(shape, motion, theta, x)
    position, rotation = R_wg @ position[-1], R_wg @ rotation[-1]
    at = np.r_[theta, x[:, -1]]
    quantities = _slopes_of_quantities(shape, theta, len(at))
    names = (*shape.names, *UNKNOWNS[motion.name])
    tangent, up = np.eye(len(at)), np.eye(3)[2]
    if motion.name == "free":
        tangent = _tangent(n, position, rotation)
        back = np.linalg.inv(tangent)
        position, rotation = position @ back, rotation @ back
        quantities = {name: J @ back for name, J in quantities.items()}
        at, R = np.r_[at[:n], R_wg @ p[-1], np.zeros(3)], R_wg @ R
        first, up = R_wg @ first, R_wg[:, 2]
    still = np.all(np.abs(rotation) < LEAST_SIGMA, axis=1)
    rotation[still] = np.nan
    fixed = [f"rotation {w}" for w, held in zip(AXES, still, strict=True) if held]
    if motion.name == "planar" and not fixed:
        fixed = ["tilt against the ground"]
    maps = quantities | {"position": position, "rotation": rotation}
    return TangentSpace(names, chosen, tangent, maps, tuple(fixed), at, R, first, up)


def tangent_space_of_hull(problem, solution, R_wg) -> TangentSpace:
    """Return the vertices at the last sample, world frame, as coordinates."""
    theta, V = problem.variables["theta"], solution.values["theta"].T
    names = tuple(f"vertex {j} {w}" for j in range(len(V)) for w in "xyz")
    turn = np.kron(np.eye(len(V)), R_wg)
    middle = R_wg @ (slope_of_centroid(V) @ turn.T)
    maps = {
        "vertices": np.eye(V.size) - np.tile(middle, (len(V), 1)),
        "position": middle,
        "rotation": np.zeros((3, V.size)),
    }
    fixed = ("rotation: the body's axes are the world's at the last sample",)
    chosen = np.arange(theta.span.start, theta.span.stop)
    return TangentSpace(names, chosen, turn, maps, fixed)


def slope_of_centroid(vertices) -> np.ndarray:
    """Return how the hull's centroid follows its vertices, (3, 3 V), by differences."""
    step, slopes = VERTEX_STEP, []
    for i in range(vertices.size):
        changed = vertices.copy().ravel()
        changed[i] += step
        ahead = centroid(changed.reshape(-1, 3))
        changed[i] -= 2 * step
        slopes.append((ahead - centroid(changed.reshape(-1, 3))) / (2 * step))
    return np.array(slopes).T


def tangent_of(shape, motion, at, R_wg) -> np.ndarray:
    """Return from a change of theta and a pose's unknowns, `at` (k,), to one of z."""
    if motion.name != "free":
        return np.eye(len(at))
    n = shape.theta
    *_, position, rotation = pose_jacobians(shape, motion, at[:n], at[n:, None])
    return _tangent(n, R_wg @ position[0], R_wg @ rotation[0])


def _tangent(n: int, position, rotation) -> np.ndarray:
    return np.vstack([np.eye(n, n + 6), position, rotation])


def _slopes_of_quantities(shape, theta, k: int) -> dict[str, np.ndarray]:
    """Return the Jacobians (3, k) of what a user asks for, by theta, then a pose."""
    symbol, slopes = ca.SX.sym("theta", len(theta)), {}
    for name, of in shape.quantities:
        slope = ca.jacobian(ca.SX(of(symbol)), symbol)
        slope = np.asarray(ca.DM(ca.Function("slope", [symbol], [slope])(theta)))
        slopes[name] = np.pad(slope, ((0, 0), (0, k - len(theta))))
    return slopes


def pose_jacobians(shape, motion, theta, x):
    """Return p (s, 3), R (s, 3, 3) and Jacobians of position and turn (s, 3, k).

    theta (n,); x (unknowns of a pose, s).  The Jacobians are by (theta, column of x); a
    turn is a rotation vector in the frame of the problem.
    """
    n, (unknowns, samples) = len(theta), x.shape
    z = ca.SX.sym("z", n + unknowns)
    p, R = motion.pose(shape, z[:n], z[n:])
    slopes = [ca.jacobian(ca.vec(ca.densify(R)), z[i]) for i in range(z.numel())]
    turns = [ca.inv_skew(ca.reshape(dR, 3, 3) @ R.T) for dR in slopes]
    out = [p, R, ca.jacobian(p, z), ca.horzcat(*turns)]
    out = [ca.vec(ca.densify(M)) for M in out]
    function = ca.Function("poses", [z], out).map(samples)
    at = np.vstack([np.repeat(theta[:, None], samples, axis=1), x])
    p, R, *jacobians = (np.asarray(o).T for o in function(at))
    matrices = [M.reshape(samples, -1, 3).swapaxes(1, 2) for M in (R, *jacobians)]
    return p, *matrices


def rotations(sizes: int, k: int) -> int:
    """Return how many coordinates turn the body, the last of k: 1, or 3 if free."""
    return (k - sizes) // 2  # of the final pose's 3 or 6, which follow the sizes


def widest_deviations(shape, k: int, place: float, turn: float) -> np.ndarray:
    """Return prior deviations (k,) of sizes, position [m] and rotation [rad].

    Those of the sizes are the shape's, those of the pose are `place` and `turn`.
    """
    sigma = np.full(k, place)
    sigma[: shape.theta] = shape.size_prior[1]
    sigma[k - rotations(shape.theta, k) :] = turn
    return sigma


def prior_deviations(shape, theta) -> np.ndarray:
    """Return the standard deviations (n,) of the prior of each size at the others.

    Of one size, the prior is Student's t of FREEDOM - 1 + n degrees of freedom.
    """
    mean, deviation = (np.broadcast_to(v, shape.theta) for v in shape.size_prior)
    n, square = shape.theta, ((theta - mean) / deviation) ** 2
    others = square.sum() - square
    return deviation * np.sqrt((FREEDOM + n + others) / (FREEDOM + n - 3))


def known_faces(tangent, faces, grounded: bool) -> np.ndarray:
    """Tell which faces (axes, 2) of a body touches or the ground make known.

    faces: samples that touched each; grounded: whether a ground carries the body, which
    touches one face at the first and at the last sample.
    """
    known = np.asarray(faces) >= KNOWN_FACE
    for lean in tangent.up @ [tangent.R_first, tangent.R] if grounded else ():
        down = np.argmax(np.abs(lean))
        known[down, 0 if lean[down] > 0 else 1] |= abs(lean[down]) > VERTICAL
    return known


def open_directions(tangent, C, shape, known) -> tuple[tuple, np.ndarray]:
    """Return words and unit vectors (k, r) for what only the prior determines.

    known: see known_faces.
    """
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
    if shape.faced:
        upright = bool(tangent.up @ tangent.R[:, 2] > VERTICAL)
        return unobserved(known, off, *pose, upright), directions
    sizes = tuple(
        f"{name}: touches leave it open"
        for name in np.array(shape.names)[off > KNOWN_SIZE]
    )
    heading = 0.0 if shape.round else pose[0]  # of a round body means nothing
    return (*sizes, *unobserved((), None, heading, pose[1])), directions


def unobserved(known, sides=None, turn=0.0, way=0.0, upright=True) -> tuple[str, ...]:
    """Name what touches do not determine.

    known (axes, 2): whether each face is; sides (axes,): sigma of each size in
    deviations of its prior, small where edges or physics determine it; turn [rad] and
    way [m]: sigma of rotation and position; upright: whether +z is the top.
    """
    words = []
    for axis, ends in enumerate(known):
        if all(ends) or (sides is not None and sides[axis] < KNOWN_SIZE):
            continue
        name = AXES[axis]
        faces = f"face -{name}", f"face +{name}"
        if upright and name == "z":
            faces = "bottom", "top"
        missing = "neither face"
        if any(ends):
            missing = f"{faces[int(ends[0])]} never"
        words.append(f"side {name}: {missing} touched")
    if turn > OPEN_ROTATION:
        words.append(f"rotation: sigma above {np.degrees(OPEN_ROTATION):.0f} deg")
    if way > OPEN_POSITION:
        words.append(f"position: sigma above {1e3 * OPEN_POSITION:.0f} mm")
    return tuple(words)


def inverse(C) -> np.ndarray:
    """Return the inverse of a covariance, finite also where a direction is known."""
    d = np.sqrt(np.maximum(np.abs(np.diag(C)), LEAST_SIGMA**2))
    values, vectors = np.linalg.eigh(C / np.outer(d, d))
    values = np.where(np.abs(values) < LEAST_VARIANCE, LEAST_VARIANCE, values)
    return (vectors / values) @ vectors.T / np.outer(d, d)
