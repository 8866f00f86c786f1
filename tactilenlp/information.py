r"""What the data say of shape and final pose: the exact reduced Hessian.

At the optimum of the joint programme, with L its Lagrangian and A the Jacobian of the
constraints and bounds that are active, the covariance of chosen unknowns is the block

    C = E' K^{-1} E,     K = [ H  A' ]      H = nabla^2 L  (exact)
                             [ A  0  ]

which is the Hessian reduced to the null space of A with every other unknown (past
poses, impulses) marginalised by a Schur complement.  The information is C^{-1}.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from .errors import OptionError

LOOSE = 1e-9  # [1 / scaled unknown^2] of a direction that nothing sees
TOUCHED = 0.99  # [-] |n . axis| above which a normal belongs to a face
HELD = 0.1  # [prior deviations] a size known better than this is observed
ASTRAY = 0.05  # [m] a position less certain than this is not observed
LOST = np.radians(45)  # a turn less certain than this is not observed
ENOUGH = 3  # contact samples that make a face known
WORDS = ("x", "y", "z")
UNKNOWNS = {  # the words for the unknowns of a pose, by motion
    "planar": ("position x", "position y", "rotation z"),
    "free": tuple(f"{what} {w}" for what in ("position", "rotation") for w in WORDS),
}


@dataclass(frozen=True, eq=False)
class Information:
    """Information about the shape and the pose at the last sample.

    names (k,) of the independent unknowns, matrix (k, k) their information and
    covariance (k, k), SI; maps: (3, k) Jacobian of every quantity a user asks for by
    name, rows of NaN where a reduction fixed it (`fixed`).  unobserved: words for
    directions that only the prior holds; active: constraints that hold with equality;
    ambiguous: those neither clearly active nor inactive; indefinite: the reduced
    Hessian has a direction of no or negative curvature.
    """

    names: tuple[str, ...]
    matrix: np.ndarray
    maps: dict[str, np.ndarray]
    unobserved: tuple[str, ...]
    fixed: tuple[str, ...]
    active: int
    ambiguous: int
    indefinite: bool

    def covariance(self, name: str) -> np.ndarray:
        """Return the covariance (3, 3) of a quantity, SI."""
        jacobian = self._map(name)
        return jacobian @ self._inverse() @ jacobian.T

    def sigma(self, name: str) -> np.ndarray:
        """Return standard deviations (3,), SI; NaN where fixed by a reduction."""
        variance = np.diag(self.covariance(name)).copy()
        variance[variance < 0] = np.inf
        return np.sqrt(variance)

    def correlation(self) -> np.ndarray:
        """Return the correlation matrix of `names`."""
        C = self._inverse()
        d = np.sqrt(np.abs(np.diag(C)))
        return C / np.outer(d, d)

    def _inverse(self) -> np.ndarray:
        return np.linalg.inv(self.matrix)

    def _map(self, name: str) -> np.ndarray:
        if name not in self.maps:
            raise OptionError(
                "no such quantity",
                where="information",
                got=name,
                expected=f"one of {sorted(self.maps)}",
            )
        return self.maps[name]


def observed_information(estimate, kind: str = "exact") -> Information:
    """Return what the data of an estimate say of shape and final pose.

    kind: "exact", the reduced Hessian of the Lagrangian.
    """
    if kind != "exact":
        raise OptionError(
            "no such information", where="kind", got=kind, expected="'exact'"
        )
    return estimate.information


def reduced_covariance(problem, solution, chosen: np.ndarray):
    """Return covariance of the chosen unknowns (SI), active and ambiguous counts.

    chosen: indices into the vector of all unknowns.
    """
    x = problem.pack(solution.values)
    data = problem.data(solution.parameters)
    scale = problem.scale
    H = sum(problem.hessian(name, x, data) for name in problem.costs)
    rows, active, ambiguous = [], 0, 0
    for name, term in problem.constraints.items():
        multiplier = solution.multipliers[name]
        H = H + problem.hessian(name, x, data, multiplier)
        value = problem.value(name, x, data)
        slack = np.minimum(value - term.lower, term.upper - value).ravel()
        on, unsure = _active(np.abs(multiplier).ravel(), slack)
        rows.append(problem.jacobian(name, x, data)[on])
        active, ambiguous = active + on.sum(), ambiguous + unsure.sum()
    lower, upper = problem.bounds("lower"), problem.bounds("upper")
    slack = np.minimum(x - lower, upper - x) / scale
    lam = np.abs(problem.pack(solution.bound_multipliers)) * scale
    on, unsure = _active(lam, slack)
    rows.append(sp.identity(len(x), format="csc")[np.nonzero(on)[0]])
    A = sp.vstack(rows, format="csc")
    C = _kkt_block(H, A, scale, chosen)
    return C, int(active + on.sum()), int(ambiguous + unsure.sum())


def _active(multiplier, slack):
    """Classify: active where the multiplier outweighs the slack; unsure near a tie."""
    on = multiplier > slack
    unsure = (multiplier > 1e-2 * slack) & (multiplier < 1e2 * slack)
    return on, unsure


def _kkt_block(H, A, scale, chosen) -> np.ndarray:
    D = sp.diags(scale)
    H = D @ H @ D + LOOSE * sp.identity(H.shape[0])
    A = A @ D
    norms = np.sqrt(np.asarray(A.multiply(A).sum(axis=1)).ravel())
    A = sp.diags(1 / np.maximum(norms, 1e-12)) @ A
    K = sp.bmat([[H, A.T], [A, -LOOSE * sp.identity(A.shape[0])]], format="csc")
    E = np.zeros((K.shape[0], len(chosen)))
    E[chosen, np.arange(len(chosen))] = 1.0
    C = splu(K, permc_spec="MMD_AT_PLUS_A").solve(E)[chosen]  # a tenth of the fill
    C = (C + C.T) / 2
    return C * np.outer(scale[chosen], scale[chosen])


def information_of(problem, solution, window, shape, faces, R_wg) -> Information:
    """Return the information about theta and the last pose of a solved programme.

    faces: (axes, 2) number of samples that touched each face; R_wg (3, 3): from the
    ground's frame, in which the programme is written, to the world.
    """
    theta, x = problem.variables["theta"], problem.variables["x"]
    chosen = np.r_[
        np.arange(theta.span.start, theta.span.stop),
        np.arange(x.span.stop - x.rows, x.span.stop),
    ]
    C, active, ambiguous = reduced_covariance(problem, solution, chosen)
    deviation = np.sqrt(np.abs(np.diag(C)))
    lowest = np.linalg.eigvalsh(C / np.outer(deviation, deviation))[0]
    maps, fixed = _maps(shape, window.motion, solution, R_wg)
    sides = deviation[: theta.rows] / shape.size_prior[1]
    turn, way = (maps[name] @ np.diag(deviation) for name in ("rotation", "position"))
    return Information(
        names=(*(f"side {w}" for w in WORDS), *UNKNOWNS[window.motion.name]),
        matrix=np.linalg.inv(C),
        maps=maps,
        unobserved=unobserved(
            faces, sides, np.linalg.norm(np.nan_to_num(turn)), np.linalg.norm(way)
        ),
        fixed=fixed,
        active=active,
        ambiguous=ambiguous,
        indefinite=bool(lowest <= 0),
    )


def _maps(shape, motion, solution, R_wg):
    """Return how sizes, position and a small turn follow from the unknowns, (3, k).

    A turn is a rotation vector in the world frame; rows of NaN where the motion fixes
    it, and the words for them.
    """
    import casadi as ca

    n = shape.theta
    z = ca.SX.sym("z", n + motion.unknowns)
    p, R = motion.pose(shape, z[:n], z[n:])
    slopes = [ca.jacobian(ca.vec(ca.densify(R)), z[i]) for i in range(z.numel())]
    turns = [ca.inv_skew(ca.reshape(dR, 3, 3) @ R.T) for dR in slopes]
    function = ca.Function("maps", [z], [ca.jacobian(p, z), ca.horzcat(*turns)])
    at = np.r_[solution.values["theta"][:, 0], solution.values["x"][:, -1]]
    position, rotation = (np.asarray(ca.DM(m)) for m in function(at))
    rotation = R_wg @ rotation
    still = ~rotation.any(axis=1)
    rotation[still] = np.nan
    fixed = [f"rotation {w}" for w, held in zip(WORDS, still, strict=True) if held]
    if motion.name == "planar" and not fixed:
        fixed = ["tilt against the ground"]
    maps = {"side_lengths": np.eye(n, n + motion.unknowns), "position": R_wg @ position}
    return maps | {"rotation": rotation}, tuple(fixed)


def unobserved(faces, sides=None, turn=0.0, way=0.0) -> tuple[str, ...]:
    """Name what touch does not hold.

    faces (axes, 2): samples that touched each face; sides (axes,): sigma of each size
    in deviations of its prior, a small one is held by edges or physics; turn [rad] and
    way [m]: sigma of rotation and position.
    """
    words = []
    for axis, (low, high) in enumerate(faces):
        if sides is not None and sides[axis] < HELD:
            continue
        missing = [s for s, n in (("-", low), ("+", high)) if n < ENOUGH]
        if axis == 2:
            if high < ENOUGH:
                words.append("side z: top never touched")
        elif len(missing) == 2:
            words.append(f"side {WORDS[axis]}: neither face touched")
        elif missing:
            face = f"{missing[0]}{WORDS[axis]}"
            words.append(f"side {WORDS[axis]}: face {face} never touched")
    if turn > LOST:
        words.append("rotation: no side says which way the object is turned")
    if way > ASTRAY:
        words.append("position: no side says where on the ground the object lies")
    return tuple(words)
