"""Command lines that the fuzzer runs in its own process, without the long solves."""

from __future__ import annotations

import contextlib
import io

from fuzz_files import PATHS, SUFFIXES, Known, damaged
from fuzz_values import pick

import tactilenlp as t
from tactilenlp.__main__ import main
from tactilenlp.exploration.options import ExploreOptions
from tactilenlp.interface.request import read_request
from tactilenlp.interface.session import PROCESS


def command(rng, known: Known) -> str:
    """Run a command line in this process; a solve returns a kept estimate."""
    name = pick(rng, ("estimate", "report", "explore", "estimate", "report", "x"))
    kind = "measurements" if name == "estimate" else pick(rng, list(known.arrays))
    file = damaged(rng, known, kind)
    if rng.random() < 0.4:
        file = known.folder / f"{kind}.npz"
    if name == "explore" and rng.random() < 0.5:
        file = known.scratch / "new.npz"
    line = [name, str(file)]
    for _ in range(int(rng.integers(0, 4))):
        line += _option(rng, known, name)
    words = io.StringIO()
    with (
        contextlib.redirect_stdout(words), contextlib.redirect_stderr(words),
        _without_solves(known), contextlib.suppress(SystemExit),  # argparse: usage
    ):  # fmt: skip
        code = main(line)
        assert code in (0, 2, 130), code
    return name


def _option(rng, known: Known, name: str) -> list[str]:
    number = pick(rng, ("0.5", "nan", "-1", "inf", "1e400", "x", "", "1e-300", "3"))
    options = [
        ["--output", str(known.scratch / "o.html")],
        ["--export", str(known.scratch / f"o{pick(rng, SUFFIXES)}")],
        ["--output", pick(rng, PATHS)],
        ["--mass", number],
        ["--friction-ground", number],
        ["--save", str(known.scratch / "s.npz")],
        ["--shape", pick(rng, ("cuboid", "polytope", "ball", ""))],
        ["--formulation", pick(rng, ("quasi_static", "paper", "x", "", "\0"))],
        ["--seed", pick(rng, ("0", "-1", "x", "99999999999999999999"))],
        ["--actions", pick(rng, ("0", "1", "-1", "1.5"))],
        ["--sides", *[number] * 3],
        ["--policy", pick(rng, ("eig", "random", "x", ""))],
        ["--noisy"],
        ["--verbose"],
    ]
    return pick(rng, options)


@contextlib.contextmanager
def _without_solves(known: Known):
    """Replace the two functions that take seconds: they check, and return what is kept.

    Requests are read and checked by the library's own code.
    """

    def solve(data, scene=None, *, shape="cuboid", formulation="violation_implicit"):
        read_request(data, scene, shape, formulation, None, None, None, PROCESS)
        return known.estimate

    def explore(world, scene, actions, policy, *, seed, centre, file):
        ExploreOptions(actions, policy, seed=seed, centre=centre)
        yield known.step

    kept = t.solve_estimate, t.explore
    t.solve_estimate, t.explore = solve, explore
    try:
        yield
    finally:
        t.solve_estimate, t.explore = kept
