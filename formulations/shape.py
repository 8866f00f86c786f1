r"""Convex geometry from theta: signed distance, outward normal, corners, inertia.

A shape is a frozen set of pure functions of theta [m] and a point q_of [m] of the body
frame.  `small` is a length [m] that sets how sharply edges are rounded; pages pass a
tenth of the finger radius, so that nothing depends on the unit.

Cuboid, theta = side lengths (3,) [m], half extents h = theta / 2, origin its centre:

    d      = |q| - h                                            (per axis)
    phi(q) = || max(d, 0) ||  +  min(max_i d_i, 0)              (exact, both sides)

with max(x, 0) -> S(x) = (x + sqrt(x^2 + (small/5)^2)) / 2 and max_i -> log-sum-exp at
`small`, so that value and normal are smooth and right outside *and* inside.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from itertools import permutations, product

import casadi as ca


def half_diagonal(theta):
    """Return half the diagonal of a box with sides theta (n,), a number [m]."""
    return float(ca.norm_2(ca.DM(theta))) / 2


def every_size(theta):
    """Return theta: the sizes whose information is computed, by default."""
    return theta


def as_it_is(shape, theta):
    """Return the shape unchanged: the one that the page `pushing` takes by default."""
    return shape


def in_tuples(value, depth=4):
    """Return a value, lists and arrays in it as tuples, as deep as fields go."""
    value = value.tolist() if type(value).__name__ == "ndarray" else value
    if not (depth and isinstance(value, (list, tuple))):
        return value
    return tuple(in_tuples(one, depth - 1) for one in value)


@dataclass(frozen=True)
class Shape:
    """The functions of a class of bodies, its bounds and priors.

    theta: number of unknowns, any; q_of (3,) [m]: a point of the body frame, whose
    origin is the centroid; small [m]: how sharply edges are rounded.  Functions are of
    CasADi expressions, and of numbers alike.

    distance(theta, q_of, small) -> [m], signed, to the nearest point of the surface,
    exact to a few fingertips outside, beyond edges as well;
    normal(theta, q_of, small) -> (3,) outward unit; gradient_normal(distance) makes it;
    corner(theta, signs) -> (3,) [m] point that may rest on the ground, for each of
    `corners`, of which those given lie on the ground at rest;
    rest_height(theta) -> [m] of the origin over the ground, lying flat;
    inertia(theta) -> (3, 3) [m^2] per unit mass, about the origin;
    reach(theta) -> number [m] from the origin that no point of the body exceeds, of
    numbers only; without it, half the diagonal of a box with the sides theta;
    mesh(theta) -> (V, 3) [m] points whose convex hull is the body, as a list of points
    or a matrix; without it, they are sampled where the distance is zero.
    support(theta, n) -> (3,) [m], the point farthest along the unit vector n: of a body
    that rolls, in place of corner; it then has one of `corners`, and moves in 3-D.

    words: the name of each entry of theta; units: likewise, "m" where not given.
    bounds, size_prior: pairs of numbers, or of tuples with one for each entry.
    size_prior: mean and deviation of each entry before any touch (size_prior.py).  The
    paper's cuboids are 30 to 60 mm; two deviations span 5 to 85 mm.
    symmetries: relabellings of the axes that leave the body what it is, each the order
    of theta and the rotation (3, 3) whose columns are the new axes in the old.
    round: whether any turn about its z axis leaves the body what it is.
    mirrored: whether the opposites of its corners may come to rest on the ground, too.
    quantities: (name, function of theta) to ask for in the information, the sizes
    first; without it, `information.sigma("sizes")` is that of theta.
    What differs between classes of shapes:
    opposite_faces: whether theta (3,) are distances of opposite faces, as of a cuboid,
    on any of which it may lie.  It starts from the face that the first touch met.
    of_vertices: whether theta lists the vertices of a hull, at the last sample, along
    the world's axes: the last pose is no unknown.  No sizes are tracked: a search
    starts from supporting planes of the touches, and carries one hypothesis to the next
    action.  A contact reads the vertices that are near it where theta starts: each
    start needs a window of its own.
    counts: numbers of vertices, of which the evidence chooses one; empty: as many as
    theta lists.
    own_pages: the formulations that have a page of this class alone, which is
    formulations.<name>_<formulation>; empty where the general pages apply.
    symbol: makes the symbols of expressions: MX where the distance is a function call.
    foot_squared(theta, R_wo) -> [m^2], the mean squared radius of the contact with the
    ground, for the page `pushing`; None: from the inertia.
    pushed(shape, theta): the class of so many unknowns as the page `pushing` takes it.
    rounded(theta, r): of the sharp body that has the same faces and edges of radius r
    [m] once it is grown by r; None: the class has no edges, or free ones.
    """

    name: str
    theta: int
    bounds: tuple
    size_prior: tuple
    corners: tuple[tuple[float, float, float], ...]
    distance: Callable
    normal: Callable
    corner: Callable
    rest_height: Callable
    inertia: Callable
    symmetries: tuple = ()
    words: tuple[str, ...] = ()
    quantities: tuple = (("sizes", every_size),)
    reach: Callable = half_diagonal
    mirrored: bool = True
    opposite_faces: bool = False
    of_vertices: bool = False
    counts: tuple[int, ...] = ()
    own_pages: tuple[str, ...] = ()
    symbol: Callable = ca.SX.sym
    foot_squared: Callable | None = None
    pushed: Callable = as_it_is
    rounded: Callable | None = None
    units: tuple[str, ...] = ()
    mesh: Callable | None = None
    support: Callable | None = None
    round: bool = False

    def __post_init__(self):
        # Functions are kept by shape, of which lists and arrays have no hash.
        for name, value in vars(self).items():
            object.__setattr__(self, name, in_tuples(value))
        if self.mesh is cuboid_mesh and self.distance is not cuboid_distance:
            object.__setattr__(self, "mesh", None)  # a copy of CUBOID, no cuboid

    @property
    def faced(self) -> bool:
        """Whether theta are distances of opposite faces: of a cuboid, or as told."""
        return self.opposite_faces or self.distance is cuboid_distance

    @property
    def names(self) -> tuple[str, ...]:
        """The name of each entry of theta, with its unit where that is not m."""
        words = self.words or tuple(f"theta {i}" for i in range(self.theta))
        units = self.units or ("m",) * len(words)
        pairs = zip(words, units, strict=True)
        return tuple(w if u == "m" else f"{w} [{u}]" for w, u in pairs)

    @property
    def rolls(self) -> bool:
        """Whether it has no face to lie on, so that its poses have six unknowns."""
        return self.support is not None

    @property
    def relabellings(self) -> tuple:
        """Its symmetries with the identity, which it may leave out."""
        same = (tuple(range(self.theta)), ((1, 0, 0), (0, 1, 0), (0, 0, 1)))
        return self.symmetries if same in self.symmetries else (same, *self.symmetries)

    @property
    def typical_size(self) -> float:
        """The mean of its lengths before any touch [m]."""
        return self._mean_of_lengths(self.size_prior[0])

    @property
    def typical_deviation(self) -> float:
        """The mean of the deviations of its lengths before any touch [m]."""
        return self._mean_of_lengths(self.size_prior[1])

    def _mean_of_lengths(self, values) -> float:
        """Return the mean of those values, one or one an entry, that are in metres."""
        if not isinstance(values, (tuple, list)):
            return values
        units = self.units or ("m",) * self.theta
        lengths = [v for v, unit in zip(values, units, strict=True) if unit == "m"]
        return sum(lengths) / len(lengths)

    def check(self, count: int = 3, seed: int = 0):
        """Return a ShapeReport: what disagrees among the functions, and the remedy.

        They are compared at `count` theta, the first near the mean of the prior, the
        others random.
        """
        from .shape_check import check_shape

        return check_shape(self, count, seed)


def gradient_normal(distance) -> Callable:
    """Return the function normal(theta, q_of, small) of a signed distance."""
    return partial(_normal_of, distance)


def _normal_of(distance, theta, q_of, small):
    """Return the unit gradient (3,) of a distance at q_of (3,) [m]."""
    count = theta.numel() if hasattr(theta, "numel") else len(theta)
    made = _gradient(distance, count)
    gradient = made(theta, q_of, small)
    return gradient / ca.norm_2(gradient)


@cache
def _gradient(distance, count: int):
    theta, q, small = (ca.SX.sym(*s) for s in (("theta", count), ("q", 3), ("small",)))
    slope = ca.gradient(distance(theta, q, small), q)
    return ca.Function("gradient", [theta, q, small], [slope], {"cse": True})


def positive_part(x, width):
    """Return max(x, 0), rounded over `width`."""
    return (x + ca.sqrt(x * x + width * width)) / 2


def cuboid_distance(theta, q_of, small):
    """Return the signed distance [m] of the point q_of from the cuboid."""
    depth = _absolute(q_of, small) - theta / 2
    outside = ca.norm_2(positive_part(depth, small / 5))
    scaled = depth / small
    largest = ca.mmax(scaled)
    inside = small * (largest + ca.log(ca.sum1(ca.exp(scaled - largest))))
    return outside - positive_part(-inside, small / 5)


def cuboid_normal(theta, q_of, small):
    """Return the outward unit normal: the direction in which the distance grows.

    The gradient of |S(d)|.  Far inside, S(d) ~ 1 / |d| leaves the nearest face's.
    """
    modulus, width = _absolute(q_of, small), small / 5
    depth = modulus - theta / 2
    part = positive_part(depth, width)
    gradient = part * part / ca.sqrt(depth * depth + width**2) * q_of / modulus
    return gradient / ca.norm_2(gradient)


def _absolute(q, small):
    return ca.sqrt(q * q + (small / 10) ** 2)


def cuboid_corner(theta, signs):
    """Return the corner, or end of an axis, with the given signs, body frame [m]."""
    return signs * theta / 2


def cuboid_mesh(theta):
    """Return the corners, those on which it rests first: 8 points [m]."""
    x, y, z = (float(side) / 2 for side in ca.vertsplit(ca.DM(theta)))
    return [(i * x, j * y, k * z) for k, j, i in product((-1, 1), repeat=3)]


def cuboid_rest_height(theta):
    """Return the height of the centre over the ground, lying on the -z face [m]."""
    return theta[2] / 2


def cuboid_inertia(theta):
    """Return the inertia per unit mass of a uniform cuboid [m^2]."""
    square = theta * theta
    return ca.diag(ca.sum1(square) - square) / 12


def faces_inward(theta, r):
    """Return the widths of the body that, grown by r, has its edges rounded by r."""
    return theta - 2 * r


def axis_relabellings() -> tuple:
    """Return the 24 right-handed ways to name a cuboid's axes: (order, rotation)."""
    relabellings = []
    for order in permutations(range(3)):
        for signs in product((1, -1), repeat=3):
            S = [
                [s * (i == j) for j, s in zip(order, signs, strict=True)]
                for i in range(3)
            ]
            if ca.det(ca.DM(S)) > 0:
                relabellings.append((order, tuple(map(tuple, S))))
    return tuple(relabellings)


CUBOID = Shape(
    name="cuboid",
    theta=3,
    bounds=(4e-3, 0.4),
    size_prior=(0.045, 0.020),
    corners=((-1, -1, -1), (1, -1, -1), (-1, 1, -1), (1, 1, -1)),
    distance=cuboid_distance,
    normal=cuboid_normal,
    corner=cuboid_corner,
    rest_height=cuboid_rest_height,
    inertia=cuboid_inertia,
    symmetries=axis_relabellings(),
    words=("side x", "side y", "side z"),
    quantities=(("side_lengths", every_size),),
    rounded=faces_inward,
    mesh=cuboid_mesh,
)
