"""`Information`: what is known of shape, pose and trajectory, asked for by name."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from ..common.brief import printed
from ..common.layout import ANY
from ..common.validation import check_one_of, check_sample, check_types
from ..errors import OptionError
from .consider_parameters import Considered
from .error_budget import POOR_FIT, deviations, variances, with_ground
from .mixture import Modes, one_mode
from .tangent_space import inverse

POSE = {"position": slice(3), "rotation": slice(3, 6)}  # in `path` and `ground`
LEAST_DEVIATION = 1e-6  # [m] deviation of what a bound holds: a vertex on the ground


@printed
@dataclass(frozen=True, eq=False)
class Information:
    """Information about the shape and the pose at the last sample.

    names: (k,) of the unknowns of `matrix`
    matrix: (k, k) information of these, SI
    covariance_matrix: (k, k) their covariance, SI
    parts: (k, k) of each term, by name: they add up to `matrix`, but for directions
        that constraints or bounds alone hold, as hard dynamics hold a size together
        with the pose (shooting, multiple_shooting), and bounds the vertices of a hull
        on the ground: no part has what holds these, and shares mean nothing there
    roles: role of each term, by name
    modes: local optima with weights, the reported one first
    maps: (3, k) Jacobian of each quantity that a user asks for, by name; rows of NaN
        where a reduction fixed it (`fixed`)
    unobserved: words for directions that only the prior determines
    directions: (k, r) unit vectors of these [prior deviations]
    active, ambiguous: count of rows of each constraint or bound that hold with
        equality, or nearly, by name
    indefinite: terms with negative curvature in the reduced Hessian, and its direction
    offsets: (3 F, 3 F) [m^2] covariance of errors of finger positions
    with_offsets: (k + 3 F, k + 3 F) the matrix without marginalising these
    path: (T, 6) deviations of position [m] and rotation [rad] of samples, world frame
    ground: (6, 6) part of the covariance of final position and rotation that is due to
        the tilt of the ground, in planar motion
    considered: what touches tell of quantities that the page fixes, by name
    budget: (n,) variances of `names`, then of the rows of `maps`, by each error alone,
        by the names of error_budget.py: they add up to those of covariance_matrix; zero
        ones are left out, and all in older files
    """

    names: tuple[str, ...]
    matrix: np.ndarray
    covariance_matrix: np.ndarray
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
    path: np.ndarray | None = None
    ground: np.ndarray | None = None
    considered: dict[str, Considered | np.ndarray] = field(default_factory=dict)
    budget: dict[str, np.ndarray] = field(default_factory=dict)

    LAYOUT: ClassVar = {  # of the arrays in a file
        "names": ("k",),
        "matrix": ("k", "k"),
        "covariance_matrix": ("k", "k"),
        "parts/*": ("k", "k"),
        "maps/*": (ANY, "k"),
        **{f"maps/{name}": (3, "k") for name in ("position", "rotation")},
        "maps/side_lengths": (3, "k"),
        "modes/weights": ("m",),
        "modes/offsets": ("m", "k"),
        "modes/covariances": ("m", "k", "k"),
        "modes/objectives": ("m",),
        "directions": ("k", "r"),
        "offsets": ("f", "f"),
        "with_offsets": ("both", "both"),
        "path": ("T", 6),
        "ground": (6, 6),
        "considered/*": (3,),
        "budget/*": ("n",),
    }
    NAMES_IN_FILES: ClassVar = {"covariance_matrix": "spread"}

    @classmethod
    def from_file(cls, maps, considered=(), budget=(), **others) -> Information:
        """Return what a file holds: arrays of `considered`, older budgets (k, k)."""
        by_name = {n: Considered(*map(float, v)) for n, v in dict(considered).items()}
        errors = dict(budget).items()
        errors = {n: v if v.ndim == 1 else variances(v, maps) for n, v in errors}
        return cls(maps=maps, considered=by_name, budget=errors, **others)

    def covariance(self, name: str | None = None) -> np.ndarray:
        """Return the covariance (3, 3) of a quantity, or (k, k) of `names`, SI.

        name: one of `maps`, as "position" [m], "rotation" [rad], "side_lengths" or
        "vertices" [m]; "finger_offset" [m]: (3 F, 3 F), finger by finger, where the
        scene leaves it open.  Raises OptionError of other names.
        """
        check_types(name=(name, (str, type(None))))
        if name is None:
            return self.covariance_matrix
        if name == "finger_offset" and self.offsets is not None:
            return self.offsets
        check_one_of("information", name, sorted(self.maps), "no such quantity")
        jacobian = self.maps[name]
        C = jacobian @ self.covariance_matrix @ jacobian.T
        if self.ground is None or name not in POSE:
            return C
        return np.nan_to_num(C) + self.ground[POSE[name], POSE[name]]

    def error_budget(self, name: str | None = None) -> dict[str, np.ndarray]:
        """Return standard deviations by each error alone, SI, the largest first.

        (3,) of a quantity, or (k,) of `names`: their squares add up to those of sigma.
        error_budget.py says what each error is.  name: as of `covariance`.  Raises
        OptionError of other names, and of an estimate that has no error budget.
        """
        total = np.diag(self.covariance(name))
        if not self.budget or name == "finger_offset":
            raise OptionError(
                "no error budget", where="information", got=name,
                expected=f"one of {sorted(self.maps)}, of an estimate of this version",
            )  # fmt: skip
        at, k = [None, *self.maps].index(name), len(self.names)
        ends = np.cumsum([0, k, *map(len, self.maps.values())])
        errors = {e: v[ends[at] : ends[at + 1]] for e, v in self.budget.items()}
        if self.ground is not None and name in POSE:
            traces = {e: v[:k].sum() for e, v in self.budget.items()}
            errors = with_ground(errors, np.diag(self.ground)[POSE[name]], traces)
        return deviations(errors, total if name is None else 1.0)

    def sigma(self, name: str, sample: int | None = None) -> np.ndarray:
        """Return standard deviations (3,), SI; NaN where fixed, on an exact ground.

        "finger_offset": (F, 3), where the scene leaves it open.  sample: of the
        trajectory, for "position" and "rotation"; the last one by default.
        """
        check_types(name=(name, str))
        if sample is not None:
            along = self.along_path(name)
            check_sample(sample, len(along))
            return along[sample]
        variance = np.diag(self.covariance(name)).copy()
        variance[variance < 0] = np.inf
        sigma = np.sqrt(variance)
        return sigma.reshape(-1, 3) if name == "finger_offset" else sigma

    def along_path(self, name: str) -> np.ndarray:
        """Return standard deviations (T, 3) at every sample, world frame.

        name: "position" [m] or "rotation" [rad].  Raises OptionError of other names,
        and of an estimate that has none.
        """
        if name not in [*POSE] or self.path is None:
            raise OptionError(
                "no such deviations of a trajectory", where="information", got=name,
                expected=f"one of {sorted(POSE)}, of an estimate of this version",
            )  # fmt: skip
        return self.path[:, POSE[name]]

    def correlation(self) -> np.ndarray:
        """Return the correlation matrix (k, k) of `names`."""
        d = np.sqrt(np.abs(np.diag(self.covariance_matrix)))
        return self.covariance_matrix / np.outer(d, d)

    def part(self, name: str) -> np.ndarray:
        """Return what one term, or all terms of a role, add to the matrix (k, k).

        name: of a term, or a role of costs, or "constraint".  Raises OptionError of
        others.
        """
        check_types(name=(name, str))
        names = sorted({*self.roles, *self.roles.values()})
        check_one_of("information", name, names, "no such term or role")
        return sum(self.parts[n] for n, role in self.roles.items() if name in (n, role))

    def widened(self, factor: float) -> Information:
        """Return the same, all standard deviations multiplied by a factor."""
        powers = {"covariance_matrix": 2, "ground": 2, "offsets": 2, "path": 1}
        own = {n: v for n, v in vars(self).items() if n in powers and v is not None}
        wide = {n: factor ** powers[n] * v for n, v in own.items()}
        if (budget := self.budget) and factor != 1.0:
            more = variances((factor**2 - 1) * self.covariance_matrix, self.maps)
            budget = budget | {POOR_FIT: budget.get(POOR_FIT, 0.0) + more}
        return replace(self, budget=budget, **wide)

    def of_hessian(self) -> Information:
        """Return the same, its sigma that of the Hessian alone, of one optimum."""
        return self.of_matrix(self.matrix)

    def of_matrix(self, matrix, covariance=None) -> Information:
        """Return the information of another kind, of one optimum.

        matrix (k, k), covariance (k, k): about `names`, SI; by default its inverse.
        """
        covariance = inverse(matrix) if covariance is None else covariance
        return replace(
            self, matrix=matrix, covariance_matrix=covariance, parts={}, roles={},
            budget={}, modes=one_mode(self.modes.objectives[0], covariance),
            path=None, ground=None, offsets=None, with_offsets=None,
        )  # fmt: skip


def vertex_information(estimate) -> np.ndarray:
    """Return log det of the information about each vertex (V,), the others unknown.

    In nats, of lengths in metres: what colours the vertices of the paper's figures.
    estimate: of a polytope; OptionError of others.
    """
    check_types(estimate=(estimate, "Estimate"))
    C, V = estimate.information.covariance("vertices"), len(estimate.vertices)
    blocks = np.einsum("iaib->iab", C.reshape(V, 3, V, 3))
    return -np.linalg.slogdet(blocks + LEAST_DEVIATION**2 * np.eye(3))[1]
