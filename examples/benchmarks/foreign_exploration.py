"""Explore boxes in other worlds, in a closed loop of estimate, choice and action.

    python examples/benchmarks/foreign_exploration.py folder [--count 20] [--first 0]
        [--actions 5] [--departures contact] [--strengths default gel]
        [--policies eig random] [--executor processes|dask|mpi|none] [--workers 2]

The worlds are those of foreign_world.py with departures of foreign_departures.py: by
default plain MuJoCo's contact and gel fingertips.  Departures of how fingers push are
not among them, since `explore` chooses the pushes.  The first finger aims at a place
within AIM of the box; `explore` has default options and the true mass and frictions.
Judged after each action are the exact surface distance, and the three sizes, the
position and the rotation in standard deviations, with the verdict of the fit.  `nees`
is the mean square of these nine numbers: 1 where sigma is right.  After a refusal all
further actions are refused: outside 3 sigma, infinitely far, and not in `nees`.

Rows are kept in foreign_exploration.jsonl as they end (study.py): called again, the
script runs what is missing.  Policies are compared with random actions of the same box
by the tests of exploration_report.py.
"""

from time import process_time

import numpy as np
from exploration_report import comparison_lines
from foreign import arguments, errors_in, warm
from foreign_bodies import AIM, Box
from foreign_departures import DEPARTURES, Departure
from foreign_paths import STEP
from foreign_report import ratios
from foreign_world import REST, SCENE, ForeignWorld, Simulation, body_of
from judging import placed, quantile, refusal
from study import grouped, table, tabled_study, telling, write_csv
from trimesh.creation import box as box_mesh

from tactilenlp import Measurements, Scene, TrueBody, explore, surface_distance
from tactilenlp.errors import TactileError
from tactilenlp.geometry.interpolation import path_of

BEYOND = 5.0  # [sigma] further off is confidently wrong, if the fit is good
# Of a ForeignWorld: how its own pushes are.
OF_PUSHES = {"heights", "above", "touching", "carried", "speed", "path", "duration",
             "bumped"}  # fmt: skip
SUMMARY = ("n", "surface_mm", "p90_mm", "worst_mm", "within_3", "beyond_good", "nees")


class TouchedSimulation:
    """A box in plain MuJoCo as `explore` touches it: a TouchedWorld."""

    def __init__(self, box: Box, world: ForeignWorld):
        self.simulation, self.box, self.world = Simulation(box, world), box, world
        self.finger_radius = np.full(world.fingers, world.radius)
        self.samples, self.pose = 0, self.simulation.pose

    def execute(self, trajectory) -> Measurements:
        """Move the fingers along a trajectory; then take them away."""
        path, duration, parked = path_of(trajectory, self.world.fingers, np.inf, np.inf)
        simulation, rows = self.simulation, []
        every = round(1 / (self.world.rate * STEP))
        simulation.place(path(0.0))
        for k in range(int(duration / (every * STEP)) * every + 1):
            if k % every == 0:
                rows.append((*simulation.reading(), simulation.fingers))
                self.pose = simulation.pose
            simulation.step(path(k * STEP))
        simulation.lift()
        simulation.hold(REST)
        contact, normal, finger = map(np.array, zip(*rows, strict=True))
        contact &= ~parked
        first, self.samples = self.samples, self.samples + len(rows)
        return Measurements(
            time=(first + np.arange(len(rows))) * every * STEP,
            finger_position=finger, finger_radius=self.finger_radius, contact=contact,
            normal=np.where(contact[..., None], normal, 0.0),
            action=np.zeros(len(rows), int),
            valid=np.repeat(~parked[None], len(rows), axis=0),
        )  # fmt: skip

    def true_body(self, time: float) -> TrueBody:
        """Return the box where it was at the last sample."""
        position, quaternion = np.split(self.pose, [3])
        mesh = placed(box_mesh(self.box.sides), position, quaternion)
        return TrueBody(mesh, position, quaternion, self.box.sides)


def explored(departure, strength, number, actions, policy) -> list[dict]:
    """Return a row for the first touch and each action of one exploration."""
    warm()
    foreign = ForeignWorld(**DEPARTURES[departure][strength].world)
    box = body_of(foreign, number)
    world = TouchedSimulation(box, foreign)
    told = dict(zip(SCENE, (box.mass, box.ground, box.finger), strict=True))
    about = {"departure": departure, "strength": strength, "box": number}
    about |= {"policy": policy, "refused": ""}
    rng = np.random.default_rng([2031, number])
    centre = world.simulation.pose[:2] + rng.uniform(-AIM, AIM, 2)
    rows, began = [], process_time()
    try:
        for step in explore(
            world, Scene(**told), actions=actions, policy=policy, seed=number,
            centre=centre,
        ):  # fmt: skip
            estimate, true = step.estimate, world.true_body(0.0)
            off = surface_distance(estimate.mesh(), true.mesh)
            row = about | {"action": step.number, "surface_mm": 1e3 * off.mean}
            pose = true.position, true.quaternion
            row |= errors_in(estimate, box.sides, *pose)
            rows.append(row | {"cpu_s": process_time() - began})
            began = process_time()
    except TactileError as error:
        refused = about | {"refused": refusal(error)}
        rows += [refused | {"action": k} for k in range(len(rows), actions + 1)]
    return rows


def summary(rows) -> list[dict]:
    """Return one row for every world, policy and number of actions."""
    cell = "departure", "strength", "policy", "action"
    return [
        dict(zip(cell, key, strict=True), **summed(mine))
        for key, mine in sorted(grouped(rows, *cell).items())
    ]


def summed(rows) -> dict:
    """Return what some estimates have in common; refused ones are outside 3 sigma."""
    good = [row for row in rows if not row["refused"]]
    off = [row.get("surface_mm", np.inf) for row in rows]
    each = np.array([ratios(row) for row in rows])
    wrong = [(ratios(r) > BEYOND).any() and r["verdict"] == "good" for r in good]
    values = (
        len(rows), *(quantile(off, q) for q in (0.5, 0.9, 1.0)),
        float((each <= 3).mean()), int(sum(wrong)),
        float(np.mean(each[np.isfinite(each)] ** 2)) if good else np.nan,
    )  # fmt: skip
    return dict(zip(SUMMARY, values, strict=True))


def compared(rows) -> list[str]:
    """Return the tests of all policies against random actions, world by world."""
    lines = []
    for world, explored in grouped(rows, "departure", "strength").items():
        mine = [
            {"trial": r["box"], "start": " ".join(world), "policy": r["policy"],
             "action": r["action"], "p2s_mm": r.get("surface_mm", np.inf)}
            for r in explored
        ]  # fmt: skip
        lines += comparison_lines(mine, "p2s_mm")
    return lines


def main() -> None:
    worlds = [name for name, kinds in DEPARTURES.items() if _of_world(kinds)]
    parser = arguments(__doc__, "boxes", 20, 5, worlds)
    parser.set_defaults(departures=["contact"])
    parser.add_argument("--strengths", nargs="+", help="of these departures: all")
    parser.add_argument("--policies", nargs="+", default=["eig", "random"])
    chosen = parser.parse_args()
    cases = [
        (departure, strength, number, chosen.actions, policy)
        for number in range(chosen.first, chosen.first + chosen.count)
        for departure in chosen.departures
        for strength in DEPARTURES[departure]
        if not chosen.strengths or strength in chosen.strengths
        for policy in chosen.policies
    ]
    path = chosen.folder / "foreign_exploration"
    say = telling("refused", "surface_mm", "verdict")
    rows = tabled_study(chosen, path, explored, cases, say=say)
    cells = summary(rows)
    write_csv(chosen.folder / "foreign_exploration_summary.csv", cells)
    print(table(cells))
    for line in compared(rows):
        print(line)


def _of_world(kinds) -> bool:
    """Tell whether departures are of the world alone, and not of how fingers push.

    Sensors are told the truth.
    """
    return all(
        isinstance(kind, Departure) and kind.sensors is None and not kind.told
        and not OF_PUSHES & kind.world.keys()
        for kind in kinds.values()
    )  # fmt: skip


if __name__ == "__main__":
    main()
