"""Judge a cell of the stress suite: correct, covered by sigma, or refused.

A cell solves one Case and returns rows, one for each part: the estimate, its
information, the expected information gain.  The truth is read here, never by the
package.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from judging import placed, planes_off, refusal
from scipy.spatial.transform import Rotation
from trimesh.creation import box

from tactilenlp import (
    ExpectedInformation,
    Guess,
    Measurements,
    Options,
    Scene,
    Workspace,
    observed_information,
    solve_estimate,
)
from tactilenlp.errors import TactileError
from tactilenlp.estimation.observed_information import INFORMATION_KINDS
from tactilenlp.evaluation import metrics
from tactilenlp.geometry.convex_hull import centroid
from tactilenlp.geometry.transforms import rotation_of

RIGHT, HONEST, ERROR = "right", "honest sigma", "typed error"
WRONG, NAN, OFF = "confident wrong", "not finite", "rule broken"
CRASH, HANG = "crash", "hang"
GOOD = (RIGHT, HONEST)
COLOURS = {
    RIGHT: "#2c7bb6", HONEST: "#9ecae1", ERROR: "#fdd49e", WRONG: "#d7191c",
    NAN: "#7b3294", OFF: "#e66101", CRASH: "#000000", HANG: "#525252",
}  # fmt: skip
CLOSE, SIGMAS = 1e-3, 5.0  # [m], [-]: an error beyond both is a confident wrong answer
RULE = "right to 1 mm, or no error beyond 5 sigma"
GROWING = "inverse_dynamics"  # kept for comparison: may overflow, if it says so
ACTIONS = 5  # whose expected gain is asked for

WAYS = {  # name -> shape, formulation
    "cuboid": ("cuboid", "violation_implicit"),
    "polytope": ("polytope", "violation_implicit"),
    "quasi-static": ("cuboid", "quasi_static"),
    "shooting": ("cuboid", "shooting"),
    "multiple shooting": ("cuboid", "multiple_shooting"),
    "complementarity": ("cuboid", "complementarity"),
}
WHOLE = ("cuboid", "polytope")  # whose information and gain are judged as well


@dataclass(frozen=True, eq=False)
class Truth:
    """What no sensor measures: sides (3,) [m], position (T, 3), quaternion (T, 4)."""

    sides: np.ndarray
    position: np.ndarray
    quaternion: np.ndarray


@dataclass(frozen=True, eq=False)
class Case:
    """What is estimated, how, and the truth that judges it."""

    data: Measurements
    scene: Scene
    truth: Truth
    options: Options = field(default_factory=Options)
    start: Guess | None = None
    page: object = None  # instead of the way's own


def row(part, verdict, error=np.nan, sigma=np.nan, words="") -> dict:
    """Return one row: error and its sigma in mm, in words what was found."""
    ratio = error / sigma if sigma > 0 else np.nan
    return {
        "part": part, "verdict": verdict, "error_mm": 1e3 * error,
        "sigma_mm": 1e3 * sigma, "sigmas": ratio, "words": words,
    }  # fmt: skip


def refused(error: TactileError, part="estimate") -> dict:
    """Return the row of an error that the package raised on purpose."""
    return row(part, ERROR, words=refusal(error))


def solved(case: Case, way: str):
    """Return the estimate of a case."""
    shape, formulation = WAYS[way]
    return solve_estimate(
        case.data, case.scene, shape=shape, formulation=case.page or formulation,
        options=case.options, start=case.start,
    )  # fmt: skip


def judged(case: Case, way: str) -> list[dict]:
    """Return the rows of a case solved one way."""
    try:
        estimate = solved(case, way)
    except TactileError as error:
        return [refused(error)]
    rows = [against_truth(estimate, case.truth)]
    return rows + (whole(estimate) if way in WHOLE else [])


def against_truth(estimate, truth: Truth) -> dict:
    """Return the row of an estimate: its worst error, in sigma if beyond CLOSE."""
    found = [estimate.theta, estimate.position, estimate.quaternion]
    if not all(np.isfinite(f).all() for f in found):
        return row("estimate", NAN)
    errors = (_of_box if estimate.shape == "cuboid" else _of_polytope)(estimate, truth)
    numbers = np.array([(e, s) for _, e, s in errors])
    if np.isnan(numbers[:, 1]).any():
        return row("estimate", NAN, words="a sigma is not a number")
    beyond = (numbers[:, 0] > CLOSE) & (numbers[:, 0] > SIGMAS * numbers[:, 1])
    ratio = numbers[:, 0] / np.maximum(numbers[:, 1], 1e-12)
    worst = np.argmax(np.where(beyond, ratio, 0) if beyond.any() else numbers[:, 0])
    good = RIGHT if (numbers[:, 0] <= CLOSE).all() else HONEST
    verdict = WRONG if beyond.any() else good
    return row("estimate", verdict, *numbers[worst], words=errors[worst][0])


def _of_box(estimate, truth):
    """Return (name, error, sigma) [m] of sizes and final pose, a turn at its corners.

    What a reduction fixed has no sigma: it is held to be exact.  The axes are named as
    those of the true body where the rotation is better known: at the first or the last
    sample.
    """
    last, sigma = estimate.measurements.samples - 1, estimate.information.sigma
    spread = [np.nan_to_num(sigma("rotation", sample=k)).sum() for k in (0, last)]
    known = (0, last)[int(np.argmin(spread))]
    error = metrics.cuboid_errors(
        *(estimate.side_lengths, estimate.position[known], estimate.quaternion[known]),
        *(truth.sides, truth.position[known], truth.quaternion[known]),
    )
    axes = Rotation.from_matrix(error.symmetry)
    named = rotation_of(estimate.quaternion[last]) * axes
    turn = (named * rotation_of(truth.quaternion[last]).inv()).as_rotvec()
    arm, turning = np.linalg.norm(truth.sides) / 2, sigma("rotation")
    if estimate.information.fixed:
        turning = np.nan_to_num(turning)
    out = []
    for name, errors, sigmas in (
        ("side", error.side_lengths, sigma("side_lengths")[error.permutation]),
        ("position", estimate.position[last] - truth.position[last], sigma("position")),
        ("turn about", arm * turn, arm * turning),
    ):
        out += [
            (f"{name} {axis}", abs(e), s)
            for axis, e, s in zip("xyz", errors, sigmas, strict=True)
        ]
    return out


def _of_polytope(estimate, truth):
    """Return (name, error, sigma) [m] of the faces that were touched.

    The error of a face is how far off the true body's support is along its normal.
    """
    true = placed(box(truth.sides), truth.position[-1], truth.quaternion[-1])
    vertices = estimate.vertices @ estimate.rotation().T + estimate.position[-1]
    out = []
    planes = estimate.supporting_planes()
    off = planes_off(planes, true)
    for i in np.flatnonzero(planes.touches):
        touched = f"face {i}, {planes.touches[i]} touches"
        out.append((touched, off[i], planes.sigma[i]))
    middle = np.abs(centroid(vertices) - truth.position[-1])
    sigma = estimate.information.sigma("position")
    return out + [
        (f"centroid {axis}", e, s)
        for axis, e, s in zip("xyz", middle, sigma, strict=True)
    ]


def whole(estimate) -> list[dict]:
    """Return the rows of an estimate's information, and of what actions may tell."""
    rows = []
    for part, check in (("information", _informed), ("gain", _gains)):
        try:
            rows.append(check(estimate))
        except TactileError as error:
            rows.append(refused(error, part))
    return rows


def _informed(estimate) -> dict:
    """Return the row: all kinds are finite, symmetric, and curve down only by name."""
    ours = estimate.shape == "cuboid" and estimate.formulation in (
        formulation for _, formulation in WAYS.values()
    )
    for kind in INFORMATION_KINDS if ours else ("exact",):
        try:
            info = observed_information(estimate, kind)
        except TactileError as error:
            if kind != GROWING:
                raise
            return row("information", RIGHT, words=f"{kind} refused: {error.what}")
        M, C = info.matrix, info.covariance()
        if not (np.isfinite(M).all() and np.isfinite(C).all()):
            return row("information", NAN, words=kind)
        tilt = np.abs(M - M.T).max() / np.abs(M).max()
        if tilt > 1e-6:
            return row("information", OFF, words=f"{kind}: asymmetric by {tilt:.1g}")
        if kind == "exact" and (np.diag(C) < 0).any() and not info.indefinite:
            return row("information", OFF, words="a negative variance, not named")
    return row("information", RIGHT)


def _gains(estimate) -> dict:
    """Return the row: what any action may tell is finite, and not less than nothing."""
    radius = estimate.measurements.finger_radius
    space = Workspace(
        fingers=len(radius), finger_radius=float(radius.max()),
        radius=max(0.1, 3 * float(radius.max())), ground=estimate.scene.ground,
    )  # fmt: skip
    expected, rng = ExpectedInformation(estimate, space), np.random.default_rng(0)
    gains = np.array([expected.gain(space.random(rng)) for _ in range(ACTIONS)])
    if not np.isfinite(gains).all():
        return row("gain", NAN)
    said = f"{gains.min():.2f} to {gains.max():.2f} nats"
    return row("gain", RIGHT if gains.min() >= -1e-9 else OFF, words=said)


def same(name: str, off: float, limit: float, unit: str) -> dict:
    """Return the row of two results that must agree within a limit."""
    verdict = RIGHT if off <= limit else OFF
    verdict = verdict if np.isfinite(off) else NAN
    words = f"{off:.2g} {unit}, limit {limit:.2g}"
    return row(name, verdict, words=words)


@dataclass(frozen=True, eq=False)
class Axis:
    """One row of the suite: what is varied, its rule, and who runs it.

    check(value, way) returns the rows of a cell; ways: the values that each way runs,
    all of them for True; may_refuse: (value, way) of cells that may end with a typed
    error, said beforehand; a value or way of "*" stands for every one.
    """

    name: str
    rule: str
    values: tuple[str, ...]
    check: Callable[[str, str], list[dict]]
    ways: dict[str, object]
    may_refuse: tuple[tuple[str, str], ...] = ()

    def cells(self) -> list[tuple[str, str, str]]:
        """Return (axis, value, way) of every cell."""
        return [
            (self.name, value, way)
            for way, values in self.ways.items()
            for value in (self.values if values is True else values)
        ]

    def allows(self, value: str, way: str) -> bool:
        """Tell whether the cell may end with a typed error."""
        listed = ((value, way), ("*", way), (value, "*"))
        return any(cell in self.may_refuse for cell in listed)


def estimated(case_at: Callable[[str], Case]) -> Callable:
    """Return the check of an axis whose values are cases to be estimated."""
    return lambda value, way: judged(case_at(value), way)
