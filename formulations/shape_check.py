r"""Compare the functions of a Shape with each other: distance, normal, inertia, mesh.

On rays u from the origin the distance is zero at r(u) (bisection).  For M evenly spread
rays, each with the solid angle 4 pi / M, a body that its origin sees has

    volume = sum r^3 / 3,   centroid = sum r^4 u / 4 / volume,
    Sigma = sum r^5 u u' / 5 / volume,   inertia = trace(Sigma) I - Sigma,

against which inertia and origin are checked.  From each point of the surface, TIP
along the normal, the distance must be TIP: a signed distance, not just any function
that is zero on the surface.  From each point TIP farther out on its ray, the distance
back along the normal must lead to the surface, beyond edges as well: the largest of
the distances from the planes of faces is too short there.
"""

from __future__ import annotations

import random
from functools import cache
from math import cos, pi, sin, sqrt

import casadi as ca

from .shape import half_diagonal
from .shape_fields import unfit_fields
from .shape_report import Disagreement, ShapeReport
from .size_prior import entries

PROBES = 1000
BISECTIONS = 40
TIP = 10e-3  # [m] of a fingertip, at whose centre the distance is read
CHECKED_EDGE = 1e-4  # [m] rounding of edges here: a tenth of what pages ask for
UNLIKE = 1.15, 0.85, 1.0  # [mean] of the first theta: no body of equal sizes
OFF, BENT = 0.3e-3, 0.05  # [m] of a distance or height; [rad] of a normal
BESIDE = 0.02  # [-] share of rays whose point may be on an edge, where normals jump
_REACH = {  # what to correct: the shape's own, the default
    False: "let reach(theta) enclose the body",
    True: "give reach(theta): without it, half the diagonal of a box with sides theta",
}
MASS = 0.03  # [-] of inertia and centroid, by the largest moment and by the reach


def check_shape(shape, count: int = 3, seed: int = 0) -> ShapeReport:
    """Return what disagrees among the functions of a shape at random theta."""
    by_kind = {}
    unusable = tuple(
        Disagreement(what, got, want, (), fix)
        for what, got, want, fix in unfit_fields(shape)
    )
    unusable = unusable or _of_calls(shape)
    if not unusable:
        for theta in _thetas(shape, count, seed):
            for what, got, expected, fix in _at(shape, ca.DM(theta)):
                by_kind.setdefault(
                    what, Disagreement(what, got, expected, tuple(theta), fix)
                )
    name = shape.name if isinstance(shape.name, str) else "a shape without a name"
    return ShapeReport(name, (*unusable, *by_kind.values()), count)


def _of_calls(shape) -> tuple:
    """Return what cannot be computed at the mean of the prior."""
    theta, point = ca.DM(_thetas(shape, 1, 0)[0]), ca.DM([0.02, 0.01, 0.03])
    signs = ca.DM(shape.corners[0])
    calls = {
        "distance": ((theta, point, CHECKED_EDGE), (1, 1)),
        "normal": ((theta, point, CHECKED_EDGE), (3, 1)),
        "corner": ((theta, signs), (3, 1)),
        "rest_height": ((theta,), (1, 1)),
        "reach": ((theta,), (1, 1)),
        "inertia": ((theta,), (3, 3)),
        "support": ((theta, ca.DM([0, 0, 1])), (3, 1)),
        "mesh": ((theta,), (None, 3)),
    }
    disagreements = []
    for name, (arguments, size) in calls.items():
        if (function := getattr(shape, name)) is None:
            continue
        try:
            value = ca.densify(ca.DM(function(*arguments)))
            got = f"an array {value.shape}"
            fits = size[0] in (None, value.shape[0]) and value.shape[1] == size[1]
            fits = fits and value.is_regular()
        except Exception as error:  # a user's function: any error is what to report
            fits, got = False, f"{type(error).__name__}: {str(error).splitlines()[0]}"
        if not fits:
            fix = f"see `{name}` in the documentation of Shape"
            want = f"finite numbers, {size}".replace("None", "points")
            at = tuple(float(t) for t in ca.vertsplit(theta))
            disagreements.append(Disagreement(f"{name}(...)", got, want, at, fix))
    return tuple(disagreements)


def _thetas(shape, count, seed):
    """Return theta: near the mean of the prior, then random within the bounds."""
    draw = random.Random(seed)
    pairs = (*shape.size_prior, *shape.bounds)
    columns = ([*map(float, ca.vertsplit(entries(shape, p)))] for p in pairs)
    rows = [*zip(*columns, strict=True)]  # mean, deviation, least, largest
    first = [m * UNLIKE[i % len(UNLIKE)] for i, (m, *_) in enumerate(rows)]
    more = [
        [min(max(draw.gauss(m, 0.5 * s), lo, 0.3 * m), hi) for m, s, lo, hi in rows]
        for _ in range(count - 1)
    ]
    return [first, *more]


def _at(shape, theta):
    """Yield what disagrees at one theta: what, got, expected, remedy."""
    q = shape.symbol("q", 3)
    signed = ca.Function("distance", [q], [shape.distance(theta, q, CHECKED_EDGE)])
    outward = ca.Function("normal", [q], [shape.normal(theta, q, CHECKED_EDGE)])
    rays, reach = directions(PROBES), float(shape.reach(theta))
    yield from _of_reach(shape, signed, rays, reach)
    r = _radii(signed, rays, reach)
    points = rays * ca.repmat(r, 3, 1)
    yield from _of_distance(signed, outward, points)
    yield from _of_moments(shape, theta, rays, r)
    yield from _of_ground(shape, theta, signed, points)
    yield from _of_symmetries(shape, theta, signed, points)
    if shape.mesh is not None:
        yield from _of_mesh(shape.mesh(theta), signed, points)


def _of_reach(shape, signed, rays, reach):
    outside = signed(rays * reach * (1 + 1e-3))
    if (worst := float(ca.mmin(outside))) < -OFF:
        yield (
            "distance beyond reach(theta)", _mm(worst), "at least 0 mm",
            _REACH[shape.reach is half_diagonal],
        )  # fmt: skip
    inside = signed(rays * 1e-3 * reach)
    if not float(ca.mmax(inside)) < 0:
        yield (
            "distance beside the origin", _mm(float(ca.mmax(inside))), "below 0",
            "put the origin at the centroid, and make the distance negative inside",
        )  # fmt: skip


def _radii(signed, rays, reach):
    low, high = ca.DM.zeros(1, PROBES), reach * (1 + 1e-3) * ca.DM.ones(1, PROBES)
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        within = signed(rays * ca.repmat(middle, 3, 1)) < 0
        low = ca.if_else(within, middle, low)
        high = ca.if_else(within, high, middle)
    return (low + high) / 2


def _of_distance(signed, outward, points):
    """Yield whether normals are the slopes of a distance that is one."""
    n = outward(points)
    length = ca.sqrt(ca.sum1(n * n))
    if abs(float(ca.mmax(ca.fabs(length - 1)))) > BENT:
        yield (
            "length of the normal", f"{float(ca.mmax(length)):.3g}", "1",
            "divide normal by its length, or use gradient_normal(distance)",
        )  # fmt: skip
    away = points + TIP * n
    usual, worst = _off(ca.fabs(signed(away) - TIP))
    if not usual < OFF:
        yield (
            "distance of points 10 mm out along the normal",
            f"off by up to {_mm(worst)}", f"10 mm to {_mm(OFF)}",
            "give the distance to the nearest point of the surface, in metres, "
            "not a function that is only zero there; or correct the normal",
        )  # fmt: skip
    out = points + TIP * points / ca.repmat(ca.sqrt(ca.sum1(points * points)), 3, 1)
    d = signed(out)
    foot = out - ca.repmat(d, 3, 1) * outward(out)
    usual, worst = _off(ca.fabs(signed(foot)))
    if not usual < OFF:
        yield (
            "nearest point of the surface, beyond edges as well",
            f"off it by up to {_mm(worst)}", f"on it to {_mm(OFF)}",
            "give the distance to the nearest point: beyond an edge or a corner it is "
            "larger than that to any plane of a face",
        )  # fmt: skip
    q = (ca.SX if outward.is_a("SXFunction") else ca.MX).sym("q", 3)
    slope = ca.Function("slope", [q], [ca.gradient(signed(q), q)])
    m, there = slope(away), outward(away)
    usual, worst = _off(ca.sqrt(ca.sum1((m - there) ** 2)))
    if not usual < BENT:
        yield (
            "normal against the slope of the distance", f"{worst:.2g} rad apart",
            f"{BENT} rad", "use normal=gradient_normal(distance)",
        )  # fmt: skip


def _of_moments(shape, theta, rays, r):
    """Yield whether origin and inertia are those of the uniform body."""
    volume = float(ca.sum2(r**3)) / 3
    centre = rays @ (r**4).T / 4 / volume
    if float(ca.norm_2(centre)) > MASS * float(ca.mmax(r)):
        place = ", ".join(f"{1e3 * float(c):.1f}" for c in ca.vertsplit(centre))
        yield (
            "centroid of the body", f"({place}) mm", "the origin of the body frame",
            "shift q_of in distance, normal, corner and mesh by it",
        )  # fmt: skip
    if shape.inertia is None:
        return
    Sigma = (rays * ca.repmat(r**5, 3, 1)) @ rays.T / 5 / volume
    uniform = ca.trace(Sigma) * ca.DM.eye(3) - Sigma
    inertia = ca.densify(shape.inertia(theta))
    if inertia.shape != (3, 3):
        yield (
            "size of the inertia", str(inertia.shape), "(3, 3)",
            "return a full matrix from inertia(theta)",
        )  # fmt: skip
    elif float(ca.mmax(ca.fabs(inertia - uniform))) > MASS * float(ca.mmax(uniform)):
        yield (
            "inertia", _diagonal(inertia), f"{_diagonal(uniform)} of the uniform body",
            "correct inertia(theta): (3, 3) [m^2] per unit mass, about the origin",
        )  # fmt: skip


def _of_ground(shape, theta, signed, points):
    """Yield whether it rests where its lowest points are."""
    lowest = -float(ca.mmin(points[2, :]))
    if shape.mesh is not None:  # rays miss edges
        lowest = max(lowest, -float(ca.mmin(ca.DM(shape.mesh(theta))[:, 2])))
    height = float(shape.rest_height(theta))
    if abs(height - lowest) > max(OFF, 0.02 * lowest):
        yield (
            "rest_height", _mm(height), f"{_mm(lowest)}, the depth of the body",
            "correct rest_height(theta), or the distance",
        )  # fmt: skip
    for signs in shape.corners:
        p = ca.DM(shape.corner(theta, ca.DM(signs)))
        off = float(signed(p)), float(p[2]) + height
        if off[0] > OFF or abs(off[1]) > OFF:
            yield (
                "corner", f"{_mm(off[0])} outside, {_mm(off[1])} above the ground",
                "a point of the body, on the ground",
                "correct corner(theta, signs), corners or rest_height",
            )  # fmt: skip
            break


def _of_symmetries(shape, theta, signed, points):
    """Yield whether renamed axes leave the surface where it is."""
    for order, S in shape.symmetries:
        renamed = ca.vertcat(*(theta[i] for i in order))
        q = shape.symbol("q", 3)
        again = ca.Function("distance", [q], [shape.distance(renamed, q, CHECKED_EDGE)])
        off = again(ca.DM(S).T @ points) - signed(points)
        if (worst := float(ca.mmax(ca.fabs(off)))) > OFF:
            yield (
                f"the symmetry {order}, {S}", f"a surface that is {_mm(worst)} off",
                f"the same, to {_mm(OFF)}",
                "leave it out, or correct the order of theta or the rotation, whose "
                "columns are the new axes in the old",
            )  # fmt: skip
            break


def _of_mesh(mesh, signed, points):
    """Yield whether the mesh is the surface on which the distance is zero."""
    corners = ca.DM(mesh).T
    off = float(ca.mmax(ca.fabs(signed(corners))))
    if off > OFF:
        yield (
            "distance of the mesh's points", _mm(off), f"0 to {_mm(OFF)}",
            "correct mesh(theta) or the distance",
        )  # fmt: skip
    missing = ca.DM([
        float(ca.mmax(d.T @ points) - ca.mmax(d.T @ corners))
        for d in ca.horzsplit(directions(100))
    ])  # fmt: skip
    if (most := float(ca.mmax(missing))) > max(OFF, 0.03 * float(ca.mmax(points))):
        yield (
            "extent of the mesh", f"{_mm(most)} less than the distance's surface",
            "the same", "let mesh(theta) return points whose hull is the whole body",
        )  # fmt: skip


@cache
def directions(count: int):
    """Return evenly spread unit vectors (3, count): a spherical Fibonacci lattice."""
    columns = []
    for i in range(count):
        z = 1 - (2 * i + 1) / count
        turn, across = pi * (1 + sqrt(5)) * i, sqrt(1 - z * z)
        columns.append([across * cos(turn), across * sin(turn), z])
    return ca.DM(columns).T


def _off(row) -> tuple[float, float]:
    """Return the most of all rays but the share BESIDE, and of all; row (1, PROBES)."""
    off = sorted(float(v) for v in ca.horzsplit(row))
    return off[int((1 - BESIDE) * PROBES)], off[-1]


def _mm(length: float) -> str:
    return f"{1e3 * length:.2f} mm"


def _diagonal(matrix) -> str:
    values = ", ".join(f"{1e6 * float(matrix[i, i]):.1f}" for i in range(3))
    return f"diagonal ({values}) mm^2"
