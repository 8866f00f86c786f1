"""Measure by how much solves exceed their time limit.

    python examples/benchmarks/time_limits.py ../shared/scenes/cuboid_00.npz
        ../shared/scenes/platonic_octa_0.npz [--tosses cube_tosses.npz]
        [--limits 2 10 60] [--warm]

Each recording is estimated as a cuboid, or as a polytope if its name begins with
platonic, and so are 97 actions made of the shipped recordings (3007 samples).  --tosses
adds identify_body of all tosses of a file.  Each solve has a process of its own and an
empty compile cache; --warm: the user's cache, after one solve that is not counted.

Wall-clock seconds, on which the limit is; the CPU seconds beside them tell how busy the
machine was.  A solve may exceed its limit by 10 % or 1 s; the exit code is 1 otherwise.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from tactilenlp import (
    Measurements,
    Options,
    Scene,
    Trajectories,
    identify_body,
    solve_estimate,
)
from tactilenlp.data.examples import example_recording

MANY = 97  # actions
SHARE, LEAST = 0.1, 1.0  # [-], [s] by which a limit may be exceeded
FILL = 60.0  # [s] limit of the solve that fills the cache
TOSSES = "tosses"  # the kind of a file that is identified


def many(shape: str) -> tuple[Measurements, Scene]:
    """Return the shipped recording of a shape, repeated to MANY actions."""
    file = example_recording(shape)
    data, scene = Measurements.load(file), Scene.load(file)
    long = data
    while long.actions < MANY:
        long = long.append(replace(data, time=data.time + long.time[-1] + 1.0))
    return long.select(np.unique(long.action)[:MANY]), scene


def solve(kind: str, file: str, limit: float):
    """Return how many samples there are, and a function that solves within a limit."""
    if kind == TOSSES:
        tosses = Trajectories.load(file)
        given = {"time_limit": limit, "throw": False}
        return len(tosses.toss), lambda: identify_body(tosses, Scene(), **given)
    if Path(file).exists():
        data, scene = Measurements.load(file), Scene.load(file)
    else:
        data, scene = many(kind)
    given = {"shape": kind, "options": Options(time_limit=limit), "throw": False}
    return data.samples, lambda: solve_estimate(data, scene, **given)


def measured(kind: str, file: str, limit: float) -> dict:
    """Solve in this process; return samples, seconds and the status."""
    samples, compute = solve(kind, file, limit)
    began, cpu = time.monotonic(), time.process_time()
    found = compute()
    wall, cpu = time.monotonic() - began, time.process_time() - cpu
    kept = {"success": found.success, "status": found.status}
    return {"samples": samples, "wall": wall, "cpu": cpu, **kept}


def in_process(kind: str, file: str, limit: float, cache: str | None) -> dict:
    """Solve in a process of its own, with this compile cache or the user's."""
    command = [sys.executable, __file__, "--one", kind, file, str(limit)]
    place = {} if cache is None else {"XDG_CACHE_HOME": cache}
    environment = os.environ | {"OMP_NUM_THREADS": "1"} | place
    ran = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True)
    return json.loads(ran.stdout)


def main() -> int:
    """Print one line a solve; return 1 if one took too long."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recordings", nargs="*")
    parser.add_argument("--tosses", help="a file of Trajectories")
    parser.add_argument("--limits", type=float, nargs="+", default=[2.0, 10.0, 60.0])
    parser.add_argument("--warm", action="store_true", help="with the user's cache")
    parser.add_argument("--one", nargs=3, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        kind, file, limit = given.one
        print(json.dumps(measured(kind, file, float(limit))))
        return 0
    polytopes = ["platonic" in Path(file).name for file in given.recordings]
    kinds = ["polytope" if one else "cuboid" for one in polytopes]
    cases = [*zip(kinds, given.recordings, strict=True)]
    cases += [("cuboid", f"{MANY} actions"), ("polytope", f"{MANY} actions")]
    cases += [(TOSSES, given.tosses)] if given.tosses else []
    late = [case for case in cases if not in_time(*case, given.limits, given.warm)]
    return bool(late)


def in_time(kind: str, file: str, limits: list[float], warm: bool) -> bool:
    """Solve with each limit [s] and print the times; return whether all were kept."""
    if warm:
        in_process(kind, file, FILL, None)
    kept = True
    for limit in limits:
        with tempfile.TemporaryDirectory() as cache:
            found = in_process(kind, file, limit, None if warm else cache)
        over = found["wall"] - limit
        ok = over <= max(LEAST, SHARE * limit)
        kept = kept and ok
        print(
            f"{kind}, {Path(file).stem}, {found['samples']} samples, limit {limit:g} s:"
            f" {found['wall']:.2f} s, of them {found['cpu']:.2f} CPU, {over:+.2f} s"
            f"{'' if ok else ' TOO LATE'}; {found['status']}", flush=True,
        )  # fmt: skip
    return kept


if __name__ == "__main__":
    sys.exit(main())
