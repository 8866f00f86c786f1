"""Measure the speed-up of two processes, for one estimate and for a study.

python examples/benchmarks/executors.py [recording.npz ...] [--pairs 5] [--workers 2]

Each pair times the same work in this process and in a pool of processes that has
already imported and compiled everything, one directly after the other, so that other
load affects both.  Times are wall-clock seconds: run the script where nothing else
runs.  The load before and after is printed.
"""

import argparse
import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter

import numpy as np
from study import one_thread

from tactilenlp import Measurements, Scene, example_recording, solve_estimate

RECORDING = example_recording()
TRIALS = 4  # of the study: each is one estimate


def estimate(file, pool=None):
    """Return the estimate of a recording."""
    data, scene = Measurements.load(file), Scene.load(file)
    return solve_estimate(data, scene, executor=pool, throw=False)


def trial(file) -> float:
    """Return the objective [nats] of one trial of the study."""
    return estimate(file).objective


def seconds(function, *arguments) -> float:
    began = perf_counter()
    function(*arguments)
    return perf_counter() - began


def study(file, pool=None) -> None:
    run = map if pool is None else pool.map
    list(run(trial, [file] * TRIALS))


def main() -> None:
    one_thread()
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", default=[str(RECORDING)])
    parser.add_argument("--pairs", type=int, default=5)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    print("load before:", *(f"{load:.1f}" for load in os.getloadavg()))
    with ProcessPoolExecutor(given.workers, mp_context=get_context("spawn")) as pool:
        for file in given.files:
            found = estimate(file)
            share = found.seconds["search"] / found.seconds["total"]
            most = 1 / (1 - share + share / given.workers)
            print(f"{Path(file).stem}: the search is {share:.0%} of one estimate;")
            print(f"  {given.workers} processes speed one up {most:.2f} times at most")
            estimate(file, pool), study(file, pool)  # warms every process
            timed("one estimate", estimate, file, pool, given.pairs)
            timed(f"{TRIALS} estimates", study, file, pool, given.pairs)
    print("load after:", *(f"{load:.1f}" for load in os.getloadavg()))


def timed(name, work, file, pool, count) -> None:
    """Print what pairs of runs, here and on the pool, have taken."""
    ways = (file,), (file, pool)
    pairs = np.array([[seconds(work, *way) for way in ways] for _ in range(count)])
    here, there = np.median(pairs, axis=0)
    gain = pairs[:, 0] / pairs[:, 1]
    print(f"  {name}: {here:.2f} s here, {there:.2f} s on the pool; speed-up "
          f"{np.median(gain):.2f} ({gain.min():.2f} to {gain.max():.2f})",
          flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
