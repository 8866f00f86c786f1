"""Measure each reduction: problem size, time and optimum with it and without it.

python examples/benchmarks/reductions.py ../shared/scenes/cuboid_0?.npz
    ../shared/scenes/platonic_*_?.npz [--executor processes|dask|mpi|none]

A recording whose truth has vertices is estimated as a polytope, any other as a cuboid.
All variants of one problem start from the same hypothesis, the best of a search.  Times
are medians of passes that try all variants in turn, so that ratios come from one run; a
first pass, uncounted, derives the term functions.

The reductions `still`, `far`, `absent` and `planar` omit what one recording does not
need.  Frictionless, one finger and no ground are other scenes, each stated with and
without what it lacks: tangential impulses that no cone allows, a finger that never
measures, a ground without friction a metre below a simulated body that floats.

put back: the optimum of the most reduced problem, and the optimum that is reached from
it after the omitted parts are restored.  Exact reductions do not change it.  Objects at
rest that get poses of their own may gain a little, and so may free tilts, since the
shape of a polytope can adapt.
"""

import time
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from reductions_report import BASE, NONE, failed, print_pairs, print_table
from study import executor_of, grouped, mapped, study_parser, write_csv

from formulations import polytope_violation_implicit, violation_implicit
from formulations.polytope import polytope
from formulations.shape import CUBOID, Shape
from tactilenlp import Ground, Measurements, Options, Scene, solve_estimate
from tactilenlp.common.deadline import Deadline
from tactilenlp.data.sensor_noise import precision_of, smooth_paths
from tactilenlp.geometry.tipping import planar_to_free
from tactilenlp.local.local_solve import (
    built_page,
    freed_to_tilt,
    solved_from,
    warm_started,
)
from tactilenlp.local.solved import BuiltPage, Solved
from tactilenlp.problem.hypothesis import Hypothesis
from tactilenlp.problem.job import Job
from tactilenlp.problem.reductions import Reductions
from tactilenlp.search.polytope_init import search_polytope
from tactilenlp.search.proposals_floating import (
    in_free_motion,
    in_search_plane,
    search_plane,
)
from tactilenlp.simulation.world import World

PAGES = {"cuboid": violation_implicit, "polytope": polytope_violation_implicit}
SHAPES = {"cuboid": CUBOID, "polytope": polytope()}
EXACT = ("still", "far", "absent")
REACH = 1.0  # [m] over a ground out of reach
LONGEST = 600.0  # [s] of one problem
TO_THE_END = Options(ipopt={"acceptable_iter": 0})  # however slowly it creeps


@dataclass(frozen=True)
class Way:
    """One way of writing a problem: reductions off; up [m] from the guessed height."""

    data: Measurements
    scene: Scene
    off: tuple = ()
    up: float = 0.0
    shape: Shape = CUBOID

    @property
    def page(self):
        """The joint page of the shape."""
        return PAGES[self.shape.name]

    def job(self) -> Job:
        """Return what a solve needs to know."""
        precision = precision_of(self.data, self.scene)
        return Job(
            smooth_paths(self.data, precision), self.scene, self.shape, precision,
            Reductions.of(self.off), self.page, Options(), Deadline.within(LONGEST),
            functions={},
        )  # fmt: skip


def one_finger(data, arrays: bool) -> Measurements:
    """Return the data of finger 0; the others never valid, or not in the arrays."""
    keys = ("time", "finger_position", "finger_radius", "contact", "normal", "action")
    given = {key: getattr(data, key) for key in (*keys, "valid")}
    if not arrays:
        return Measurements(
            **given | {"valid": data.valid & (np.arange(data.fingers) < 1)}
        )
    per_finger = ("finger_position", "contact", "normal", "valid")
    given |= {key: given[key][:, :1] for key in per_finger}
    return Measurements(**given | {"finger_radius": data.finger_radius[:1]})


def recorded(file) -> Way:
    """Return the leanest way of writing the problem of a recording."""
    with np.load(file) as known:
        shape = SHAPES["polytope" if "vertices" in known else "cuboid"]
    return Way(Measurements.load(file), Scene.load(file), shape=shape)


def searched(way) -> Hypothesis:
    """Return the best hypothesis of a search."""
    if way.shape.own_pages:  # its page takes a refined one for a rough one
        return search_polytope(way.job(), [])[0]
    return solve_estimate(way.data, way.scene, throw=False).hypotheses[0]


def problems(way) -> dict[str, Way]:
    """Return the ways of writing the problem of a recording, and of scenes like it."""
    data, scene = way.data, way.scene
    slippery = replace(scene, friction_ground=0.0, friction_finger=0.0)
    out = {BASE: Way(data, scene), "planar alone": Way(data, scene, EXACT)}
    out |= {f"without {name}": Way(data, scene, (name,)) for name in NONE}
    if data.fingers > 1:
        out["second finger never valid"] = Way(one_finger(data, False), scene)
        out["no second finger"] = Way(one_finger(data, True), scene)
    out |= {
        "no reduction": Way(data, scene, NONE),
        "no friction": Way(data, slippery),
        "tangential impulses kept": Way(data, slippery, ("frictionless",)),
    }
    return {name: replace(one, shape=way.shape) for name, one in out.items()}


def floating(shape) -> tuple[dict[str, Way], Hypothesis]:
    """Return both ways for a box that two fingers squeeze, and where it was found.

    shape: the class as which it is estimated.
    """
    world = World((0.04, 0.06, 0.05), position=(0, 0, 0.2), ground=None, gravity=0.0)
    left, right = [(-0.06, 0.008, 0.204), (0, 0.008, 0.204)], [(0.07, -0.01, 0.196)]
    path = np.stack([left, [*right, (0.035, -0.01, 0.196)]], axis=1)
    world.execute(SimpleNamespace(time=np.array([0, 1.2]), finger_position=path))
    data, scene = world.measurements, Scene(ground=None, gravity=0, friction_ground=0)
    raised = data.transformed(np.eye(3), np.array([0, 0, REACH]))
    below = replace(scene, ground=Ground())
    ways = {
        "no ground": Way(data, scene, ("planar",), shape=shape),
        "ground out of reach": Way(raised, below, ("planar",), REACH, shape),
    }
    lean = Way(data, scene, shape=shape)
    plane = search_plane(lean.job())
    if shape.own_pages:
        best = search_polytope(in_search_plane(lean.job(), plane), [])[0]
    else:
        best = searched(lean)
    return ways, in_free_motion(best, plane, shape)


def written(way, h) -> tuple[Job, Hypothesis, BuiltPage]:
    """Return a job, where its solve starts, and its page, from planar poses of h."""
    job = way.job()
    if not job.reductions.planar:
        x = planar_to_free(h.theta, h.x, way.shape) if len(h.x) == 3 else h.x
        h = replace(h, x=x + np.array([[0], [0], [way.up], [0], [0], [0]]))
    return job, h, built_page(job, h)


def begun(way, h) -> Solved:
    """Return a problem solved from a hypothesis."""
    return solved_from(*written(way, h))


def to_the_end(way, found) -> Solved:
    """Return a solve that went on to the end, with what `way` does not leave out."""
    job = replace(way.job(), options=TO_THE_END)
    on = freed_to_tilt if "planar" in way.off else warm_started
    return on(job, found)


def put_back(ways, h) -> dict[str, float]:
    """Return the optimum with all reductions, and with each one put back there."""
    lean = to_the_end(ways[BASE], begun(ways[BASE], h))
    found = {BASE: lean}
    found |= {
        k: to_the_end(ways[k], lean) for k in (f"without {name}" for name in NONE)
    }
    return {
        name: one.solution.objective if one.solution.success else np.nan
        for name, one in found.items()
    }


def solved(way, h) -> dict:
    """Build and solve one problem, from a hypothesis; return its row."""
    began = time.process_time()
    found = begun(way, h)
    problem, solution = found.problem, found.solution
    *presolve, joint = solution.iterations_by_level
    return {
        "variables": problem.size,
        "constraints": problem.rows,
        "terms": sum(term.instances for term in problem.terms.values()),
        "presolve": sum(presolve),
        "joint": joint,
        "ms/it": 1e3 * solution.seconds["solve"] / max(1, solution.iterations),
        "CPU s": time.process_time() - began,
        "optimum": solution.objective,
        "status": solution.status,
    }


def tried(*arguments) -> dict:
    """Return what a problem took, or its failure."""
    try:
        return solved(*arguments)
    except Exception as error:  # whatever it is, it is a line of the table
        return failed(error)


def scene_table(file, passes) -> list[dict]:
    """Return a row for every way of writing the problem of one recording.

    file: or the name of the class as which a box that floats is estimated.
    """
    if file in SHAPES:
        ways, h = floating(SHAPES[file])
        return timed(f"a floating {file}", ways, h, passes, {})
    way = recorded(file)
    ways, h = problems(way), searched(way)
    return timed(Path(file).stem, ways, h, passes, put_back(ways, h))


def timed(scene, ways, h, passes, back) -> list[dict]:
    """Return a row for every way, with median times; a first pass is not counted."""
    _, *runs = [
        {name: tried(way, h) for name, way in ways.items()} for _ in range(passes + 1)
    ]
    rows = []
    for name, way in ways.items():
        row = {"scene": scene, "class": way.shape.name, "way": name} | runs[-1][name]
        for key in ("ms/it", "CPU s"):
            row[key] = float(np.median([run[name][key] for run in runs]))
        rows.append(row | {"put back": back.get(name, np.nan)})
    return rows


def main() -> None:
    parser = study_parser(__doc__, folder=False, executor="none")
    parser.add_argument("files", nargs="+")
    parser.add_argument("--passes", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("benchmark"))
    arguments = parser.parse_args()
    rows, files = [], [*arguments.files, *SHAPES]
    with executor_of(arguments) as executor:
        cases = [(file, arguments.passes) for file in files]
        for found in mapped(executor, scene_table, cases):
            rows += found
            print_table(found)
    for (name,), some in grouped(rows, "class").items():
        print_pairs(name, some)
    write_csv(arguments.out / "reductions.csv", rows)


if __name__ == "__main__":
    main()
