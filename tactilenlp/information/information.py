r"""What the data say of shape and final pose, and how far off an estimate may be.

matrix   the exact information: the Hessian of the Lagrangian reduced to the null space
         of what is active, past poses and impulses marginalised (curvature.py)
spread   the covariance that `sigma` tells: what sensors, model, assumptions and
         physics are known to err (spread.py), over the modes found (modes.py)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..common.validation import check_types
from ..errors import OptionError
from ..nlp.kkt_sensitivity import Curvature, curvature_of
from .error_budget import ENOUGH, near, spread, unheld, unseen
from .finger_offsets import covariance_of_offsets, covariance_with_offsets
from .mixture import SAME, Modes, weighted
from .tangent_space import WORDS, chart_of

TOUCHED = 0.99  # [-] |n . axis| above which a normal belongs to a face
HELD = 0.1  # [prior deviations] a size known better than this is observed
ASTRAY = 0.05  # [m] a position less certain than this is not observed
LOST = np.radians(45)  # a turn less certain than this is not observed
TINY = 1e-12  # [SI] a deviation below which a number is known exactly
SHARP = 1e-12  # [-] of the other variances: a direction below this is known exactly
MOST = 4  # unknowns that name a direction
HOPELESS = 40.0  # [nats] behind the best: a mode that weighs nothing
RARE = 0.02  # [-] modes of less weight are not spoken of


@dataclass(frozen=True, eq=False)
class Information:
    """Information about the shape and the pose at the last sample.

    names (k,) of the independent unknowns; matrix (k, k) their information, SI; parts:
    what each term adds to it, by name, and roles: each term's role; modes: other local
    optima, with weights; maps: (3, k) Jacobian of every quantity a user asks for by
    name, rows of NaN where a reduction fixed it (`fixed`).  unobserved: words for what
    only the prior holds, directions (k, r): unit vectors [prior deviations] of it;
    active, ambiguous: how many rows of each constraint or bound hold with equality, or
    nearly; indefinite: terms by which the reduced Hessian curves down, and along what;
    offsets (3 F, 3 F) [m^2]: the covariance of fingers that are not where they say;
    with_offsets (k + 3 F, k + 3 F): the matrix without marginalising these.
    """

    names: tuple[str, ...]
    matrix: np.ndarray
    spread: np.ndarray
    parts: dict[str, np.ndarray]
    roles: dict[str, str]
    modes: Modes
    maps: dict[str, np.ndarray]
    unobserved: tuple[str, ...]
    directions: np.ndarray
    fixed: tuple[str, ...]
    active: dict[str, int]
    ambiguous: dict[str, int]
    indefinite: tuple[str, ...]
    offsets: np.ndarray | None = None
    with_offsets: np.ndarray | None = None

    def covariance(self, name: str | None = None) -> np.ndarray:
        """Return the covariance (3, 3) of a quantity, or (k, k) of `names`, SI.

        "finger_offset": (3 F, 3 F), finger by finger, where the scene leaves it open.
        """
        check_types(name=(name, (str, type(None))))
        if name is None:
            return self.spread
        if name == "finger_offset" and self.offsets is not None:
            return self.offsets
        jacobian = self._map(name)
        return jacobian @ self.spread @ jacobian.T

    def sigma(self, name: str) -> np.ndarray:
        """Return standard deviations (3,), SI; NaN where fixed by a reduction.

        "finger_offset": (F, 3), where the scene leaves it open.
        """
        check_types(name=(name, str))
        variance = np.diag(self.covariance(name)).copy()
        variance[variance < 0] = np.inf
        sigma = np.sqrt(variance)
        return sigma.reshape(-1, 3) if name == "finger_offset" else sigma

    def correlation(self) -> np.ndarray:
        """Return the correlation matrix (k, k) of `names`."""
        d = np.sqrt(np.abs(np.diag(self.spread)))
        return self.spread / np.outer(d, d)

    def part(self, name: str) -> np.ndarray:
        """Return what one term, or all terms of a role, add to the matrix (k, k)."""
        check_types(name=(name, str))
        chosen = [n for n, role in self.roles.items() if name in (n, role)]
        if not chosen:
            raise OptionError(
                "no such term or role", where="information", got=name,
                expected=f"one of {sorted({*self.roles, *self.roles.values()})}",
            )  # fmt: skip
        return sum(self.parts[n] for n in chosen)

    @property
    def also(self) -> tuple[str, ...]:
        """Words for the other bodies that explain the data, by how they differ."""
        words = []
        for weight, off in zip(
            self.modes.weights[1:], self.modes.offsets[1:], strict=True
        ):
            if weight < RARE:
                continue
            units = [180 / np.pi if "rotation" in n else 1e3 for n in self.names]
            sigma = np.sqrt(np.maximum(np.diag(self.spread), 0.0))
            most = np.argsort(np.abs(off) / np.where(sigma > 0, sigma, 1.0))[::-1][:2]
            parts = [
                f"{self.names[i]} {off[i] * units[i]:+.1f} "
                f"{'deg' if 'rotation' in self.names[i] else 'mm'}"
                for i in most
            ]
            words.append(f"{weight:.0%} that {', '.join(parts)}")
        return tuple(words)

    def of_hessian(self) -> Information:
        """Return the same, its sigma that of the Hessian alone, of this mode alone."""
        return replace(self, spread=inverse(self.matrix))

    def _map(self, name: str) -> np.ndarray:
        if name not in self.maps:
            raise OptionError(
                "no such quantity",
                where="information",
                got=name,
                expected=f"one of {sorted(self.maps)}",
            )
        return self.maps[name]


def information_of(
    problem, solution, window, shape, faces, R_wg, sensed=None, rivals=(), profile=None
) -> Information:
    """Return the information about theta and the last pose of a solved programme.

    faces: (axes, 2) number of samples that touched each face; R_wg (3, 3): from the
    ground's frame, in which the programme is written, to the world.  sensed: the
    measurements, without which sigma is that of the Hessian; rivals: (problem,
    solution, window) of other local optima; profile (k, k): see profile.py.
    """
    curvature = curvature_of(problem, solution)
    chart = chart_of(problem, solution, window, shape, R_wg)
    pulls, held = curvature.response_of(chart.chosen)
    pulls, held = pulls @ chart.tangent.T, held @ chart.tangent.T
    C = chart.tangent @ pulls[chart.chosen]
    C = (C + C.T) / 2
    errors, doubt = C, np.zeros_like(C)
    if sensed is not None:
        errors = spread(curvature, pulls, held, sensed, window, shape) + unheld(C)
    best = chart.z, chart.R, solution.objective, errors
    modes = weighted(shape, chart.turning, [best, *_others(best, rivals, shape, R_wg)])
    if sensed is not None:
        noise, grounded = sensed.precision.position, len(window.corner) > 0
        doubt = unseen(chart, shape, faces, noise, grounded)
        doubt += _beyond(profile, modes.covariance)
    matrix, spreading = inverse(C), modes.covariance + doubt
    offsets = covariance_of_offsets(curvature, sensed, window, shape, R_wg)
    with_offsets = None
    if offsets is not None:
        with_offsets = inverse(covariance_with_offsets(curvature, chart))
    parts = {
        name: matrix @ (pulls.T @ (H @ pulls)) @ matrix
        for name, H in curvature.hessians.items()
    }
    terms = problem.terms
    words, directions = _lost(chart, spreading, shape, faces)
    if sensed is not None:
        spreading = near(spreading, shape.theta, chart.turning)
    return Information(
        names=chart.names,
        matrix=matrix,
        spread=spreading,
        parts=parts,
        roles={name: terms[name].role or "constraint" for name in parts},
        modes=modes,
        maps=chart.maps,
        unobserved=words,
        directions=directions,
        fixed=chart.fixed,
        active=curvature.active,
        ambiguous=curvature.ambiguous,
        indefinite=_indefinite(curvature),
        offsets=offsets,
        with_offsets=with_offsets,
    )


def _beyond(profile, C) -> np.ndarray:
    """Return the covariance (k, k) that the profile (k, k) has beyond C.

    Of a row, what the rows before have not told already.
    """
    beyond = np.zeros_like(C)
    for i, off in enumerate(() if profile is None else profile):
        more = off[i] ** 2 - max(C[i, i], 0.0) - beyond[i, i]
        if more > 0:
            beyond += more / off[i] ** 2 * np.outer(off, off)
    return beyond


def _others(best, rivals, shape, R_wg):
    """Yield z, R, objective and covariance of other local optima that count."""
    for problem, solution, window in rivals:
        chart = chart_of(problem, solution, window, shape, R_wg)
        same = len(chart.z) == len(best[0]) and np.abs(chart.z - best[0]).max() < SAME
        if same or solution.objective > best[2] + HOPELESS:
            continue
        C, *_ = reduced_covariance(problem, solution, chart.chosen)
        yield chart.z, chart.R, solution.objective, chart.tangent @ C @ chart.tangent.T


def reduced_covariance(problem, solution, chosen: np.ndarray):
    """Return covariance of the chosen unknowns (SI), active and ambiguous counts.

    chosen: indices into the vector of all unknowns.
    """
    curvature = curvature_of(problem, solution)
    C = curvature.response_of(chosen)[0][chosen]
    counts = (sum(n.values()) for n in (curvature.active, curvature.ambiguous))
    return (C + C.T) / 2, *counts


def inverse(C) -> np.ndarray:
    """Return the inverse of a covariance, finite also where a direction is known."""
    d = np.sqrt(np.maximum(np.abs(np.diag(C)), TINY**2))
    values, vectors = np.linalg.eigh(C / np.outer(d, d))
    values = np.where(np.abs(values) < SHARP, SHARP, values)
    return (vectors / values) @ vectors.T / np.outer(d, d)


def _indefinite(curvature: Curvature) -> tuple[str, ...]:
    """Name the term and the unknowns along which the reduced Hessian curves down."""
    if curvature.negative is None:
        return ()
    term, direction = curvature.negative
    share = np.abs(direction / curvature.problem.scale)
    worst, where = np.argsort(share)[::-1][:MOST], []
    for name, v in curvature.problem.variables.items():
        for i in worst[(worst >= v.first) & (worst < v.span.stop)] - v.first:
            where.append(f"{name}[{i % v.rows}, {i // v.rows}]")
    return (f"{term} along {', '.join(where)}",)


def _lost(chart, C, shape, faces):
    """Return words and unit vectors (k, r) for what only the prior holds."""
    n = shape.theta
    prior = np.ones(len(C)) * ASTRAY
    prior[:n] = shape.size_prior[1]
    prior[len(C) - chart.turning :] = LOST
    values, vectors = np.linalg.eigh(C / np.outer(prior, prior))
    directions = vectors[:, values > HELD**2]
    deviation = np.sqrt(np.abs(np.diag(C)))
    turn, way = (
        chart.maps[name] @ np.diag(deviation) for name in ("rotation", "position")
    )
    words = unobserved(
        faces, deviation[:n] / shape.size_prior[1],
        np.linalg.norm(np.nan_to_num(turn)), np.linalg.norm(way),
    )  # fmt: skip
    return words, directions


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
