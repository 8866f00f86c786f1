"""Judge estimates of boxes in worlds that the estimator was not developed with.

    python examples/benchmarks/foreign.py folder [--count 4] [--first 0] [--actions 4]
        [--departures contact "dropped at random"] [--recordings scenes/*.npz]
        [--executor processes|dask|mpi|none] [--workers 2]

Each cell is a departure from the estimator's assumptions at one strength
(foreign_departures.py) and a box in plain MuJoCo (foreign_world.py).  With recordings,
these stand for the boxes, so that only departures of the sensors and of what is told
apply.  The estimate is that of the default options with the true mass and frictions.

Judged are the three sizes, the final position and rotation: errors, their standard
deviations, which sizes are touched on both faces, the verdict of the fit, refusals and
CPU seconds.  A refusal counts as outside three sigma, and as one touched size that is
infinitely far off.  The script writes foreign.csv
(one row an estimate), foreign_summary.csv (one row a departure and strength) and
foreign.png.  Called again with the same folder, it runs what is missing.
"""

from functools import cache
from pathlib import Path

import numpy as np
from foreign_bodies import Box
from foreign_departures import DEPARTURES
from foreign_report import picture, summary
from foreign_world import ForeignWorld, body_of, recorded, told_of
from judging import solved, touched_sizes
from study import study_parser, table, tabled_study, telling, write_csv

from tactilenlp import Measurements, Scene, solve_estimate
from tactilenlp.evaluation.metrics import cuboid_errors

TOLD = ("refused", *(f"side_{a}_error" for a in "xyz"), "verdict", "cpu_s")


def measured(
    departure: str, strength: str, number: int, actions: int, file=None, body=Box
):
    """Return measurements, scene and true arrays of a cell.

    file: of the recording; without one, a Box or a Hull is pushed: body.
    """
    chosen = DEPARTURES[departure][strength].of(number)
    if file is None:
        world = ForeignWorld(**chosen.world)
        true = recorded(body_of(world, number, body), world, actions)
        data, scene = told_of(true)
    else:
        true, data, scene = np.load(file), Measurements.load(file), Scene.load(file)
        data = data.select(np.unique(data.action)[:actions])
    return chosen.measured(data, number), chosen.scene(scene), true


def judged(departure: str, strength: str, number: int, actions: int, file=None) -> dict:
    """Return one row of the table [mm]; rotations count at the corners of the box."""
    warm()
    data, scene, true = measured(departure, strength, number, actions, file)
    name = f"box {number}" if file is None else Path(file).stem
    row = {"departure": departure, "strength": strength, "box": name}
    estimate, told = solved(data, scene)
    row |= told
    if estimate is None:
        return row
    last = data.samples - 1
    pose = true["object_position"][last], true["object_quaternion"][last]
    row |= errors_in(estimate, true["side_lengths"], *pose)
    return row | touched_sizes(data, true["object_quaternion"])


def errors_in(estimate, sides, position, quaternion) -> dict:
    """Return errors and deviations of sizes and last pose [mm], and the verdict."""
    row = {"verdict": estimate.fit.verdict, "nats": estimate.objective}
    found = estimate.side_lengths, estimate.position[-1], estimate.quaternion[-1]
    error = cuboid_errors(*found, sides, position, quaternion)
    sigma, arm = estimate.information.sigma, np.linalg.norm(sides) / 2
    for part, errors, sigmas in (
        ("side", error.side_lengths, sigma("side_lengths")[error.permutation]),
        ("position", error.position, sigma("position")),
        ("rotation", arm * error.rotation_vector, arm * sigma("rotation")),
    ):
        for axis, e, s in zip("xyz", errors, sigmas, strict=True):
            row |= {f"{part}_{axis}_error": 1e3 * e, f"{part}_{axis}_sigma": 1e3 * s}
    return row


@cache
def warm(body=Box, shape="cuboid") -> None:
    """Compile the terms once in each process: CPU seconds are of estimates alone."""
    data, scene, _ = measured("none", "", 0, 2, body=body)
    solve_estimate(data, scene, shape=shape, throw=False)


def cells(chosen) -> list[tuple]:
    """Return the arguments of `judged` of every estimate."""
    boxes = [(chosen.first + k,) for k in range(chosen.count)]
    if chosen.recordings:
        boxes = [(k, file) for k, file in enumerate(chosen.recordings)]
    return [
        (departure, strength, number, chosen.actions, *file)
        for departure in chosen.departures
        for strength, kind in DEPARTURES[departure].items()
        for number, *file in boxes
        if not (chosen.recordings and kind.of(number).world)
    ]


def arguments(about: str, bodies: str, count: int, actions: int, departures):
    """Return the parser of a study of so many bodies by departure."""
    parser = study_parser(about)
    parser.add_argument("--count", type=int, default=count, help=bodies)
    parser.add_argument("--first", type=int, default=0, help="number of a first one")
    parser.add_argument("--actions", type=int, default=actions)
    parser.add_argument(
        "--departures", nargs="+", choices=departures, default=[*departures]
    )
    parser.set_defaults(recordings=[])
    return parser


def main() -> None:
    parser = arguments(__doc__, "boxes", 4, 4, DEPARTURES)
    parser.add_argument("--recordings", nargs="*", default=[])
    chosen = parser.parse_args()
    path = chosen.folder / "foreign"
    rows = tabled_study(chosen, path, judged, cells(chosen), say=telling(*TOLD))
    kinds = summary(rows)
    write_csv(chosen.folder / "foreign_summary.csv", kinds)
    print(table(kinds))
    picture(rows, path.with_suffix(".png"))


if __name__ == "__main__":
    main()
