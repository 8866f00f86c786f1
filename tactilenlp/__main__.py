"""The command line: python -m tactilenlp --help."""

from __future__ import annotations

import argparse
import logging
import math
import sys
from pathlib import Path

import tactilenlp

from .common.interrupt import interruptible
from .common.npz import format_of
from .common.whole_file import check_file, check_folder
from .errors import FileError, Interrupted, OptionError, TactileError
from .output.export import check_format
from .problem.pages import FORMULATIONS, SHAPES, shape_of

EPILOG = """examples:
  python -m tactilenlp estimate scene.npz
  python -m tactilenlp estimate scene.npz --mass 0.4 --save estimate.npz
  python -m tactilenlp explore box.npz --sides 0.05 0.035 0.04 --actions 5
  python -m tactilenlp report estimate.npz --output report.html --export shape.glb
  python -m tactilenlp compile --shape cuboid

Ctrl-C writes the estimate so far, marked as interrupted.
"""
EXPLORE_HELP = """Explore a box in simulation: touch, estimate, choose the next touch,
repeat.  The first finger aims at the true centre of the simulated box; later actions
are chosen from measurements alone.  Every action and every estimate is saved in FILE at
once; if FILE exists, the exploration resumes from it (give the same box and seed)."""
NOISY_SENSORS = {"position": 1e-3, "normal": math.radians(5), "flips": 0.01}  # m, rad
SIDE_RANGE = (0.03, 0.06)  # [m] of random boxes
PLACE_RANGE = 0.02  # [m] of their centres to each side
SHIPPED = ("cuboid", "polytope")  # classes of recordings that are shipped
SUFFIXES = {"save": (".npz",), "output": (".html", ".htm")}  # of files written
INTERRUPTED_CODE = 130  # exit code after Ctrl-C, as of shells
SCENE_OPTIONS = {  # known properties of the scene: option, unit
    "mass": "[kg] of the object",
    "friction_ground": "[1] of the object and the ground",
    "friction_finger": "[1] of the object and a fingertip",
}


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    top = argparse.ArgumentParser(
        prog="python -m tactilenlp",
        description="Estimate shape, motion and contact impulses from touch.",
        epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    shown = f"tactilenlp {tactilenlp.__version__}"
    top.add_argument("--version", action="version", version=shown)
    top.add_argument("--verbose", action="store_true", help="log what is being done")
    commands = top.add_subparsers(dest="command", required=True)

    estimate = commands.add_parser("estimate", help="estimate a recording")
    estimate.add_argument("file", type=Path, help="measurements, .npz (see README.md)")
    pages, shapes = ", ".join(FORMULATIONS), ", ".join(SHAPES)
    words = f"one of {pages} (default violation_implicit)"
    estimate.add_argument("--formulation", default="violation_implicit", help=words)
    words = f"of {shapes}, 'prism of 6 sides': one, several to compare, or auto"
    estimate.add_argument("--shape", nargs="+", default=["cuboid"], help=words)
    estimate.add_argument("--save", type=Path, help="save the estimate as .npz")
    for name, words in SCENE_OPTIONS.items():
        option = f"--{name.replace('_', '-')}"
        estimate.add_argument(option, type=float, help=f"{words}; else from the file")
    _add_outputs(estimate)

    _add_explore(commands)
    report = commands.add_parser("report", help="show a saved estimate")
    report.add_argument("file", type=Path, help="an estimate or an exploration, .npz")
    _add_outputs(report)
    words = "compile ahead what estimates use, else they do at first use"
    ahead = commands.add_parser("compile", help=words)
    words = "classes of shapes (default: both)"
    shapes = {"choices": SHIPPED, "default": SHIPPED}
    ahead.add_argument("--shape", nargs="+", **shapes, help=words)
    for command in commands.choices.values():  # before or after the command
        add, unset = command.add_argument, argparse.SUPPRESS
        add("--verbose", action="store_true", default=unset, help=argparse.SUPPRESS)
    return top


def _add_explore(commands) -> None:
    """Add the command that explores a box in simulation."""
    explore = commands.add_parser(
        "explore", help="explore a box in simulation", description=EXPLORE_HELP
    )
    add = explore.add_argument
    add(
        "file",
        type=Path,
        help="the exploration, .npz: written, or resumed if it exists",
    )
    words = "[m] of the box; random by default"
    add("--sides", type=float, nargs=3, metavar=("X", "Y", "Z"), help=words)
    add("--actions", type=int, default=5, help="after the first touch (default 5)")
    add("--policy", default="eig", help="eig, random, fisher or farthest (default eig)")
    add("--seed", type=_seed, default=0, help="of random numbers (default 0)")
    words = "sensor noise: 1 mm, 5 deg, 1 %% wrong booleans (default: none)"
    add("--noisy", action="store_true", help=words)
    for name, words in SCENE_OPTIONS.items():
        add(f"--{name.replace('_', '-')}", type=float, help=f"{words}, and known")
    _add_outputs(explore)
    add("--save", type=Path, help="save the last estimate alone as .npz")


def _seed(text: str) -> int:
    """Return the seed of random numbers that an option gives."""
    if (seed := int(text)) < 0:
        raise argparse.ArgumentTypeError(f"expected 0 or more, got {seed}")
    return seed


def _add_outputs(command) -> None:
    """Add the options that name a report and a model to write."""
    words = "write an interactive report, .html"
    command.add_argument("--output", type=Path, metavar="PAGE", help=words)
    words = "write the shape: .stl .obj .ply .glb .xml (MJCF) .urdf, its mesh beside it"
    command.add_argument("--export", type=Path, metavar="MODEL", help=words)


def main(arguments: list[str] | None = None) -> int:
    """Run a command; return 0, or after an error 2 and one line on stderr."""
    given = parser().parse_args(arguments)
    logging.basicConfig(level=logging.INFO if given.verbose else logging.WARNING)
    try:
        _check_outputs(given)
        found, code = _found(given)
        if found is not None:
            _write_outputs(found, given)
    except (TactileError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return INTERRUPTED_CODE
    return code


def _found(given) -> tuple:
    """Return the estimate of a command, or None, and the exit code."""
    run = {
        "estimate": _estimate, "explore": _explore, "report": _load, "compile": _compile
    }  # fmt: skip
    try:
        with interruptible():
            return run[given.command](given), 0
    except Interrupted as stop:
        more = "; the same command continues" if given.command == "explore" else ""
        print(f"{stop}".partition(";")[0] + more, file=sys.stderr)
        return stop.estimate, INTERRUPTED_CODE


def _check_outputs(given) -> None:
    """Raise FileError or OptionError for an output that cannot be written."""
    if "export" not in given:  # a command that writes no estimate
        return
    taken = {given.file.absolute()}
    for name in ("save", "output", "export"):
        if not (path := getattr(given, name, None)):
            continue
        check_file(path, f"--{name}")
        suffixes = SUFFIXES.get(name, ())
        if suffixes and path.suffix.lower() not in suffixes:
            raise OptionError(
                "no such format", where=f"--{name} {path}",
                got=path.suffix or "no suffix", expected=" or ".join(suffixes),
            )  # fmt: skip
        if path.absolute() in taken:
            raise OptionError(
                "would replace another file", where=f"--{name} {path}",
                got="the same path as FILE or another option",
                next="give each output a name of its own",
            )  # fmt: skip
        taken.add(path.absolute())
    if given.export:
        check_format(given.export)
    if given.command == "explore":
        check_folder(given.file, "FILE")


def _write_outputs(estimate, given) -> None:
    """Print an estimate and write the requested files."""
    if getattr(given, "save", None):  # first: nobody may read what is printed
        estimate.save(given.save)
    print(estimate.summary())
    if given.output:
        estimate.report(given.output)
    if given.export:
        estimate.export(given.export)
    for name in ("save", "output", "export"):
        if path := getattr(given, name, None):
            print(f"Wrote {path}.")


def _estimate(given):
    """Return the estimate of the recording that a command names."""
    from . import Measurements, Scene, solve_estimate

    return solve_estimate(
        Measurements.load(given.file),
        Scene.load(given.file, **_known(given)),
        shape=given.shape if len(given.shape) > 1 else given.shape[0],
        formulation=given.formulation,
    )


def _known(given) -> dict[str, float]:
    """Return the properties of the scene that are given as options."""
    values = {name: getattr(given, name) for name in SCENE_OPTIONS}
    return {name: value for name, value in values.items() if value is not None}


def _explore(given):
    """Explore a simulated box, resuming from the file; return the last estimate."""
    from . import Scene, explore
    from .exploration.log import load_or_new

    world = _world(given)
    centre, scene = world.pose[:3], Scene(**_known(given))
    load_or_new(given.file).replay(world)
    for step in explore(
        world, scene, given.actions, given.policy, seed=given.seed, centre=centre,
        file=given.file,
    ):  # fmt: skip
        gain = f", {step.choice.gain:.1f} nats expected" if step.choice else ""
        words = f"the surface is {1e3 * step.errors['surface']:.2f} mm off on average"
        print(f"Action {step.number} ({step.policy}{gain}): {words}.", flush=True)
    return step.estimate


def _world(given):
    """Return the simulated world in its first state."""
    import numpy as np

    from . import Noise, World

    rng = np.random.default_rng(given.seed)
    sides = rng.uniform(*SIDE_RANGE, 3)
    place = rng.uniform(-PLACE_RANGE, PLACE_RANGE, 2)
    yaw = rng.uniform(0, 2 * np.pi)
    noise = Noise(seed=given.seed, **NOISY_SENSORS) if given.noisy else Noise()
    return World(
        given.sides or sides, position=place, noise=noise, **_known(given),
        quaternion=[np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)],
    )  # fmt: skip


def _compile(given) -> None:
    """Compile what estimates of each class and choices of actions use."""
    from .estimation.compile_ahead import compile_ahead
    from .exploration.action_search import choose_action
    from .exploration.action_space import Workspace
    from .nlp.codegen import compiler

    if compiler() is None:
        raise OptionError(
            "nothing can be compiled", where="compile", got="no C compiler",
            expected="cc, gcc or clang on the path", next="install gcc",
        )  # fmt: skip
    for shape in given.shape:
        estimate = compile_ahead(shape)
        choose_action(estimate, Workspace(), shape=shape_of(shape), budget=2)
        print(f"{shape}: what estimates and choices of actions use is compiled.")


def _load(given):
    """Return the estimate of a file, or the last one of an exploration."""
    from . import Estimate, Exploration

    if format_of(given.file) != "exploration":
        return Estimate.load(given.file)
    found = Exploration.load(given.file).estimate
    if found is None:
        raise FileError("no estimate yet", where=str(given.file), next="explore on")
    return found


if __name__ == "__main__":
    sys.exit(main())
