"""Estimate bodies outside the shape's class: error against the best fit.

    python examples/benchmarks/mismatch.py folder [--trials 3] [--actions 9]
        [--executor processes|dask|mpi|none]

A cylinder and ellipsoids are estimated as a polytope, prisms and a cylinder
as a cuboid.  A dodecahedron and a box, which belong to their class, show the error that
nine touches leave in any case.  Each body is touched at random in simulation.  best:
exact surface distance of the member of the class that is fitted to the true surface;
error: that of the estimate; at touches: the same two for the true contact points.
Errors of faces with three touches or more are compared with their sigma; wrong: those
beyond 1 mm and 5 sigma.  nats: cost of a touch, which shows a bad fit.

Called again with the same folder, the script runs what is missing.  It writes
mismatch.csv and mismatch.png.
"""

import matplotlib.pyplot as plt
import numpy as np
import trimesh
from estimate_polytope import carried_along, sure, touch_at_random
from exploration_objects import world_of
from judging import quantile, solved
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from study import grouped, study_parser, table, tabled_study, telling
from trimesh.convex import convex_hull
from trimesh.proximity import closest_point_naive
from trimesh.transformations import translation_matrix

from tactilenlp import Scene, World, surface_distance
from tactilenlp.geometry.convex_hull import hull_vertices, nearest_triangles
from tactilenlp.geometry.simplification import fewer_vertices, more_vertices

POINTS = 1000  # of the true surface, to which a class is fitted
ROUNDS, STEP = 30, 0.5  # of the fit of vertices, and how far it goes each time
SEED = 2027
TOLD = ("said", "best_mm", "error_mm", "wrong", "faces", "nats")


def prism(sides: int, radius=0.025, height=0.04) -> np.ndarray:
    """Return the corners (2 sides, 3) [m] of an upright prism."""
    turn = 2 * np.pi * np.arange(sides) / sides
    ring = radius * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    up = np.array([0, 0, height / 2])
    return np.vstack([ring - up, ring + up])


def ellipsoid(foot=0.0, semi_axes=(0.028, 0.02, 0.016)) -> np.ndarray:
    """Return points (V, 3) [m] of an ellipsoid, cut off below by a share of its height.

    Without a foot it rocks.
    """
    points = trimesh.creation.icosphere(subdivisions=3).vertices
    points[:, 2] = np.maximum(points[:, 2], 2 * foot - 1)
    return points * semi_axes


BODIES = {  # the body's name, its class -> corners (V, 3) [m]
    ("cylinder", "polytope"): prism(48),
    ("ellipsoid", "polytope"): ellipsoid(),
    ("cylinder", "cuboid"): prism(48),
    ("hexagonal prism", "cuboid"): prism(6),
    ("triangular prism", "cuboid"): prism(3),
    ("ellipsoid on a foot", "polytope"): ellipsoid(foot=0.15),
    ("dodecahedron", "polytope"): world_of(3, "polytope").vertices,
    ("box", "cuboid"): trimesh.creation.box((0.05, 0.04, 0.04)).vertices,
}


def played(name: str, shape: str, trial: int, actions: int) -> World:
    """Return the world in which a body was touched at random."""
    number = [*BODIES].index((name, shape))
    rng = np.random.default_rng([SEED, number, trial])
    yaw = rng.uniform(0, 2 * np.pi)
    turn = [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
    world = World(vertices=BODIES[name, shape], quaternion=turn)
    touch_at_random(world, rng, actions)
    return world


def best_polytope(mesh, count: int = 20):
    """Return the polytope of so many vertices fitted to a surface by nearest points."""
    points, _ = trimesh.sample.sample_surface_even(mesh, POINTS, seed=SEED)
    V = more_vertices(fewer_vertices(mesh.vertices, count), count)
    found, best = convex_hull(V), np.inf
    for _ in range(ROUNDS):
        V = more_vertices(hull_vertices(V), count)
        on, corners = nearest_triangles(V, points)
        off = points - on
        share = np.zeros((len(points), count))
        each = trimesh.triangles.points_to_barycentric(V[corners], on)
        np.put_along_axis(share, corners, each, axis=1)
        move = np.linalg.lstsq(share, off, rcond=1e-3)[0]
        hull = convex_hull(V)
        distance = surface_distance(hull, mesh, POINTS).mean
        if distance < best:
            found, best = hull, distance
        V = V + STEP * move
    return found


def best_box(mesh):
    """Return the box that lies on the ground and fits a surface best."""

    def box(z):
        R = Rotation.from_euler("z", z[2]).as_matrix()
        place = translation_matrix([z[0], z[1], z[5] / 2])
        place[:3, :3] = R
        return trimesh.creation.box(np.abs(z[3:]) + 1e-4, place)

    def off(z):
        return 1e3 * surface_distance(box(z), mesh, POINTS // 4).mean

    ends = []
    for yaw in np.pi / 12 * np.arange(6):
        flat = Rotation.from_euler("z", -yaw).apply(mesh.vertices - mesh.centroid)
        sides = 0.9 * np.ptp(flat, axis=0)
        start = np.r_[mesh.centroid[:2], yaw, sides[:2], np.ptp(mesh.vertices[:, 2])]
        steps = np.vstack([start, start + np.diag([2e-3, 2e-3, 0.1, *3 * [3e-3]])])
        told = {"initial_simplex": steps, "maxiter": 150}
        ends.append(minimize(off, start, method="Nelder-Mead", options=told))
    return box(min(ends, key=lambda end: end.fun).x)


def away(mesh, points) -> float:
    """Return the mean distance [mm] of points (n, 3) [m] from a surface."""
    return 1e3 * closest_point_naive(mesh, points)[1].mean()


def touches_of(estimate, planes) -> np.ndarray:
    """Return how many samples touched each supporting plane."""
    if estimate.shape != "cuboid":
        return planes.touches
    n = planes.normal @ estimate.rotation()
    axis, side = np.argmax(np.abs(n), axis=1), (n.sum(axis=1) > 0).astype(int)
    return estimate.faces[axis, side]


def measured(name: str, shape: str, trial: int, actions: int) -> dict:
    """Return one row of the table."""
    world = played(name, shape, trial, actions)
    data = world.measurements
    mesh = world.true_body(data.time[-1]).mesh
    known = ("mass", "friction_ground", "friction_finger", "gravity")
    scene = Scene(**{key: getattr(world, key) for key in known})
    fit = best_polytope(mesh) if shape == "polytope" else best_box(mesh)
    row = {"body": name, "class": shape, "trial": trial, "actions": actions}
    felt = world.truth.contact & data.valid
    points = carried_along(world.truth, felt, data.finger_radius)
    row["best_mm"] = 1e3 * surface_distance(fit, mesh).mean
    row["best_touched_mm"] = away(fit, points)
    estimate, told = solved(data, scene, shape=shape)
    row |= {"said": told["refused"], "cpu_s": told["cpu_s"]}
    if estimate is None:
        return row
    planes = estimate.supporting_planes()
    faces = sure(planes, touches_of(estimate, planes), mesh)
    distance = surface_distance(estimate.mesh(), mesh)
    return row | {
        "error_mm": 1e3 * distance.mean,
        "worst_mm": 1e3 * distance.maximum,
        "touched_mm": away(estimate.mesh(), points),
        "faces": faces["planes"], "ratio": faces["ratio"], "wrong": faces["wrong"],
        "nats": estimate.costs["touch"] / int((data.contact & data.valid).sum()),
    }  # fmt: skip


def summary(rows) -> list[dict]:
    """Return medians of each body, its confident errors and refusals.

    A refusal is infinitely far.
    """
    out, keys = [], ("best_mm", "error_mm", "best_touched_mm", "touched_mm", "ratio")
    for (name, shape), mine in grouped(rows, "body", "class").items():
        good = [r for r in mine if not r["said"]]
        line = {"body": name, "class": shape, "n": len(mine)}
        line |= {"refused": len(mine) - len(good)}
        for key in (*keys, "nats"):
            line[key] = quantile([r.get(key, np.inf) for r in mine])
        out.append(line | {k: sum(r[k] for r in good) for k in ("wrong", "faces")})
    return out


def picture(rows, path) -> None:
    """Draw every estimate's error against its class's best, all over and at touches."""
    shown = {
        "whole surface": ("best_mm", "error_mm"),
        "where it was touched": ("best_touched_mm", "touched_mm"),
    }
    figure, axes = plt.subplots(1, 2, figsize=(10, 4))
    for ax, (title, (best, error)) in zip(axes, shown.items(), strict=True):
        for k, (name, shape) in enumerate(BODIES):
            mine = [r for r in rows if (r["body"], r["class"]) == (name, shape)]
            good = [r for r in mine if not r["said"]]
            places = [r[best] for r in good], [r[error] for r in good]
            mark = "o" if shape == "polytope" else "s"
            ax.plot(*places, mark, color=f"C{k}", label=f"{name} as {shape}")
        end = max(ax.get_xlim()[1], 1.0)
        ax.plot([0, end], [0, end], color="0.5", linestyle=":", label="the best")
        ax.set(title=title, xlabel="best of its class [mm]", xlim=(-end / 30, end))
        ax.set_ylim(bottom=0)
    axes[0].set_ylabel("error of the estimate [mm]")
    axes[1].legend(fontsize="x-small")
    figure.tight_layout()
    figure.savefig(path, dpi=150)


def main() -> None:
    parser = study_parser(__doc__)
    parser.add_argument("--trials", type=int, default=3)
    parser.add_argument("--actions", type=int, default=9)
    chosen = parser.parse_args()
    cells = [
        (*body, k, chosen.actions) for body in BODIES for k in range(chosen.trials)
    ]
    path = chosen.folder / "mismatch"
    rows = tabled_study(chosen, path, measured, cells, say=telling(*TOLD))
    print(table(summary(rows)))
    picture(rows, path.with_suffix(".png"))


if __name__ == "__main__":
    main()
