"""Axes of the stress suite that change how a problem is stated, not the recording.

Most compare two solves that must agree: from the same start at a tight tolerance, or
end to end.
"""

from __future__ import annotations

import time
from dataclasses import replace
from functools import cache, partial
from resource import RUSAGE_SELF, getrusage
from types import SimpleNamespace

import numpy as np
from judging import planar_path, stated
from scipy.spatial.transform import Rotation
from stability_judge import RULE, Axis, Case, estimated, row, same, solved
from stability_pages import Edited, InUnits, page_of
from stability_scenes import recorded

from tactilenlp import (
    ExpectedInformation,
    Ground,
    Guess,
    Options,
    SolverOptions,
    Workspace,
    information_gain,
)
from tactilenlp.solvers.solve import solve_levels

EXACT, CLOSE, END = 1e-6, 1e-6, 0.01  # [relative], [m], [sigma] of two solves
STILL = np.eye(3), np.zeros(3)  # R, t [m]: nothing has moved
TIGHT = 1e-9  # tolerance of solves that are compared
OFF = np.array([1e-3, -1e-3, 0.03])  # [m, m, rad] of a start from the true path
LINEAR = 2.0  # [-] of the cost per sample: what a linear cost stays within
WEIGHTS = ("kappa", "speed rounding", "balance sigma", "cone rounding")
LOCAL = ("cuboid", "shooting", "complementarity")


def local(case: Case, page, theta, x, tolerance=TIGHT):
    """Solve a page once from sizes (3,) and a path (3, T): no search."""
    problem, window = stated(page, case.data, case.scene, theta, x)
    options = SolverOptions(tolerance=tolerance)
    start = {"theta": theta, "x": x[:, window.last]}
    solution = solve_levels(problem, page.LEVELS, start, options)
    return SimpleNamespace(
        theta=solution.values["theta"][:, 0], x=solution.values["x"][:, window.pose],
        solution=solution, samples=case.data.samples,
    )  # fmt: skip


def begun(case: Case):
    """Return sizes (3,) and path (3, T) of a start near the truth."""
    x = planar_path(case.truth.position, case.truth.quaternion)
    return case.truth.sides * 1.03, x + OFF[:, None]


@cache
def reference(way, actions=3):
    """Return the local solve that others of this way are compared with."""
    case = recorded(actions)
    return local(case, page_of(way), *begun(case))


@cache
def whole_reference(way):
    return solved(recorded(), way)


UNITS = {"mm": {"m": 1e3}, "g": {"N s": 1e3}, "mm and g": {"m": 1e3, "N s": 1e6}}


def units(value: str, way: str) -> list[dict]:
    """Keep the unknowns in other units: the result is the same."""
    case, numbers = recorded(3), UNITS[value]
    theta, x = begun(case)
    length = numbers.get("m", 1.0)
    f = np.c_[[length, length, 1.0]]
    mine = local(case, InUnits(page_of(way), numbers), theta * length, x * f)
    return [same("estimate", apart(mine.theta / length, mine.x / f, way), EXACT, "-")]


def apart(theta, x, way) -> float:
    """Return how far sizes and path are from those of the reference, relative."""
    other = reference(way)
    off = np.abs(x - other.x).max() / np.abs(other.x).max()
    return max(np.abs(theta / other.theta - 1).max(), off)


def moved_by(value: str):
    """Return R (3, 3), t (3,) [m], and the yaw [rad] of a motion of the world."""
    kind, size = value.split()[:2]
    if kind == "turned":
        yaw = np.radians(float(size))
        return Rotation.from_rotvec([0, 0, yaw]).as_matrix(), np.zeros(3), yaw
    ways = {"aside": [1.0, -0.5, 0], "up": [0, 0, 1.0]}
    return np.eye(3), float(size) * np.array(ways[kind]), 0.0


def world(value: str, way: str) -> list[dict]:
    """Move the world: the estimate moves along."""
    R, t, yaw = moved_by(value)
    case, rows = recorded(), []
    there = replace(
        case, data=case.data.transformed(R, t),
        scene=replace(case.scene, ground=Ground(height=t[2])),
    )  # fmt: skip
    if way in LOCAL and t[2] == 0:
        first = recorded(3)
        moved = replace(first, data=first.data.transformed(R, t))
        theta, x = begun(first)
        x = np.vstack([R[:2, :2] @ x[:2] + t[:2, None], x[2] + yaw])
        mine = local(moved, page_of(way), theta, x)
        back = R[:2, :2].T @ (mine.x[:2] - t[:2, None])
        rows.append(same_start(mine.theta, back, way))
    if way in ("cuboid", "polytope"):
        rows.append(end_to_end(there, way, (R, t)))
    return rows


def same_start(theta, places, way) -> dict:
    """Return the row of sizes (3,) and places (2, T) [m] solved from the same start."""
    other = reference(way)
    off = np.abs(theta - other.theta).max(), np.abs(places - other.x[:2]).max()
    return same("same start", max(off), CLOSE, "m")


def end_to_end(case, way, motion=STILL) -> dict:
    """Return the row of a case whose estimate is the recorded one's, moved by R, t."""
    R, t = motion
    before, after = whole_reference(way), solved(case, way)
    moved = (after.position[-1] - t) @ R - before.position[-1]
    off = np.abs(moved) / before.information.sigma("position")
    if before.shape == "cuboid":
        sizes, sigma = before.side_lengths, before.information.sigma("side_lengths")
        sides = np.abs(np.sort(after.side_lengths) - np.sort(sizes))
        off = np.r_[off, sides / sigma[np.argsort(sizes)]]
    return same("end to end", float(off.max()), END, "sigma")


def labels(value: str, way: str) -> list[dict]:
    """Name the fingers, or the body's axes, in another order: the same body."""
    case = recorded()
    if value == "fingers":
        arrays = {n: a for n, a in vars(case.data).items() if a is not None}
        order = {n: a[:, ::-1] for n, a in arrays.items() if np.ndim(a) > 1}
        radius = case.data.finger_radius[::-1]
        swapped = replace(case.data, **order | {"finger_radius": radius})
        return [end_to_end(replace(case, data=swapped), way)]
    quarters, first = int(value.split()[2]) // 90, recorded(3)
    theta, x = begun(first)
    theta = theta[[1, 0, 2]] if quarters % 2 else theta
    x = x + np.c_[[0, 0, quarters * np.pi / 2]]
    mine = local(first, page_of(way), theta, x)
    sizes = mine.theta[[1, 0, 2]] if quarters % 2 else mine.theta
    return [same_start(sizes, mine.x[:2], way)]


def starts(value: str) -> Case:
    """Guess sizes and a first pose that are wrong by what the value says."""
    case = recorded()
    factor, turn = value.split(", ")
    sides = float(factor.split("x")[0]) * case.truth.sides
    yaw = begun(case)[1][2, 0] + np.radians(float(turn.split()[0]))
    return replace(case, start=Guess(sides, case.truth.position[0, :2] + 0.01, yaw))


def weighted(name: str, value: str) -> Case:
    """Multiply a smoothing or a penalty of the page."""
    page = Edited(page_of("cuboid"), factors={name: float(value.split("x")[1])})
    return replace(recorded(), page=page)


def assumed(value: str) -> Case:
    """Take mass or friction for what they are not."""
    name, factor = value.split(" x")
    names = ("friction_ground", "friction_finger") if name == "friction" else (name,)
    case = recorded()
    wrong = {name: getattr(case.scene, name) * float(factor) for name in names}
    return replace(case, scene=replace(case.scene, **wrong))


def prior(value: str, way: str) -> list[dict]:
    """Scale what is known: an action tells less the more is known, always finite."""
    estimate, space = whole_reference(way), Workspace()
    expected, rng = ExpectedInformation(estimate, space), np.random.default_rng(1)
    known, action = expected.beliefs[0].information, space.random(rng)
    told = expected.prospect(action).information
    gain, less = (
        information_gain(factor * float(value) * known, told) for factor in (1, 10)
    )
    words = f"{gain:.3g} nats, {less:.3g} where ten times as much is known"
    return [row("gain", "right" if 0 <= less <= gain < np.inf else "rule broken",
                words=words)]  # fmt: skip


def solver(value: str, way: str) -> list[dict]:
    """Let IPOPT factorise otherwise: the result is the same."""
    case = replace(recorded(), options=Options(ipopt={"linear_solver": value}))
    return [end_to_end(case, way)]


def cost(value: str, way: str) -> list[dict]:
    """Solve ever more actions from a start near the truth: the cost stays linear."""
    few, many = reference_cost(way, 4), reference_cost(way, int(value))
    grown = many[0] / few[0]
    words = f"{1e6 * many[0]:.0f} us per sample and iteration, {many[1]:.0f} MB"
    good = grown <= LINEAR and many[2]
    return [row("estimate", "right" if good else "rule broken", words=words)]


@cache
def reference_cost(way, actions):
    """Return CPU seconds per sample and iteration, memory so far [MB], converged."""
    case, began = recorded(actions), time.process_time()
    done = local(case, page_of(way), *begun(case), tolerance=1e-6)
    seconds = time.process_time() - began
    each = seconds / done.samples / max(1, done.solution.iterations)
    memory = getrusage(RUSAGE_SELF).ru_maxrss / 1024
    return each, memory, done.solution.success


def many(value: str) -> Case:
    return recorded(int(value))


AXES = (
    Axis(
        "internal units", f"the same to {EXACT:g} relative, from the same start",
        tuple(UNITS), units, {"cuboid": True, "quasi-static": ("mm",)},
    ),
    Axis(
        "world moved", f"the same to {CLOSE:g} m from the same start, to {END} sigma",
        ("aside 0.3 m", "up 0.2 m", "turned 30 deg", "turned 90 deg", "turned 137 deg"),
        world,
        {"cuboid": True, "polytope": ("aside 0.3 m", "turned 30 deg"),
         "shooting": ("turned 30 deg",), "complementarity": ("turned 30 deg",)},
    ),
    Axis(
        "labels", f"the same to {CLOSE:g} m from the same start, to {END} sigma",
        ("fingers", "body turned 90 deg", "body turned 180 deg"), labels,
        {"cuboid": True, "polytope": ("fingers",),
         "shooting": ("body turned 90 deg",),
         "complementarity": ("body turned 90 deg",)},
    ),
    Axis(
        "start", RULE,
        tuple(f"{size}x, {turn} deg" for size, turn in
              ((0.3, 0), (0.5, 90), (1, 180), (2, 45), (3, 0), (3, 180))),
        estimated(starts),
        {"cuboid": True, "shooting": ("0.5x, 90 deg", "2x, 45 deg"),
         "complementarity": ("1x, 180 deg",)},
    ),
    *(
        Axis(
            name, RULE, tuple(f"x1e{k:+d}" for k in (-3, -2, -1, 1, 2, 3)),
            estimated(partial(weighted, name)), {"cuboid": True},
            # A thousand times stiffer or softer than physics: it need not converge.
            may_refuse=(("x1e-3", "*"), ("x1e+3", "*")),
        )
        for name in WEIGHTS
    ),
    Axis(
        "assumed wrong", RULE,
        tuple(f"{name} x{f}" for name in ("mass", "friction") for f in (0.5, 2)),
        estimated(assumed),
        {"cuboid": True, "polytope": ("mass x2", "friction x0.5"),
         "shooting": ("friction x0.5",)},
    ),
    Axis(
        "information prior", "finite, not negative, less where more is known",
        tuple(f"1e{k:+d}" for k in range(-6, 7, 2)), prior, {"cuboid": True},
    ),
    Axis(
        "linear solver", f"the same to {END} sigma", ("mumps", "spral"), solver,
        {"cuboid": True, "polytope": ("mumps",)},
        may_refuse=(("spral", "*"),),  # CasADi may come without it
    ),
    Axis(
        "actions", RULE, ("1", "2", "6", "10", "20"), estimated(many),
        {"cuboid": True, "polytope": ("1", "6")},
    ),
    Axis(
        "cost", f"seconds per sample and iteration within {LINEAR:g}x those of four",
        ("10", "30", "100"), cost, {"cuboid": True},
    ),
)  # fmt: skip
