"""The command line, for people who don't write Python: python -m tactilenlp --help."""

from __future__ import annotations

import argparse
import logging
import sys
from pathlib import Path

from .errors import Interrupted, TactileError

EPILOG = """examples:
  python -m tactilenlp estimate scene.npz
  python -m tactilenlp estimate scene.npz --mass 0.4 --save estimate.npz
  python -m tactilenlp report estimate.npz --output report.html --shape shape.glb
"""
STOPPED = 130  # as shells say of a program that Ctrl-C ended
KNOWN = {  # what a scene may be told: option, unit
    "mass": "[kg] of the object",
    "friction_ground": "[1] of the object and the ground",
    "friction_finger": "[1] of the object and a fingertip",
}


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    top = argparse.ArgumentParser(
        prog="python -m tactilenlp",
        description="Find shape, motion and contact impulses of an object from touch.",
        epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    top.add_argument("--verbose", action="store_true", help="say what is being done")
    commands = top.add_subparsers(dest="command", required=True)

    estimate = commands.add_parser("estimate", help="estimate a recording")
    estimate.add_argument("file", type=Path, help="measurements, .npz (see README.md)")
    estimate.add_argument("--formulation", default="violation_implicit", help="a page")
    estimate.add_argument("--form", default="cuboid", help="kind of shape")
    estimate.add_argument("--save", type=Path, help="keep the estimate as .npz")
    for name, words in KNOWN.items():
        option = f"--{name.replace('_', '-')}"
        estimate.add_argument(option, type=float, help=f"{words}; else from the file")
    _add_outputs(estimate)

    report = commands.add_parser("report", help="show an estimate that was saved")
    report.add_argument("file", type=Path, help="an estimate, .npz")
    _add_outputs(report)
    return top


def _add_outputs(command) -> None:
    command.add_argument("--output", type=Path, help="write a page to look at, .html")
    command.add_argument(
        "--shape", type=Path, help="write the shape: .stl .obj .ply .glb .xml .urdf"
    )


def main(arguments: list[str] | None = None) -> int:
    """Run a command; return 0, or 2 and one line on stderr where it cannot be done."""
    given = parser().parse_args(arguments)
    logging.basicConfig(level=logging.INFO if given.verbose else logging.WARNING)
    try:
        _hand_out({"estimate": _estimate, "report": _load}[given.command](given), given)
    except (TactileError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    except Interrupted as stop:
        print(stop, file=sys.stderr)
        if stop.estimate is not None:
            _hand_out(stop.estimate, given)
        return STOPPED
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return STOPPED
    return 0


def _hand_out(estimate, given) -> None:
    """Print an estimate, and write whatever was asked for."""
    print(estimate.summary())
    if getattr(given, "save", None):
        estimate.save(given.save)
    if given.output:
        estimate.report(given.output)
    if given.shape:
        estimate.export(given.shape)


def _estimate(given):
    from . import Measurements, Scene, solve_estimate

    overrides = {name: getattr(given, name) for name in KNOWN}
    overrides = {name: value for name, value in overrides.items() if value is not None}
    return solve_estimate(
        Measurements.load(given.file),
        Scene.load(given.file, **overrides),
        shape=given.form,
        formulation=given.formulation,
    )


def _load(given):
    from . import Estimate

    return Estimate.load(given.file)


if __name__ == "__main__":
    sys.exit(main())
