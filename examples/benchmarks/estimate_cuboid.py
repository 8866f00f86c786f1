"""Measure `solve_estimate` on recorded cuboids: accuracy, calibration and cost.

python examples/benchmarks/estimate_cuboid.py ../shared/scenes/cuboid_*.npz
... ../shared/scenes/stress_*.npz --actions 6 --knowledge known default "mass x2"
    [--executor processes|dask|mpi|none] [--workers 1]

The truth is read here, never by the package.  It gives the errors, and the start of a
second solve of the same page, whose objective a good search must reach.  CPU seconds
exclude the derivation of term functions (kinds_s); a case that derives some is
repeated.  Rows are kept in runs.jsonl as cases end (study.py): called again, the script
runs what is missing.
"""

import json
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from time import process_time
from timeit import repeat

import numpy as np
from chamfer import chamfer_code, chamfer_floor, chamfer_paper
from judging import placed, touched_sizes
from report_cuboid import report
from study import study_parser, tabled_study, telling
from trimesh.creation import box
from trimesh.sample import sample_surface

from tactilenlp import Measurements, Options, Scene, solve_estimate
from tactilenlp.data.sensor_noise import precise
from tactilenlp.evaluation import metrics
from tactilenlp.geometry.transforms import rotation_of
from tactilenlp.nlp.term_functions import default_cache
from tactilenlp.problem.hypothesis import Hypothesis

A = np.random.default_rng(0).normal(size=(700, 700))  # LAPACK solves A x = b: the unit
EXACT = ("still", "far", "absent")  # reductions besides the planar motion
FORMULATIONS = {  # name -> page; reductions switched off: reduced path, unreduced path
    "stage_a": ("quasi_static", (), EXACT),
    "planar": ("violation_implicit", (), EXACT),
    "six_dof": ("violation_implicit", ("planar",), (*EXACT, "planar")),
}
FRICTIONS = ("friction_ground", "friction_finger")
KNOWLEDGE = {  # name -> factors of mass and both frictions, None: not known
    "known": (1, 1), "default": None, "mass x0.5": (0.5, 1), "friction x0.5": (1, 0.5),
    "all x0.5": (0.5, 0.5), "mass x2": (2, 1), "friction x2": (1, 2), "all x2": (2, 2),
    "friction None": (1, None),
}  # fmt: skip


@dataclass(frozen=True)
class Case:
    """What is run na actions at a time: a file, a formulation, a path, knowledge."""

    file: str
    knowledge: str
    formulation: str
    path: str
    actions: list[int]

    def scene(self) -> Scene:
        scene, (mass, mu) = Scene.load(self.file), KNOWLEDGE[self.knowledge]
        wrong = {name: mu and getattr(scene, name) * mu for name in FRICTIONS}
        return replace(scene, mass=mass * scene.mass, **wrong)

    def solve(self, data, start=None, throw=True):
        page, *off = FORMULATIONS[self.formulation]
        options = Options(without=off[self.path == "unreduced"])
        how = {"formulation": page, "options": options, "start": start, "throw": throw}
        scene = None if self.knowledge == "default" else self.scene()
        return solve_estimate(data, scene, **how)

    def label(self, na) -> dict:
        name = Path(self.file).stem
        row = {"scene": name.removesuffix("_noisy"), "noisy": name.endswith("_noisy")}
        row |= {k: getattr(self, k) for k in ("knowledge", "formulation", "path")}
        row |= {"na": na, "of": max(self.actions), "start": "scratch", "carried": 0}
        return row


class Truth:
    """What a file knows and the package must not read: sizes (3,), poses (T, ...)."""

    def __init__(self, file):
        keys = ("side_lengths", "object_position", "object_quaternion")
        self.side_lengths, self.position, self.quaternion = map(np.load(file).get, keys)

    def mesh(self, sample):
        pose = self.position[sample], self.quaternion[sample]
        return placed(box(self.side_lengths), *pose)

    def start(self, estimate):
        """Return the estimate with the true motion as its only hypothesis."""
        T = estimate.measurements.samples
        turn = rotation_of(self.quaternion[:T])
        x = np.vstack([self.position[:T].T, turn.as_rotvec().T])
        if len(estimate.unknowns["x"]) == 3:
            ahead = turn.apply([1.0, 0.0, 0.0])
            x = np.vstack([x[:2], np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))])
        truth = Hypothesis(self.side_lengths, x, objective=0.0, path=())
        return replace(estimate, hypotheses=(truth,))


def apart(a, b, last):
    """Return sizes and final pose of body a less those of b, modulo symmetry."""
    bodies = [(c.side_lengths, c.position[last], c.quaternion[last]) for c in (a, b)]
    return metrics.cuboid_errors(*bodies[0], *bodies[1])


def compare(estimate, truth) -> dict:
    """Return how wrong an estimate is, and how wrong it says to be [mm, deg]."""
    data, last = estimate.measurements, estimate.measurements.samples - 1
    meshes = estimate.mesh(), truth.mesh(last)
    distance = metrics.surface_distance(*meshes)
    clouds = [sample_surface(meshes[i > 0], 1000, seed=i)[0] for i in range(3)]
    row = {"mean_mm": 1e3 * distance.mean, "max_mm": 1e3 * distance.maximum}
    row |= {
        "bch_paper_m2": chamfer_paper(*clouds[:2]),
        "bch_paper_floor_m2": chamfer_paper(*clouds[1:]),
        "bch_code_mm": 1e3 * chamfer_code(*meshes),
        "bch_code_floor_mm": 1e3 * chamfer_floor(meshes[1]),
    }
    error, sigma = apart(estimate, truth, last), estimate.information.sigma
    for part, errors, sigmas, unit in (
        ("side", error.side_lengths, sigma("side_lengths")[error.permutation], 1e3),
        ("position", error.position, sigma("position"), 1e3),
        ("rotation", error.rotation_vector, sigma("rotation"), 180 / np.pi),
    ):
        for axis, e, s in zip("xyz", errors, sigmas, strict=True):
            row |= {f"{part}_{axis}_error": e * unit, f"{part}_{axis}_sigma": s * unit}
            row[f"{part}_{axis}_ratio"] = abs(e) / s
    row |= touched_sizes(data, truth.quaternion)
    return row | {"unobserved": "; ".join(estimate.information.unobserved)}


def cost(estimate) -> dict:
    """Return what an estimate took, in its own words."""
    *presolve, joint = estimate.iterations_by_level
    row = {"presolve_iterations": sum(presolve), "joint_iterations": joint}
    noise = estimate.sensors
    widths = Options().widths(precise(estimate.measurements, noise))
    row |= dict(zip(("width", "starts"), widths, strict=True))
    row |= {"beam": len(estimate.hypotheses), "evaluations": estimate.evaluations}
    row |= {"status": estimate.status, "objective": estimate.objective}
    row |= {"broken": " ".join(s.name for s in estimate.skipped if not s.holds)}
    row |= {f"{name}_s": value for name, value in estimate.seconds.items()}
    row["ms_per_iteration"] = 1e3 * row["solve_s"] / max(1, estimate.iterations)
    return row


def against_truth(case, estimate, truth) -> dict:
    """Return what the same page reaches from the true motion, and how far away."""
    last = estimate.measurements.samples - 1
    if len(estimate.unknowns["x"]) == 6:  # also what was found to tumble
        case = replace(case, formulation="six_dof")
    best = case.solve(estimate.measurements, truth.start(estimate), throw=False)
    distance = metrics.surface_distance(best.mesh(), truth.mesh(last))
    row = {"truth_objective": best.objective, "truth_mean_mm": 1e3 * distance.mean}
    row["truth_solve_s"] = best.seconds["solve"]
    off = apart(estimate, best, last)
    far = max(np.abs(off.side_lengths).max(), np.linalg.norm(off.position))
    return row | {"off_mm": 1e3 * far, "off_deg": np.degrees(off.rotation_angle)}


def run(case, data, truth, start=None):
    """Return the row of one run, and its estimate or None."""
    unit = min(repeat(lambda: np.linalg.solve(A, A[0]), timer=process_time, number=1))
    row, kinds = {"success": False, "reference_s": unit}, default_cache().seconds
    began, estimate = process_time(), None
    try:
        estimate = case.solve(data, start)
        row["kinds_s"] = default_cache().seconds - kinds
        if row["kinds_s"] > 0:
            began = process_time()
            estimate = case.solve(data, start)
        row["cpu_s"] = process_time() - began
        judged = compare(estimate, truth) | cost(estimate)
        row |= judged | against_truth(case, estimate, truth) | {"success": True}
        row["mean_over_truth"] = row["mean_mm"] / row["truth_mean_mm"]
    except Exception as error:  # whatever it is, it counts, by its name
        row.setdefault("cpu_s", process_time() - began)
        row["error"] = f"{type(error).__name__}: {' '.join(str(error).split())}"
    row["cpu_in_references"] = row["cpu_s"] / row["reference_s"]
    return row, estimate


def run_case(*arguments) -> list[dict]:
    """Return the rows of a case: from scratch, and from the estimate before."""
    case, rows, before = Case(*arguments), [], None
    data, truth = Measurements.load(case.file), Truth(case.file)
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


def cases_of(arguments) -> list[tuple]:
    """Return the Cases to run: cuboids; the slow unreduced path for the last na."""
    cases, ways = [], (arguments.knowledge, arguments.formulations, arguments.paths)
    for file in (f for f in arguments.files if "side_lengths" in np.load(f)):
        count = Measurements.load(file).actions
        some = [na for na in arguments.actions or range(1, count + 1) if na <= count]
        for way in product(*ways):
            chosen = some if way[-1] == "reduced" else some[-1:]
            cases.append((file, *way, chosen or [count]))
    return cases


def main() -> None:
    parser = study_parser(__doc__, folder=False, executor="none")
    add, every, paths = parser.add_argument, [*FORMULATIONS], ["reduced", "unreduced"]
    add("files", nargs="+")
    add("--actions", type=int, nargs="+", help="default: 1 .. all")
    add("--formulations", nargs="+", default=every, choices=every)
    add("--paths", nargs="+", default=paths, choices=paths)
    add("--knowledge", nargs="+", default=["known"], choices=KNOWLEDGE)
    add("--out", type=Path, default=Path("benchmark"))
    arguments = parser.parse_args()
    path, cases = arguments.out / "runs", cases_of(arguments)
    say = telling("success", "mean_mm", "cpu_s", "error")
    rows = tabled_study(arguments, path, run_case, cases, say=say)
    path.with_suffix(".json").write_text(json.dumps(rows))
    report([path.with_suffix(".json")])


if __name__ == "__main__":
    main()
