"""Benchmark `solve_estimate` on recorded cuboids: accuracy, honesty and cost.

python examples/benchmarks/estimate_cuboid.py ../shared/scenes/cuboid_*.npz
... ../shared/scenes/stress_*.npz --actions 6 --formulations planar --knowledge every

Truth is read here, never by the package: it judges the result, and it starts a second
solve of the same page at the true motion, whose objective a good search must reach.
Every run is a row of runs.csv, failed or not; `report_cuboid.py` reads it.  CPU seconds
exclude the derivation of kinds, kinds_s: a run that derived some is run again (compiled
kinds are cached on disk: set XDG_CACHE_HOME to an empty folder to time their making).
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before numpy comes
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import csv
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from itertools import product
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from report_cuboid import report
from scipy.spatial.transform import Rotation
from trimesh.creation import box
from trimesh.sample import sample_surface
from trimesh.transformations import quaternion_matrix, translation_matrix

from tactilenlp import Measurements, Options, Scene, metrics, solve_estimate
from tactilenlp.information import ENOUGH, TOUCHED
from tactilenlp.kind import seconds_deriving
from tactilenlp.result import touched_faces
from tactilenlp.search import Hypothesis

ORDER = 700  # of the reference, a dense LAPACK solve: 2 / 3 ORDER^3 = 0.23 GFLOP
POINTS = 1000  # a side, of the paper's bCH
EXACT = ("still", "far", "absent")  # reductions besides the planar motion
FORMULATIONS = {  # name -> page; reductions switched off: reduced path, unreduced path
    "stage_a": ("quasi_static", (), EXACT),
    "planar": ("violation_implicit", (), EXACT),
    "six_dof": ("violation_implicit", ("planar",), (*EXACT, "planar")),
}
KNOWLEDGE = {  # name -> factors of mass and both frictions (nan: not known), or nothing
    "known": (1, 1),
    "default": None,
    "mass x0.5": (0.5, 1),
    "mass x2": (2, 1),
    "friction x0.5": (1, 0.5),
    "friction x2": (1, 2),
    "all x0.5": (0.5, 0.5),
    "all x2": (2, 2),
    "friction None": (1, np.nan),
}


@dataclass(frozen=True)
class Case:
    """What is run na actions at a time: a file, a formulation, a path, knowledge."""

    file: str
    knowledge: str
    formulation: str
    path: str
    actions: tuple[int, ...]
    options: Options

    def scene(self) -> Scene | None:
        scene, factors = Scene.load(self.file), KNOWLEDGE[self.knowledge]
        if factors is None:
            return None
        mu = np.array([scene.friction_ground, scene.friction_finger]) * factors[1]
        ground, finger = (None if np.isnan(value) else value for value in mu)
        mass = scene.mass * factors[0]
        return replace(scene, mass=mass, friction_ground=ground, friction_finger=finger)

    def solve(self, data, start=None, throw=True):
        page, *off = FORMULATIONS[self.formulation]
        options = replace(self.options, reduce=off[self.path == "unreduced"])
        how = {"formulation": page, "options": options, "start": start, "throw": throw}
        return solve_estimate(data, self.scene(), **how)

    def label(self, na) -> dict:
        name = Path(self.file).stem
        row = {"scene": name.removesuffix("_noisy"), "noisy": name.endswith("_noisy")}
        row |= {"na": na, "of": max(self.actions), "start": "scratch", "carried": 0}
        row |= {k: getattr(self, k) for k in ("knowledge", "formulation", "path")}
        return row | {"width": self.options.hypotheses, "starts": self.options.starts}


class Truth:
    """What a file knows and the package must not read: sizes (3,), poses (T, ...)."""

    def __init__(self, file):
        with np.load(file) as arrays:
            self.side_lengths = arrays["side_lengths"]
            self.position = arrays["object_position"]
            self.quaternion = arrays["object_quaternion"]

    def mesh(self, sample):
        pose = translation_matrix(self.position[sample])
        return box(self.side_lengths, pose @ quaternion_matrix(self.quaternion[sample]))

    def start(self, estimate):
        """Return the estimate with the true motion as its only hypothesis."""
        T = estimate.measurements.samples
        turn = Rotation.from_quat(np.roll(self.quaternion[:T], -1, axis=1))
        x = np.vstack([self.position[:T].T, turn.as_rotvec().T])
        if len(estimate.hypotheses[0].x) == 3:
            x = np.vstack([x[:2], np.unwrap(turn.as_euler("ZYX")[:, 0])])
        there = Hypothesis(self.side_lengths, x, 0.0, ("truth",))
        return replace(estimate, hypotheses=(there,))


def apart(a, b, last):
    """Return sizes and final pose of body a less those of b, modulo symmetry."""
    bodies = [(c.side_lengths, c.position[last], c.quaternion[last]) for c in (a, b)]
    return metrics.cuboid_errors(*bodies[0], *bodies[1])


def compare(estimate, truth) -> dict:
    """Return how wrong an estimate is, and how wrong it says to be [mm, deg]."""
    data, last = estimate.measurements, estimate.measurements.samples - 1
    meshes = estimate.mesh(), truth.mesh(last)
    distance = metrics.surface_distance(*meshes)
    clouds = [sample_surface(meshes[i > 0], POINTS, seed=i)[0] for i in range(3)]
    row = {"mean_mm": 1e3 * distance.mean, "max_mm": 1e3 * distance.maximum}
    row["bch_paper_m2"] = metrics.chamfer_paper(*clouds[:2])
    row["bch_paper_floor_m2"] = metrics.chamfer_paper(*clouds[1:])
    row["bch_code_mm"] = 1e3 * metrics.chamfer_code(*meshes)
    row["bch_code_floor_mm"] = 1e3 * metrics.chamfer_floor(meshes[1])
    error, sigma = apart(estimate, truth, last), estimate.information.sigma
    for part, errors, sigmas, unit in (
        ("side", error.side_lengths, sigma("side_lengths")[error.permutation], 1e3),
        ("position", error.position, sigma("position"), 1e3),
        ("rotation", error.rotation_vector, sigma("rotation"), 180 / np.pi),
    ):
        for axis, e, s in zip("xyz", errors, sigmas, strict=True):
            row |= {f"{part}_{axis}_error": e * unit, f"{part}_{axis}_sigma": s * unit}
            row |= {f"{part}_{axis}_ratio": abs(e) / s}
    faces = touched_faces(data, truth.quaternion[: last + 1], TOUCHED)
    faces[2, 0] += ENOUGH  # the ground touches -z
    row |= {f"touched_{'xyz'[i]}": bool(faces[i].min() >= ENOUGH) for i in range(3)}
    return row | {"unobserved": "; ".join(estimate.information.unobserved)}


def cost(estimate) -> dict:
    """Return what an estimate took, in its own words."""
    *presolve, joint = estimate.iterations_by_level
    row = {"status": estimate.status, "objective": estimate.objective}
    row |= {"unknowns": sum(value.size for value in estimate.unknowns.values())}
    row |= {"beam": len(estimate.hypotheses), "evaluations": estimate.evaluations}
    row |= {"presolve_iterations": sum(presolve), "joint_iterations": joint}
    seconds = {f"{name}_s": value for name, value in estimate.seconds.items()}
    row |= {"ms_per_iteration": 1e3 * seconds["solve_s"] / max(1, estimate.iterations)}
    broken = " ".join(s.name for s in estimate.skipped if not s.holds)
    return row | seconds | {"broken": broken}


def against_truth(case, estimate, truth) -> dict:
    """Return what the same page reaches from the true motion, and how far away."""
    last = estimate.measurements.samples - 1
    best = case.solve(estimate.measurements, truth.start(estimate), throw=False)
    distance = metrics.surface_distance(best.mesh(), truth.mesh(last))
    row = {"truth_objective": best.objective, "truth_mean_mm": 1e3 * distance.mean}
    off = apart(estimate, best, last)
    far = max(np.abs(off.side_lengths).max(), np.linalg.norm(off.position))
    return row | {"off_mm": 1e3 * far, "off_deg": np.degrees(off.rotation_angle)}


def reference_seconds() -> float:
    """Return the CPU seconds of the reference, the best of three."""
    matrix, seconds = np.random.default_rng(0).normal(size=(ORDER, ORDER)), []
    for _ in range(3):
        began = time.process_time()
        np.linalg.solve(matrix, matrix[0])
        seconds.append(time.process_time() - began)
    return min(seconds)


def run(case, data, truth, start=None):
    """Return the row of one run, and its estimate or None."""
    reference, kinds, estimate = reference_seconds(), seconds_deriving[0], None
    row, began = {"success": False}, time.process_time()
    try:
        estimate = case.solve(data, start)
        row["kinds_s"] = seconds_deriving[0] - kinds
        if row["kinds_s"] > 0:
            began = time.process_time()
            estimate = case.solve(data, start)
        row["cpu_s"] = time.process_time() - began
        row |= compare(estimate, truth) | cost(estimate)
        row |= against_truth(case, estimate, truth) | {"success": True}
    except Exception as error:  # whatever it is, it counts, by its name
        row["error"] = f"{type(error).__name__}: {' '.join(str(error).split())}"
        row.setdefault("cpu_s", time.process_time() - began)
    row |= {"reference_s": reference, "references": row["cpu_s"] / reference}
    return row, estimate


def run_case(case) -> list[dict]:
    """Return the rows of a case: from scratch, and from the estimate before."""
    data, truth, rows, before = Measurements.load(case.file), Truth(case.file), [], None
    for na in case.actions:
        part = data.select(np.unique(data.action)[:na])
        row, estimate = run(case, part, truth)
        rows.append(case.label(na) | row)
        if before is not None:
            carried = {"start": "previous", "carried": before.measurements.actions}
            row, after = run(case, part, truth, before)
            rows.append(case.label(na) | carried | row)
            estimate = after or estimate
        before = estimate or before
    return rows


def cases_of(arguments) -> list[Case]:
    """Return what to run; the unreduced path only with all actions, it is slow."""
    cases, options = [], Options(arguments.hypotheses and 0)
    return cases


if __name__ == "__main__":
    main()
