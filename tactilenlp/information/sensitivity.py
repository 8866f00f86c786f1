r"""Compute the parametric sensitivity of an estimate to what was assumed.

    dz/da = - K^{-1} [ d^2 L / dx da ]
                     [ d g   / da    ]

for mass, frictions, sensor noise and finger offsets a, by the factorised K of the
solution and central differences of exact gradients: no solve is repeated.  It holds as
long as no contact changes its state.

Edges are assumed to be sharp.  With a radius r, common to all of them, what a finger of
radius rho feels is the body `shape.rounded(theta, r)`, grown by r: the touch cost of
that theta and of rho + r.  With b the derivative by r of its gradient,

    dx/dr = -K^{-1} b,      I = 1 / EDGE^2 + L_rr + b . dx/dr,      m = max(0, -L_r) / I

are how the estimate moves with r, what is known of r, and where it is likeliest.  A
body is as likely sharp as rounded before any touch (r Gaussian, of deviation EDGE), so
that

    E[r^2] = (1 / I + m^2) / (1 + EDGE sqrt(I) exp(-I m^2 / 2)) :

touches of both edges and faces of a side tell whether edges are sharp.  In the same
way normals are taken as those of their instant; there r is the lag of the sensors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..common.brief import printed
from ..data.contact_segments import consecutive_contacts
from ..errors import OptionError
from ..nlp.kkt import gradient
from ..nlp.kkt_sensitivity import KKTSystem
from .measurement_noise import at_touches

ASSUMPTION_STEP = 1e-4  # [-] relative change of what was assumed
OFFSET = 1e-6  # [m] shift of a finger
LATE = 1e-5  # [s] change of a lag, of differences
LAG = 10e-3  # [s] deviation of r: sensors average over up to 20 ms
RADIUS = 1e-5  # [m] change of the radius of edges, of differences
EDGE = 2e-3  # [m] deviation of r: machined, printed and card boxes have up to 3 mm


@printed
@dataclass(frozen=True, eq=False)
class Sensitivity:
    """By how much shape and final pose move with each assumption.

    names (k,) of the unknowns; moves: (k,) [SI per unit] by assumption; maps as in
    Information; units: by what a move is divided, by assumption.
    """

    names: tuple[str, ...]
    moves: dict[str, np.ndarray]
    units: dict[str, str]
    maps: dict[str, np.ndarray]

    def of(self, quantity: str, assumption: str) -> np.ndarray:
        """Return how a quantity (3,) moves with an assumption, SI per unit of it."""
        for name, known in ((quantity, self.maps), (assumption, self.moves)):
            if name not in known:
                raise OptionError(
                    "no such name", where="sensitivity", got=name,
                    expected=f"one of {sorted(known)}",
                )  # fmt: skip
        return self.maps[quantity] @ self.moves[assumption]


def parameter_sensitivity(
    curvature, pulls, held, change: dict, relative=False
) -> np.ndarray:
    """Return the derivative of the chosen unknowns (k,) by parameters of the problem.

    change: by how much each parameter changes per unit, by name; relative: in units of
    the parameter's value.
    """
    problem, ends = curvature.problem, []
    for side in (1, -1):
        data = curvature.data.copy()
        for name, amount in change.items():
            span = problem.parameters[name].span
            size = data[span] if relative else np.ones_like(data[span])
            data[span] += side * ASSUMPTION_STEP * amount * size
        ends.append(kkt_residual(problem, curvature, data))
    return _difference(pulls, held, ends, ASSUMPTION_STEP)


def assumption_sensitivities(
    curvature: KKTSystem, pulls, held, build: Callable, scene, window
) -> tuple[dict, dict]:
    """Return the derivatives (k,) by assumption, and their units, of a solved problem.

    build(scene, window) builds the problem again under other assumptions.
    """
    found, units = {}, {}

    def add(name, unit, changed, step):
        ends = [
            kkt_residual(build(*changed(side * step)), curvature) for side in (1, -1)
        ]
        found[name], units[name] = _difference(pulls, held, ends, step), unit

    for name, unit in (
        ("mass", "kg"),
        ("friction_ground", "1"),
        ("friction_finger", "1"),
    ):
        value = getattr(scene, name)
        if value:
            add(
                name, unit,
                lambda d, n=name, v=value: (replace(scene, **{n: v + d}), window),
                ASSUMPTION_STEP * value,
            )  # fmt: skip
    for name, unit in (("sigma_position", "m"), ("sigma_normal", "rad")):
        value = getattr(window, name)
        if value > 0:
            add(
                name, unit,
                lambda d, n=name, v=value: (scene, replace(window, **{n: v + d})),
                ASSUMPTION_STEP * value,
            )  # fmt: skip
    for finger in np.unique(np.r_[window.touch.finger, window.free.finger]):
        for axis, word in enumerate("xyz"):
            add(
                f"finger {finger} offset {word}", "m",
                lambda d, f=finger, a=axis: (scene, shifted(window, f, a, d)), OFFSET,
            )  # fmt: skip
    return found, units


@dataclass(frozen=True, eq=False)
class Doubt:
    """A quantity r >= 0 that the page takes as zero: slope (unknowns,), E[r^2]."""

    slope: np.ndarray
    squared: float

    def covariance(self, pulls) -> np.ndarray:
        """Return the covariance (k, k) by it; pulls: see KKTSystem.sensitivity."""
        moves = pulls.T @ self.slope
        return self.squared * np.outer(moves, moves)


def rounded_edges(curvature: KKTSystem, build: Callable, window, shape) -> Doubt:
    """Return the doubt about sharp edges; build(window) builds the problem again."""
    problem, touch = curvature.problem, window.touch
    values = problem.unpack(curvature.x)
    less = values | {"theta": shape.rounded(values["theta"], RADIUS)}
    low, high = (
        at_touches(window, shape, v, touch.p_wf.T, lambda *at: at[2][0])
        for v in (less, values)
    )  # a body that lies on the ground is as high as it is large: the finger follows
    p_wf = touch.p_wf.copy()
    p_wf[:, :3] += low - high
    touch = replace(touch, p_wf=p_wf, radius=touch.radius + RADIUS)
    grown = build(replace(window, touch=touch)).data() - problem.data()
    theta, ends = problem.variables["theta"].span, []
    for side in (1, 0, -1):
        x = curvature.x.copy()
        x[theta] = shape.rounded(x[theta], side * RADIUS)
        ends.append((x, curvature.data + side * grown))
    return _doubted(curvature, ends, RADIUS, EDGE)


def late_normals(curvature: KKTSystem, build: Callable, window, data) -> Doubt:
    """Return the doubt about normals of the instant; build(window): as above.

    data: the measurements, smoothed as the problem has them.
    """
    problem, touch = curvature.problem, window.touch
    pair, rate = consecutive_contacts(data), np.zeros_like(data.normal)
    rate[1:][pair] = np.diff(data.normal, axis=0)[pair] / data.dt
    normal = touch.normal + LATE * rate[touch.sample, touch.finger]
    later = replace(window, touch=replace(touch, normal=normal))
    turned = build(later).data() - problem.data()
    ends = [(curvature.x, curvature.data + side * turned) for side in (1, 0, -1)]
    return _doubted(curvature, ends, LATE, LAG)


def _doubted(curvature: KKTSystem, ends, step: float, deviation: float) -> Doubt:
    """Return what the touches tell of a quantity that the page takes as zero.

    ends: unknowns and data at r = step, 0, -step; deviation: of r before any touch,
    where it is not zero.
    """
    problem = curvature.problem
    costs = [problem.value("touch", *end).sum() for end in ends]
    slopes = [gradient(problem, *end, costs=["touch"]) for end in ends]
    b = (slopes[0] - slopes[2]) / (2 * step)
    pull = (costs[2] - costs[0]) / (2 * step)
    bend = (costs[0] - 2 * costs[1] + costs[2]) / step**2
    information = 1 / deviation**2 + max(0.0, bend + b @ curvature.moved(b))
    likeliest = max(0.0, pull) / information
    odds = deviation * np.sqrt(information) * np.exp(-information * likeliest**2 / 2)
    squared = (1 / information + likeliest**2) / (1 + odds)
    return Doubt(b, squared)


def shifted(window, finger: int, axis: int, way: float):
    """Return the window as if a finger had been elsewhere by `way` [m] all the time."""
    changed = {}
    for part, names in (
        ("touch", ["p_wf"]),
        ("free", ["p_wf"]),
        ("push", ["p_wf", "p_wf_1"]),
    ):
        rows = getattr(window, part)
        there = np.zeros_like(rows.p_wf)
        there[rows.finger == finger, axis] = way
        changed[part] = replace(rows, **{n: getattr(rows, n) + there for n in names})
    return replace(window, **changed)


def kkt_residual(
    problem, curvature: KKTSystem, data=None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the gradient of L and the values of all constraints at the solution."""
    data = problem.data() if data is None else data
    x = curvature.x
    values = [problem.value(name, x, data).ravel() for name in problem.constraints]
    slope = gradient(problem, x, data, curvature.multipliers)
    return slope, np.concatenate([np.zeros(0), *values])


def _difference(pulls, held, ends, step) -> np.ndarray:
    (s, g), (s_1, g_1) = ends
    return -(pulls.T @ (s - s_1) + held.T @ (g - g_1)) / (2 * step)
