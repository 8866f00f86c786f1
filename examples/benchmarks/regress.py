"""Compare this checkout with a commit on a few recordings, run in pairs.

    python examples/benchmarks/regress.py --against de9af66
    ... --against HEAD~3 --pairs 3 --recordings shipped cuboid_00 --out benchmark

Each recording is estimated in a process of its own, alternately with this checkout and
with the commit, which is checked out into a temporary folder.  The truth is read here,
never by the package.  `digest` hashes every number of an estimate, so that "equal"
means equal to the last digit.  CPU seconds are the least of the pairs; the first pair
compiles what is not compiled yet.  Missing recordings are omitted.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # of every library, before numpy is imported

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path
from time import process_time

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
SCENES = ROOT.parent / "shared" / "scenes"
RECORDINGS = ROOT / "tactilenlp" / "data" / "recordings"
SHIPPED = {"shipped": "cuboid.npz", "shipped_polytope": "polytope.npz"}
SHARED = ("cuboid_00", "cuboid_00_noisy", "cuboid_03", "cuboid_03_noisy")
HULLS = ("platonic_octa_0", "stress_irregular_0")
EXPLORED = "explore_3"  # the first touch and three chosen actions in the simulator
BOX = (0.05, 0.035, 0.04)  # [m] the body that is explored
EVERY = (*SHIPPED, *SHARED, *HULLS, EXPLORED)
COLUMNS = ("objective", "sizes_mm", "sigma_mm", "distance_mm", "cpu_s")


def file_of(name: str) -> Path:
    """Return the file of a recording."""
    if name in SHIPPED:
        return RECORDINGS / SHIPPED[name]
    return SCENES / f"{name}.npz"


def estimated(name: str):
    """Return the estimate of a recording, and its exact surface distance [m]."""
    from tactilenlp import (
        Measurements,
        Scene,
        World,
        explore,
        solve_estimate,
        surface_distance,
    )

    if name == EXPLORED:
        *_, step = explore(World(BOX), actions=3, seed=0)
        return step.estimate, step.errors["surface"]
    file = file_of(name)
    truth = truth_of(file)
    shape = "cuboid" if "side_lengths" in truth else "polytope"
    data, scene = Measurements.load(file), Scene.load(file)
    estimate = solve_estimate(data, scene, shape=shape)
    return estimate, surface_distance(estimate.mesh(), true_mesh(truth)).mean


def truth_of(file) -> dict[str, np.ndarray]:
    """Return all arrays of a recording, among them the truth."""
    with np.load(file) as stored:
        return {key: stored[key] for key in stored.files}


def true_mesh(truth):
    """Return the true body at the last sample as a mesh, world frame."""
    from trimesh.convex import convex_hull
    from trimesh.creation import box
    from trimesh.transformations import quaternion_matrix

    place = quaternion_matrix(truth["object_quaternion"][-1])
    place[:3, 3] = truth["object_position"][-1]
    if "side_lengths" in truth:
        return box(truth["side_lengths"], place)
    return convex_hull(truth["vertices"]).apply_transform(place)


def measure(name: str) -> dict:
    """Return the row of one recording with the package that is imported."""
    began = process_time()
    estimate, distance = estimated(name)
    seconds = process_time() - began
    cuboid = estimate.shape == "cuboid"
    size = "side_lengths" if cuboid else "vertices"
    sigma = np.atleast_1d(estimate.information.sigma(size))
    sizes = estimate.side_lengths if cuboid else np.ptp(estimate.vertices, axis=0)
    numbers = [
        estimate.theta, estimate.position, estimate.quaternion, sigma,
        np.array(estimate.objective), *estimate.impulses.values(),
        *(np.array(value) for value in estimate.costs.values()),
    ]  # fmt: skip
    raw = b"".join(np.ascontiguousarray(n, float).tobytes() for n in numbers)
    return {
        "objective": estimate.objective,
        "sizes_mm": [round(1e3 * s, 3) for s in sizes],
        "sigma_mm": round(1e3 * float(np.nanmedian(sigma)), 4),
        "distance_mm": round(1e3 * distance, 4),
        "cpu_s": seconds, "digest": hashlib.sha256(raw).hexdigest()[:16],
    }  # fmt: skip


def serve(measure) -> None:
    """Measure each case that standard input asks for, a line each."""
    for line in sys.stdin:
        try:
            row = measure(*json.loads(line))
        except Exception as error:  # of whatever kind: it counts as not converged
            row = {"error": f"{type(error).__name__}: {error}"}
        print("row", json.dumps(row, default=float), flush=True)


@contextmanager
def worker(tree: Path, script: str):
    """Start a script that serves, with the package of a tree: yields ask(*case)."""
    environment = {**os.environ, "PYTHONPATH": str(tree), "TQDM_DISABLE": "1"}
    process = subprocess.Popen(
        [sys.executable, script, "--serve"], env=environment, cwd=tree, text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    )  # fmt: skip

    def ask(*case) -> dict:
        process.stdin.write(json.dumps(case) + "\n")
        process.stdin.flush()
        for line in process.stdout:
            if line.startswith("row "):
                return json.loads(line[4:])
        raise RuntimeError(f"the process of {tree} has ended")

    with process:
        yield ask
        process.stdin.close()


def run(tree: Path, name: str) -> dict:
    """Return the row of a recording, with the package of a tree, in a new process."""
    with worker(tree, __file__) as ask:
        row = ask(name)
    if "error" in row:
        raise RuntimeError(f"{name} in {tree}: {row['error']}")
    return row


@contextmanager
def tree_of(against: str):
    """Yield the folder of a tree: that of a checkout, or a commit checked out anew."""
    if Path(against).is_dir():
        yield Path(against).resolve()
        return
    with tempfile.TemporaryDirectory() as folder:
        git = ["git", "-C", str(ROOT), "worktree"]
        add = [*git, "add", "--quiet", "--detach", folder, against]
        subprocess.run(add, check=True)  # git says what is wrong with a commit
        try:
            yield Path(folder)
        finally:
            subprocess.run([*git, "remove", "--force", folder], check=True)


def paired(here: Path, there: Path, name: str, pairs: int) -> dict:
    """Return the rows of a recording here and there, each with its least CPU time."""
    rows = {"here": [], "there": []}
    for _ in range(pairs):
        rows["here"].append(run(here, name))
        rows["there"].append(run(there, name))
    least = {
        side: some[-1] | {"cpu_s": min(r["cpu_s"] for r in some)}
        for side, some in rows.items()
    }
    return {"recording": name, **least}


def show(found: list[dict]) -> str:
    """Return the table of what was found, in Markdown."""
    lines = [
        "| recording | objective [nats] | sizes [mm] | median sigma [mm] | "
        "distance [mm] | CPU [s] | ratio | digits |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in found:
        a, b = row["here"], row["there"]
        same = a["digest"] == b["digest"]
        cells = [f"{a['objective']:.4f} ({b['objective']:.4f})"]
        cells += [f"{a[c]} ({b[c]})" for c in COLUMNS[1:4]]
        cells += [
            f"{a['cpu_s']:.2f} ({b['cpu_s']:.2f})",
            f"{a['cpu_s'] / b['cpu_s']:.2f}",
        ]
        lines.append(
            f"| {row['recording']} | {' | '.join(cells)} | "
            f"{'equal' if same else 'differ'} |"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add = parser.add_argument
    add("--against", default="HEAD", help="a commit, or the folder of a checkout")
    add("--recordings", nargs="+", default=EVERY, choices=EVERY)
    add("--pairs", type=int, default=2, help="runs of each")
    add("--out", type=Path, default=Path("benchmark"))
    add("--serve", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        serve(measure)
        return
    there = [n for n in arguments.recordings if n == EXPLORED or file_of(n).exists()]
    found = []
    with tree_of(arguments.against) as tree:
        for name in there:
            found.append(paired(ROOT, tree, name, arguments.pairs))
            print(show(found[-1:]).splitlines()[-1], flush=True)
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "regress.json").write_text(json.dumps(found, indent=1))
    print(f"\nthis checkout (in brackets: {arguments.against})\n\n{show(found)}")


if __name__ == "__main__":
    main()
