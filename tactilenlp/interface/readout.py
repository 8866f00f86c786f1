"""Readout: from a solved page to an `Estimate`, by name, in the world frame."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from formulations.names import (
    EXACT,
    FINGER_IMPULSE,
    FINGER_OFFSET,
    GROUND_IMPULSE,
    IMPULSE,
)

from ..common.deadline import Deadline, OutOfTime
from ..common.npz import versions
from ..data.ground import frame_of
from ..data.mistakes import suspicion
from ..data.sensor_noise import shift_in_time, with_sensors_earlier
from ..geometry.convex_hull import centroid
from ..geometry.faces import polygons, touched_polygons
from ..geometry.transforms import (
    is_planar,
    matrices,
    quaternion_of,
    rotate_planar,
)
from ..information.error_budget import OF_PRIORS, variances_by_name
from ..information.error_budget_terms import ANY_ROTATION, REACHED
from ..information.information import Information
from ..information.laplace_approximation import information_of, prior_of_offsets
from ..information.linearisation import Linearisation
from ..information.measurement_noise import aligned_normals
from ..information.mixture import one_mode
from ..information.tangent_space import prior_deviations, widest_deviations
from ..problem.pages import name_of
from ..problem.poses import poses
from ..tracking.surface import body_surface
from .request import CHECK_FOR_MISTAKES, Request
from .result import OF_SOLVE, Estimate

# [limits] A reduction beyond it makes a fit poor: hulls that are right reach up to 3.
CASTS_DOUBT = 10.0
NOT_COMPUTED = "anything (no time to compute sigma: it is that of the prior)"


def read_off(
    request: Request, solved, kept, seconds, deadline: Deadline, modes=()
) -> Estimate:
    """Return the estimate of a solved page, in the frame of the data.

    kept: hypotheses for the next action; seconds: of CPU time by step, and of waiting
    for compilers; deadline: of the information: after it, sigma is that of the prior;
    modes: other local optima of the same page.
    """
    job, solution = replace(solved.job, deadline=deadline), solved.solution
    R_wg = frame_of(job.scene.ground).rotation.T
    offset = solution.values.get(FINGER_OFFSET)
    body = (read_hull if job.shape.of_vertices else read_sized)(job, solved)
    information = information_in_time(job, solved, body["faces"], modes)
    status = deadline.marked(solution.status)
    fit = with_doubts(solved.fit, solved.skipped)
    if solution.success:
        fit = with_suspicion(fit, job, request.data)
    if fit is not None:
        if NOT_COMPUTED in information.unobserved:  # sigma is that of the prior
            fit = replace(fit, widening=1.0)
        information = information.widened(fit.widening)
    return Estimate(
        measurements=request.data,
        scene=job.scene,
        shape=job.shape.name,
        formulation=name_of(job.page),
        options=asdict(request.job.options),
        information=information,
        fit=fit,
        impulses=impulses(solved, request.data, job.scene),
        finger_offset=None if offset is None else (R_wg @ offset).T,
        hypotheses=tuple(kept),
        versions=versions(),
        **body | _solved_fields(solved) | {"status": status, "seconds": seconds},
    )


def with_doubts(fit, skipped):
    """Return a Fit that is "poor" at most where a reduction is far from holding."""
    far = [s for s in skipped if not s.holds and s.value > CASTS_DOUBT * s.limit]
    if fit is None or not far:
        return fit
    return fit.doubted(f"a reduction is far from holding, {far[0]}")


def with_suspicion(fit, job, recorded):
    """Return a Fit that, where it is not good, names a likely mistake in the data.

    Where there is time for the check that the data passed before the solve, again.
    """
    seconds = job.deadline.spent.get(CHECK_FOR_MISTAKES)
    if fit is None or fit.verdict == "good" or seconds is None:
        return fit
    if job.deadline.passed("a check for mistakes", seconds):
        return fit
    data = with_sensors_earlier(recorded, job.precision)
    return replace(fit, suspected=suspicion(data, job.scene))


def _solved_fields(solved) -> dict:
    """Return the fields of an estimate that are those of the solve."""
    problem, solution = solved.problem, solved.solution
    # Of constraints that a solve smooths, the violations without smoothing.
    x, data = solution.at(problem)
    smoothed = [name for name in problem.reports if name.endswith(EXACT)]
    exact = {n: max(0.0, problem.value(n, x, data).max().item()) for n in smoothed}
    return {name: getattr(solution, name) for name in OF_SOLVE} | {
        "theta": solution.values["theta"].T.ravel(),
        "unknowns": solution.values,
        "violations": {**solution.violations, **exact},
        "skipped": solved.skipped,
        "precision": asdict(solved.job.precision),
        "reductions": asdict(solved.job.reductions),
        "cuts": tuple(int(i) for i in solved.job.cuts),
        "origin": solved.built.origin,
    }


def read_sized(job, solved) -> dict:
    """Return the fields of an Estimate about the body of a shape with sizes."""
    theta, x, shape = solved.at.theta, poses_at_samples(job, solved.at.x), job.shape
    p, q = poses(shape, theta, x, job.scene.ground)
    surface, faces = body_surface(shape, theta), solved.touched
    return {"position": p, "quaternion": q, "body_vertices": surface, "faces": faces}


def read_hull(job, solved) -> dict:
    """Return the fields of an Estimate about the body of a polytope.

    Its origin is the centroid, its axes are the world's at the last sample.
    """
    V, x = solved.solution.values["theta"].T, poses_at_samples(job, solved.at.x)
    middle, R_wg = centroid(V), frame_of(job.scene.ground).rotation.T
    p, turn = hull_poses(job.scene, x, middle)
    vertices = (V - middle) @ R_wg.T
    touch = solved.window.touch
    normal = aligned_normals(touch, solved.solution.values)
    felt = replace(solved.window, touch=replace(touch, normal=normal))
    # Faces of the vertices that the estimate has: which facets make one face, and the
    # order of faces, depend on the frame.
    outlines = [(corners, n @ R_wg) for corners, n in polygons(vertices)]
    faces = touched_polygons(felt, V, outlines, x, job.precision.normal)
    q = quaternion_of(turn)
    return {"position": p, "quaternion": q, "body_vertices": vertices, "faces": faces}


def poses_at_samples(job, x) -> np.ndarray:
    """Return poses x (unknowns, T) at the samples, which are those of late sensors.

    What late sensors tell of a sample was so before it, by their latency.
    """
    return shift_in_time(job.data, x.T, job.precision.latency).T


def information_in_time(job, solved, faces, modes=()) -> Information:
    """Return the information; that of the prior if the deadline comes before it is.

    faces: how many samples touched each; modes: other local optima of the same page.
    """
    try:
        kkt = solved.built.kkt_at(solved.solution, job.deadline)
        job.deadline.check()
        linearisation = Linearisation(kkt, job, solved.window)
        others = modes if job.shape.of_vertices else [mode.optimum for mode in modes]
        return information_of(linearisation, solved, faces, others)
    except OutOfTime:
        job.deadline.omit("standard deviations")
        return information_of_prior(job, solved)


def hull_poses(scene, x, middle) -> tuple[np.ndarray, Rotation]:
    """Return positions (T, 3) [m] and rotations (T) of a hull at poses x, world frame.

    middle (3,) [m]: the point of the body whose position is returned; rotations are
    relative to the pose that is held upright, the last one that sensors told of.
    """
    if not is_planar(x):
        p = x[:3].T + matrices(x) @ middle
        ground = frame_of(scene.ground)
        R_wg = ground.rotation.T
        return ground.from_ground(p), Rotation.from_matrix(R_wg @ matrices(x) @ R_wg.T)
    level = rotate_planar(x[2], *middle[:2], origin=x)
    p = np.stack([*level, np.full(x.shape[1], middle[2])], axis=1)
    turn = Rotation.from_rotvec(np.outer(x[2], scene.ground.normal))
    return scene.ground.from_ground(p), turn


def impulses(solved, data, scene) -> dict[str, np.ndarray]:
    """Return the impulses on the object by contact, (T, 3) [N s], world frame."""
    problem, window, solution = solved.problem, solved.window, solved.solution
    T = data.samples
    out = {f"finger {i}": np.zeros((T, 3)) for i in range(data.fingers)}
    if scene.ground is not None:
        out["ground"] = np.zeros((T, 3))
    x, values = solution.at(problem)
    turn = frame_of(scene.ground).rotation
    if FINGER_IMPULSE in problem.reports:
        pushed = problem.value(FINGER_IMPULSE, x, values) @ turn
        for i in range(data.fingers):
            rows = window.push.finger == i
            out[f"finger {i}"] = by_sample(pushed[rows], window.push.sample[rows], T)
    if GROUND_IMPULSE in problem.reports:
        on_corners = problem.value(GROUND_IMPULSE, x, values) @ turn
        rows = window.step.sample[window.corner.step]
        out["ground"] = by_sample(on_corners, rows, T)
    elif IMPULSE in problem.reports:  # of all contacts: what fingers leave over
        whole = problem.value(IMPULSE, x, values) @ turn
        out["ground"] = by_sample(whole, window.step.sample, T)
        out["ground"] -= sum(out[f"finger {i}"] for i in range(data.fingers))
    by = solved.job.precision.latency
    return {
        name: shift_in_time(data, one, by, beyond=False) for name, one in out.items()
    }


def by_sample(values, rows, samples: int) -> np.ndarray:
    """Return (samples, 3) with `values` added at `rows`, zeros where none."""
    out = np.zeros((samples, 3))
    np.add.at(out, rows, values)
    return out


def information_of_prior(job, solved) -> Information:
    """Return the information by the prior alone about what was solved, world frame.

    Where the time limit came before it was computed: nothing is claimed that was not.
    """
    R_wg = frame_of(job.scene.ground).rotation.T
    solution, tangent = solved.solution, solved.tangent
    shape, k = solved.window.shape, len(tangent.names)
    sigma = widest_deviations(shape, k, REACHED, ANY_ROTATION)
    if shape.of_vertices:  # all of them may be elsewhere together
        along = np.tile(np.eye(3), (k // 3, 1))
        C = np.diag(sigma**2) + REACHED**2 * along @ along.T
    else:  # the prior of sizes has heavier tails than its mode tells
        sigma[: shape.theta] = prior_deviations(shape, solved.at.theta)
        C = np.diag(sigma**2)
    matrix = np.linalg.inv(C)
    offsets = {}
    if FINGER_OFFSET in solved.problem.variables:
        prior = prior_of_offsets(job.scene, solution.values[FINGER_OFFSET].shape[1])
        both = block_diag(matrix, prior)
        turn = np.kron(np.eye(len(prior) // 3), R_wg)
        covariance = turn @ np.linalg.inv(prior) @ turn.T
        offsets = {"offsets": covariance, "with_offsets": both}
    return Information(
        names=tangent.names, matrix=matrix, covariance_matrix=C, parts={}, roles={},
        modes=one_mode(solution.objective, C), maps=tangent.maps,
        unobserved=(NOT_COMPUTED,), directions=np.zeros((k, 0)), fixed=(),
        active={}, ambiguous={}, indefinite=(),
        budget=variances_by_name({OF_PRIORS: C}, tangent.maps), **offsets,
    )  # fmt: skip
