"""Fuzz the library in shards, each in its own process: python tests/fuzzing.py --help.

Input number n of a seed is the same in every run.  An input passes if it is accepted,
or refused by a typed error.  It fails by any other error, by 10 s without an end, by a
signal, and by memory beyond 1 GB.  A failure is printed with the command that repeats
it.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import faulthandler
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from importlib import import_module
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
LONGEST = 10  # [s] of one input
STUCK = 15  # [s] after which a process that cannot be interrupted is ended
MOST_MEMORY = 1e9  # [bytes] of a process
ADDRESSES = 8 << 30  # [bytes] of addresses: what asks for more gets a MemoryError
SHARD = 20_000  # inputs of a process
SHOWN = 30  # failures that are printed
KINDS = {  # share of the inputs, and the module with the function that draws them
    "constructor": (0.45, "fuzz_inputs"), "call": (0.25, "fuzz_inputs"),
    "wire": (0.2, "fuzz_inputs"), "load": (0.066, "fuzz_files"),
    "method": (0.03, "fuzz_files"), "command": (0.004, "fuzz_commands"),
}  # fmt: skip


class Hang(BaseException):
    """An input took too long."""


def kinds() -> dict:
    """Return the function that draws an input of each kind."""
    return {k: getattr(import_module(module), k) for k, (_, module) in KINDS.items()}


def one(draw, known, seed: int, number: int, only: str | None) -> tuple[str, str]:
    """Run one input; return its kind, and "accepted" or the name of a typed error."""
    from tactilenlp.errors import TactileError

    rng = np.random.default_rng([seed, number])
    kind = str(rng.choice(list(KINDS), p=[share for share, _ in KINDS.values()]))
    kind = only or kind
    signal.setitimer(signal.ITIMER_REAL, LONGEST)
    faulthandler.dump_traceback_later(STUCK, exit=True)
    try:
        draw[kind](rng, known)
    except TactileError as error:
        return kind, type(error).__name__
    except FileNotFoundError as missing:  # documented, of a file that is not there
        if Path(missing.filename or "").exists():
            raise
        return kind, "FileNotFoundError"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        faulthandler.cancel_dump_traceback_later()
    return kind, "accepted"


def shard(folder: Path, seed: int, first: int, count: int, end: float, only) -> dict:
    """Run inputs `first` to `first + count`, or until the time `end`; return counts."""
    from fuzz_files import Known

    warnings.simplefilter("ignore")
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
    counts, failures, slowest = collections.Counter(), [], (0.0, -1)
    with tempfile.TemporaryDirectory() as scratch, interrupting():
        known, draw = Known(folder, Path(scratch)), kinds()
        os.chdir(scratch)
        at = os.open(folder / "at", os.O_WRONLY | os.O_CREAT)
        for number in range(first, first + count):
            if time.time() > end:
                break
            os.pwrite(at, b"%-20d" % number, 0)
            began = time.monotonic()
            try:
                counts[one(draw, known, seed, number, only)] += 1
            except (Exception, Hang) as bad:
                failures.append(_failure(bad, number))
                counts["failed", type(bad).__name__] += 1
            slowest = max(slowest, (time.monotonic() - began, number))
    # Not ru_maxrss, which begins with what the process that started this one uses.
    status = Path("/proc/self/status").read_text()
    memory = 1024 * int(status.split("VmHWM:")[1].split()[0])
    table = [[*key, n] for key, n in counts.items()]
    return {
        "counts": table, "failures": failures, "memory": memory, "slowest": slowest,
    }  # fmt: skip


@contextlib.contextmanager
def interrupting():
    """Raise Hang in an input that takes too long, as long as the context lasts."""

    def hang(*_):
        raise Hang(f"no end after {LONGEST} s")

    before = signal.signal(signal.SIGALRM, hang)
    try:
        yield
    finally:
        signal.signal(signal.SIGALRM, before)


def _failure(bad: BaseException, number: int) -> dict:
    """Return in words what failed, and where in the library."""
    frames = traceback.extract_tb(bad.__traceback__)
    ours = [
        f for f in frames if "/tests/" not in f.filename and str(ROOT) in f.filename
    ]
    last = (ours or frames)[-1]
    place = str(Path(last.filename).relative_to(ROOT)) if ours else "?"
    try:
        words = str(bad)[:200]
    except Exception:  # of a foreign class
        words = "no words"
    what = f"{type(bad).__name__} at {place}:{last.lineno} in {last.name}: {words}"
    return {"number": number, "what": what}


def fuzz(estimates, seed: int, inputs: int, seconds: float, only=None, first=0) -> dict:
    """Run so many inputs, or as many as the time [s] allows; return the sums."""
    counts, failures, memory = collections.Counter(), [], 0.0
    slowest = [0.0, -1]
    end, began = time.time() + seconds, time.time()
    with tempfile.TemporaryDirectory() as folder:
        from fuzz_files import prepare

        prepare(Path(folder), *estimates)
        done = first
        while done < first + inputs and time.time() < end:
            count = min(SHARD, first + inputs - done)
            told = [folder, seed, done, count, end, only or ""]
            found = in_process(Path(folder), told)
            for *key, n in found["counts"]:
                counts[tuple(key)] += n
            failures += found["failures"]
            memory = max(memory, found["memory"])
            slowest = max(slowest, found["slowest"])
            done += count
    if memory > MOST_MEMORY:
        failures.append({"number": -1, "what": f"{memory / 1e9:.2f} GB of memory"})
    return {
        "counts": counts, "failures": failures, "memory": memory,
        "seconds": time.time() - began, "seed": seed, "slowest": slowest,
    }  # fmt: skip


def in_process(folder: Path, told: list) -> dict:
    """Run a shard in a process; a signal or a hang of it is a failure."""
    command = [sys.executable, __file__, "--shard", *map(str, told)]
    paths = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": paths}
    ran = subprocess.run(command, capture_output=True, text=True, env=environment)
    if ran.returncode == 0:
        return json.loads(ran.stdout.splitlines()[-1])
    number = int((folder / "at").read_text() or -1)
    what = f"exit code {ran.returncode}: {ran.stderr[-1500:]}"
    failed = {"failures": [{"number": number, "what": what}]}
    return failed | {"counts": [], "memory": 0, "slowest": [0.0, -1]}


def report(found: dict) -> str:
    """Return the counts of each kind, and the failures with their reproducers."""
    lines = [
        f"seed {found['seed']}: {found['counts'].total()} inputs in "
        f"{found['seconds']:.0f} s, "
        f"{found['memory'] / 1e6:.0f} MB, {len(found['failures'])} failures, the "
        "slowest input {:.1f} s (number {})".format(*found["slowest"])
    ]
    for kind in dict.fromkeys(kind for kind, _ in found["counts"]):
        ways = [(w, n) for (k, w), n in found["counts"].most_common() if k == kind]
        few = ", ".join(f"{way} {n}" for way, n in ways)
        lines.append(f"  {kind}: {sum(n for _, n in ways)} ({few})")
    alike = collections.defaultdict(list)
    for bad in found["failures"]:
        alike[bad["what"].split(":")[0] + bad["what"].split(" in ")[0]].append(bad)
    for group in sorted(alike.values(), key=len, reverse=True)[:SHOWN]:
        bad = group[0]
        again = (
            f"python tests/fuzzing.py --seed {found['seed']} --again {bad['number']}"
        )
        lines.append(f"{len(group)} x {bad['what']}\n    {again}")
    return "\n".join(lines)


def small_estimates():
    """Return the estimates of one action of the shipped recording: a box, a hull."""
    import tactilenlp as t

    path = t.example_recording()
    data, scene = t.Measurements.load(path).select([0]), t.Scene.load(path)
    return [t.solve_estimate(data, scene, shape=s) for s in ("cuboid", "polytope")]


def again(seed: int, number: int, only) -> None:
    """Run one input in this process; its error has a traceback."""
    from fuzz_files import Known, prepare

    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as temp:
        prepare(Path(folder), *small_estimates())
        known = Known(Path(folder), Path(temp))
        with interrupting():
            print(one(kinds(), known, seed, number, only))


def main() -> int:
    """Read the command line; return 1 after a failure."""
    if sys.argv[1:2] == ["--shard"]:
        folder, seed, first, count, end, only = sys.argv[2:]
        span = int(seed), int(first), int(count), float(end)
        print(json.dumps(shard(Path(folder), *span, only or None)))
        return 0
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--inputs", type=int, default=1_000_000)
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument(
        "--first", type=int, default=0, help="number of the first input"
    )
    parser.add_argument("--only", choices=KINDS, help="a single kind")
    parser.add_argument("--again", type=int, help="run this input alone")
    given = parser.parse_args()
    if given.again is not None:
        again(given.seed, given.again, given.only)
        return 0
    limits = given.seed, given.inputs, given.seconds, given.only, given.first
    found = fuzz(small_estimates(), *limits)
    print(report(found))
    return bool(found["failures"])


if __name__ == "__main__":
    sys.exit(main())
