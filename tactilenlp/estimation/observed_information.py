r"""Information about shape and final pose from the data of an estimate, by kind.

exact             the Hessian of the Lagrangian of the whole problem, reduced and
                  marginalised; its sigma has all terms of the error budget
sandwich          the covariance of the estimate under repeated measurements, by the
                  sensors' noise alone (measurement_noise.py)
gauss_newton, paper, inverse_dynamics: information/comparisons.py

All but the first build the programme of the estimate again, at its solution.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from time import monotonic

import numpy as np

from ..common.brief import printed
from ..common.threads import on_one_thread
from ..common.validation import check_one_of, check_types
from ..data.ground import frame_of
from ..data.scene import Scene
from ..errors import OptionError, typed_call
from ..information.comparisons import gauss_newton, inverse_dynamics, paper
from ..information.information import Information
from ..information.linearisation import ASSUMPTION_STEP, difference, kkt_residual
from ..information.measurement_noise import (
    mixed_derivatives,
    sensitivity_to_measurements,
    sensor_covariance,
)
from ..information.tangent_space import inverse
from ..interface.request import make_job, read_request
from ..interface.result import Estimate
from ..local.local_solve import built_page
from ..local.solved import Solved
from ..nlp.problem import Problem
from ..problem.fingertips import moved
from ..problem.options import Options
from ..problem.pages import name_of, page_of, shape_of
from ..refinement.incremental import past_solution

OF_SCENE = {"mass": "kg", "friction_ground": "1", "friction_finger": "1"}
OF_WINDOW = {"sigma_position": "m", "sigma_normal": "rad"}
SHIFT = 1e-6  # [m] shift of a finger
INFORMATION_KINDS = ("exact", "sandwich", "gauss_newton", "paper", "inverse_dynamics")


def class_and_page(estimate, shape=None, formulation=None) -> tuple:
    """Return the Shape and the page of an estimate; OptionError for another one."""
    shape = shape_of(estimate.shape if shape is None else shape)
    stated = estimate.formulation if formulation is None else formulation
    page = page_of(stated, shape)
    for name, value in (("shape", shape.name), ("formulation", name_of(page))):
        if (own := getattr(estimate, name)) != value:
            raise OptionError(
                "not that of the estimate", where=name, got=value, expected=own,
                next="give it as it was given to solve_estimate",
            )  # fmt: skip
    return shape, page


def programme_at(estimate, shape=None, formulation=None) -> Solved:
    """Return the page of an estimate, built again, as it was solved.

    shape, formulation: of the estimate, by default those of the names it has.
    """
    shape, page = class_and_page(estimate, shape, formulation)
    scene = estimate.scene
    if shape.of_vertices:
        raise OptionError(
            "the problem of a polytope is not built again",
            where="estimate", got=estimate.shape, expected="a shape with sizes",
            next='ask for kind="exact", which every estimate carries',
        )  # fmt: skip
    job = make_job(estimate.measurements, scene, shape, Options(), monotonic(), page)
    solved = past_solution(job.as_late_as(estimate.sensors), estimate)
    _check_same_unknowns(solved.problem, estimate)
    return solved


def _check_same_unknowns(problem, estimate) -> None:
    """Raise OptionError unless an estimate has the unknowns of its problem."""
    for name, variable in problem.variables.items():
        size = np.shape(estimate.unknowns.get(name, ()))
        if size != (variable.rows, variable.columns):
            raise OptionError(
                "the problem of this estimate cannot be built again",
                where=name, got=size, expected=(variable.rows, variable.columns),
                next="estimate again with this version of the page",
            )  # fmt: skip


@on_one_thread
def observed_information(
    estimate, kind: str = "exact", *, shape=None, formulation=None
) -> Information:
    """Return the information of an estimate's data about shape and final pose.

    kind: one of INFORMATION_KINDS; all but "exact" build the problem of the estimate
    again, and their sigma is that of their matrix.  shape, formulation: as they were
    given to solve_estimate, where they are a Shape or a page of one's own.  Raises
    OptionError of other kinds, and of all but "exact" for a polytope or an estimate of
    another version of its page.
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
    """Return the matrix (k, k) of a kind, and its covariance if that comes first."""
    tangent, window = again.tangent, again.window
    if kind in ("paper", "inverse_dynamics"):
        if kind == "paper":
            M = paper(again.problem, again.solution, window)
        else:
            M = inverse_dynamics(again.kkt, again.solution, window)
        return tangent.inverse.T @ M @ tangent.inverse, None
    kkt = again.kkt
    if kind == "gauss_newton":
        kkt = gauss_newton(kkt)
    J, (by_gradient, by_constraint) = tangent.jacobian, kkt.sensitivity(tangent.chosen)
    if kind == "sandwich":
        terms, data = mixed_derivatives(kkt, again.job, window), again.job.data
        by_position, by_normal = sensitivity_to_measurements(
            terms, data, by_gradient, by_constraint
        )
        C = sensor_covariance(by_position, by_normal, again.job)
    else:
        C = by_gradient[tangent.chosen]
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

    By parametric sensitivity, SI per unit of each: `of("side_lengths", "mass")` is (3,)
    [m/kg].  shape, formulation: see observed_information.  Raises OptionError for a
    polytope, and for an estimate of another version of its page.
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
    for name, unit in (OF_SCENE | OF_WINDOW).items():
        owner = scene if name in OF_SCENE else window
        if value := getattr(owner, name):
            step = ASSUMPTION_STEP * value
            ends = [replace(owner, **{name: value + d}) for d in (step, -step)]
            sides = [(window, s) if owner is scene else (s, scene) for s in ends]
            yield name, unit, step, sides
    world = frame_of(scene.ground).rotation  # its axes: columns
    for finger in np.unique(np.r_[window.touch.finger, window.free.finger]):
        for axis, word in zip(world.T, "xyz", strict=True):
            ways = SHIFT * axis, -SHIFT * axis
            sides = [(shifted(window, finger, way), scene) for way in ways]
            yield f"finger {finger} offset {word}", "m", SHIFT, sides


def shifted(window, finger: int, way: np.ndarray):
    """Return the window as if a finger had been elsewhere by `way` (3,) [m] always."""
    return window.with_fingers(
        lambda rows, p_wf: moved(p_wf, np.outer(rows.finger == finger, way))
    )


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
    request, _ = read_request(data, scene, shape, formulation, options)
    job = request.job
    if at is not None:
        if at.measurements != data or at.shape != job.shape.name:
            raise OptionError(
                "an estimate of other measurements or of another shape", where="at",
                got=f"{at.shape}, {at.measurements!r}",
                expected=f"{job.shape.name}, {data!r}",
            )  # fmt: skip
        return past_solution(job.as_late_as(at.sensors), at).problem
    if job.shape.of_vertices:
        raise OptionError(
            "its problem depends on where it is solved from", where="at",
            got=job.shape.name, expected="an Estimate of these measurements",
        )  # fmt: skip
    return built_page(job).problem
