"""`Body`: shape, inertia and friction identified from motion, with deviations.

It also tells how well it explains the motion: what its likelihood terms cost, and what
they should.  A step costs 4 (sqrt(1 + off / 4) - 1), with off chi-square of six degrees
of freedom under the noise model; the corner in contact, one a step, costs half a chi-
square of one degree, above or below the ground. Unknown impulses explain a part, so
that the expected costs are upper bounds. The verdict and the widening are those of
information/goodness_of_fit.py, for the worst of the terms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from formulations.names import BALANCE, NOT_BELOW, ON_SURFACE

from ..common.brief import printed
from ..information.goodness_of_fit import Misfit, verdict_of
from ..solvers.solution import violation_in_words

UNOBSERVED_VERTEX = 0.5  # [prior deviations] of sigma, of an unobserved vertex
STEP_MEAN, STEP_SPREAD = 2.24, 1.05  # [nats] of the pseudo-Huber cost of chi-square(6)
TOUCH_MEAN, TOUCH_SPREAD = 0.5, 0.71  # [nats] of half a chi-square(1)
VERDICTS = ("good", "poor", "bad")  # on a term, the worst one last


@dataclass(frozen=True)
class BodyFit:
    """How well a body explains its motion.

    verdict: "good", "poor" or "bad"; terms: the Misfit of the momentum balance and of
    the heights of the corners; widening: factor of all standard deviations.
    """

    verdict: str
    terms: dict[str, Misfit]
    widening: float

    @property
    def text(self) -> str:
        """The verdict in a sentence, with the term that fits worst."""
        name, worst = max(
            self.terms.items(), key=lambda term: term[1].excess / term[1].limit
        )
        words = (
            f"The fit is {self.verdict}: {name} costs {worst.actual:.0f} nats where at "
            f"most {worst.expected:.0f} ± {worst.spread:.0f} are expected"
        )
        if self.verdict == "good":
            return f"{words}."
        words += f"; standard deviations are multiplied by {self.widening:.1f}"
        bad = ", and the result is not to be trusted" if self.verdict == "bad" else ""
        return f"{words}{bad}."


@printed
@dataclass(frozen=True, eq=False)
class Body:
    """Shape, friction and inertia of a body, and the ground it fell on.

    mass:        [kg] as the scene says
    vertices:    (V, 3) [m] of the hull with sharp edges, body frame
    radius:      [m] that rounds its edges
    friction:    [1] with the ground
    inertia:     (3,) [kg m^2] about the body's axes
    ground:      (3,) height [m] over the scene's ground in the middle of the tosses,
                 and slopes [1] along the x and y of the ground's frame
    gauge:       [1] metres per metre of the tracker, from free falls; 1 if given as 1
    sigma:       standard deviations of all these, by name, and of half_widths
    impulses:    (T, V, 3) [N s] of the ground on each vertex, world frame
    costs, violations, names as in the page `known_trajectory`; unobserved: vertices
    that nothing but the first guess holds; skipped: what was left out, in words; fit:
    how well the motion is explained, with a verdict.
    """

    shape: str
    mass: float
    vertices: np.ndarray
    radius: float
    friction: float
    inertia: np.ndarray
    ground: np.ndarray
    gauge: float
    sigma: dict[str, np.ndarray]
    impulses: np.ndarray
    costs: dict[str, float]
    violations: dict[str, float]
    objective: float
    unobserved: tuple[int, ...]
    skipped: tuple[str, ...]
    tosses: int
    fit: BodyFit
    success: bool
    status: str
    iterations: int
    seconds: dict[str, float]

    @property
    def half_widths(self) -> np.ndarray:
        """Half widths (3,) [m] of the box around the vertices."""
        return np.ptp(self.vertices, axis=0) / 2

    def mesh(self):
        """Return the body as a trimesh.Trimesh with sharp edges, body frame [m]."""
        import trimesh

        return trimesh.convex.convex_hull(self.vertices)

    def summary(self) -> str:
        """Return a paragraph in words."""
        mm, sigma = 1e3, self.sigma
        if self.shape == "cuboid":
            pairs = zip(self.half_widths * mm, sigma["half_widths"] * mm, strict=True)
            sides = " x ".join(f"{h:.2f} ± {s:.2f}" for h, s in pairs)
            what = f"A cuboid of half widths {sides} mm"
        else:
            median = np.median(sigma["vertices"].max(axis=1)) * mm
            what = f"A body of {len(self.vertices)} corners, ± {median:.2f} mm (median)"
        height, *slopes = self.ground
        lines = [
            f"{what}, edges rounded by {self.radius * mm:.1f} ± "
            f"{sigma['radius'] * mm:.1f} mm, from {self.tosses} tosses.",
            f"Friction {self.friction:.3f} ± {sigma['friction']:.3f}; the ground is "
            f"{height * mm:.2f} ± {sigma['ground'][0] * mm:.2f} mm high and slopes by "
            f"{np.degrees(np.hypot(*slopes)):.2f} deg; lengths of the tracker are "
            f"multiplied by {self.gauge:.4f} ± {sigma['gauge']:.4f}.",
            f"known_trajectory: {self.status}, objective {self.objective:.1f} nats "
            f"after {self.iterations} iterations, {self.seconds['total']:.1f} CPU s; "
            f"{violation_in_words(self.violations)}.",
            self.fit.text,
        ]
        if self.unobserved:
            numbers = ", ".join(map(str, self.unobserved))
            lines.append(f"Not observed: vertices {numbers}, which never touched.")
        return "\n".join([*lines, *(f"Skipped {words}." for words in self.skipped)])


def body_fit_of(costs: dict[str, float], steps: int) -> BodyFit:
    """Return the fit of a solution with these costs, by name, of so many steps."""
    balance = sum(cost for name, cost in costs.items() if name.startswith(BALANCE))
    heights = costs[ON_SURFACE] + costs[NOT_BELOW]
    terms = {
        "the momentum balance": _misfit(balance, steps, STEP_MEAN, STEP_SPREAD),
        "the height of the corners": _misfit(heights, steps, TOUCH_MEAN, TOUCH_SPREAD),
    }
    each = (verdict_of(term) for term in terms.values())
    verdicts, widenings = zip(*each, strict=True)
    return BodyFit(max(verdicts, key=VERDICTS.index), terms, max(widenings))


def _misfit(actual: float, count: int, mean: float, spread: float) -> Misfit:
    """Return the Misfit of a cost; mean, spread: of one of `count` terms."""
    return Misfit(float(actual), mean * count, spread * count**0.5)


def corner_shift(corners: np.ndarray) -> np.ndarray:
    """Return by how much a radius of 1 moves each corner (V, 3) of the sharp hull.

    Every facet moves out by the radius; a corner goes where its facets meet, in the
    sense of least squares.  Corners inside the hull stay.
    """
    from scipy.spatial import ConvexHull

    hull = ConvexHull(corners)
    push = np.zeros_like(corners)
    for v in np.unique(hull.simplices):
        facets = (hull.simplices == v).any(axis=1)
        normals = np.unique(hull.equations[facets, :3].round(6), axis=0)
        push[v] = np.linalg.lstsq(normals, np.ones(len(normals)), rcond=0.1)[0]
    return push
