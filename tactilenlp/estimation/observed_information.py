r"""Information about shape and final pose from the data of an estimate, by kind.

exact             the Hessian of the Lagrangian of the whole problem, reduced and
                  marginalised; its sigma has all terms of the error budget
sandwich          the covariance of the estimate under repeated measurements, by the
                  sensors' noise alone (measurement_noise.py)
gauss_newton      the same reduction of Hessians without negative curvature: no second
                  derivatives of gaps and normals where they lower the information
paper             eq:obsinfo, past poses taken for the last one: dx_t/dx_{t-1} = 1
inverse_dynamics  eq:obsinfo, past poses from the last by inverted Jacobians of the
                  dynamics, which grow with every sample
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from formulations.names import FREE_TERM, TOUCH_TERM

from ..common.brief import printed
from ..common.threads import on_one_thread
from ..common.validation import check_one_of, check_types
from ..data.ground import frame_of
from ..data.scene import Scene
from ..errors import OptionError, TactileError, typed_call
from ..information.comparisons import gauss_newton, inverse_dynamics, paper
from ..information.information import Information
from ..information.measurement_noise import (
    mixed_derivatives,
    sensitivity_to_measurements,
    sensor_covariance,
)
from ..information.sensitivity import ASSUMPTION_STEP, difference, kkt_residual
from ..information.tangent_space import inverse
from ..interface.options import Options, Session
from ..interface.request import read_request
from ..interface.result import Estimate
from ..local.local_solve import built_page
from ..nlp.problem import Problem
from ..problem.reductions import Reductions
from .programme import class_and_page, programme_at

ASSUMED = {"mass": "kg", "friction_ground": "1", "friction_finger": "1"}
SHIFT = 1e-6  # [m] shift of a finger
INFORMATION_KINDS = ("exact", "sandwich", "gauss_newton", "paper", "inverse_dynamics")


@on_one_thread
def observed_information(
    estimate, kind: str = "exact", *, shape=None, formulation=None
) -> Information:
    """Return the information of an estimate's data about shape and final pose.

    kind: one of INFORMATION_KINDS; all but "exact" build the problem of the estimate
    again, and their sigma is that of their matrix.  shape, formulation: as they were
    given to solve_estimate, where they are a Shape or a page of one's own.
    """
    check_types(estimate=(estimate, "Estimate"))
    check_one_of("kind", kind, INFORMATION_KINDS, "no such information")
    if kind == "exact":
        if shape is not None or formulation is not None:
            class_and_page(estimate, shape, formulation)
        return estimate.information
    again = programme_at(estimate, shape, formulation)
    return estimate.information.of_matrix(*_of_kind(kind, again))


def _of_kind(kind: str, again) -> tuple:
    """Return the matrix (k, k) of a kind, and its covariance where it comes first."""
    if kind == "paper":
        M = paper(again.problem, again.solution, again.window)
        return (again.tangent.inverse.T @ M @ again.tangent.inverse,)
    kkt = again.kkt
    if kind == "inverse_dynamics":
        M = inverse_dynamics(kkt, again.solution, again.window)
        if not np.isfinite(M).all():
            raise TactileError(
                "the product of inverted Jacobians overflows", where="inverse_dynamics",
                got="an infinite entry", expected="finite information",
                next='ask for kind="exact", or for fewer actions',
            )  # fmt: skip
        return (again.tangent.inverse.T @ M @ again.tangent.inverse,)
    if kind == "gauss_newton":
        kkt = gauss_newton(kkt)
    by_gradient, by_constraint = kkt.sensitivity(again.tangent.chosen)
    J = again.tangent.jacobian
    C = J @ by_gradient[again.tangent.chosen] @ J.T
    if kind == "sandwich":
        through = mixed_derivatives(kkt, again.job, again.window)
        columns = by_gradient, by_constraint
        moves = sensitivity_to_measurements(through, again.job.data, *columns)
        C = sensor_covariance(*moves, again.job)
        C = J @ C @ J.T
    C = (C + C.T) / 2
    return inverse(C), C


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
        for name, table in ((quantity, self.maps), (assumption, self.moves)):
            check_one_of("sensitivity", name, sorted(table), "no such name")
        return self.maps[quantity] @ self.moves[assumption]


@on_one_thread
def assumption_sensitivity(estimate, *, shape=None, formulation=None) -> Sensitivity:
    """Return how shape and final pose change with mass, frictions, sensors, fingers.

    shape, formulation: see observed_information.
    """
    check_types(estimate=(estimate, "Estimate"))
    again = programme_at(estimate, shape, formulation)
    kkt = again.kkt
    J, columns = again.tangent.jacobian, kkt.sensitivity(again.tangent.chosen)
    moves, units, columns = {}, {}, [part @ J.T for part in columns]
    for name, unit, step, sides in _assumptions(estimate.scene, again.window):
        built = (again.job.build(window, scene) for window, scene in sides)
        ends = [kkt_residual(problem, kkt) for problem in built]
        moves[name], units[name] = difference(*columns, ends, step), unit
    return Sensitivity(again.tangent.names, moves, units, again.tangent.maps)


def _assumptions(scene, window) -> Iterator[tuple[str, str, float, list]]:
    """Yield of each assumption name, unit, step; window and scene to either side."""
    for name, unit in ASSUMED.items():
        if value := getattr(scene, name):
            step = ASSUMPTION_STEP * value
            ends = ({name: value + d} for d in (step, -step))
            yield name, unit, step, [(window, replace(scene, **end)) for end in ends]
    for name, unit in (("sigma_position", "m"), ("sigma_normal", "rad")):
        if (value := getattr(window, name)) > 0:
            step = ASSUMPTION_STEP * value
            ends = ({name: value + d} for d in (step, -step))
            yield name, unit, step, [(replace(window, **end), scene) for end in ends]
    world = frame_of(scene.ground).rotation  # its axes: columns
    for finger in np.unique(np.r_[window.touch.finger, window.free.finger]):
        for axis, word in zip(world.T, "xyz", strict=True):
            ways = SHIFT * axis, -SHIFT * axis
            sides = [(shifted(window, finger, way), scene) for way in ways]
            yield f"finger {finger} offset {word}", "m", SHIFT, sides


def shifted(window, finger: int, way: np.ndarray):
    """Return the window as if a finger had been elsewhere by `way` (3,) [m] always."""
    changed = {}
    for part, names in (
        (TOUCH_TERM, ["p_wf"]),
        (FREE_TERM, ["p_wf"]),
        ("push", ["p_wf", "p_wf_1"]),
    ):
        rows = getattr(window, part)
        there = np.zeros_like(rows.p_wf)
        there[rows.finger == finger, :3] = way
        changed[part] = replace(rows, **{n: getattr(rows, n) + there for n in names})
    return replace(window, **changed)


@typed_call()
def problem_of(
    data, scene: Scene | None = None, formulation="violation_implicit",
    *, shape="cuboid", options: Options | None = None, at=None,
) -> Problem:  # fmt: skip
    """Return the problem that a page poses of measurements, built and not solved.

    Arguments as of solve_estimate.  at: an Estimate of these measurements, of which the
    problem is built again, with its reductions; a hull needs it, as which vertices a
    contact reads depends on where it is solved from.  `describe()` lists terms and
    unknowns, `check()` compares derivatives with finite differences, and
    `solvers.solve.solve_levels` solves it level by level from any start, as the page
    states them, and `solve` once, from a start that is close.  Raises what
    solve_estimate raises before it solves.
    """
    if at is not None:
        check_types(at=(at, Estimate))
        scene = (Scene() if scene is None else scene).on_ground_of(at.scene)
    request, _ = read_request(
        data, scene, shape, formulation, options, None, None, Session()
    )
    job = request.job
    if at is not None:
        if at.measurements != data or at.shape != job.shape.name:
            raise OptionError(
                "an estimate of other measurements or of another shape", where="at",
                got=f"{at.shape}, {at.measurements!r}",
                expected=f"{job.shape.name}, {data!r}",
            )  # fmt: skip
        job = job.as_late_as(at.sensors)
        solved = replace(job, reductions=Reductions(**at.reductions), cuts=at.cuts)
        return built_page(solved, at.origin).problem
    if job.shape.window_depends_on_start:
        raise OptionError(
            "its problem depends on where it is solved from", where="at",
            got=job.shape.name, expected="an Estimate of these measurements",
        )  # fmt: skip
    return built_page(job).problem
