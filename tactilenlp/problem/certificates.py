"""Certify after a solve that every reduction was right, and name what to restore.

Exact reductions (far, absent, frictionless) must leave the optimum where it is; model
reductions (still, planar) must not be contradicted by the data.  The unreduced problem,
written out once at the solution, gives the certificates of far, absent and still:

far     the free samples that were left out add nothing to the objective
absent  the gradient by an impulse that was left out shows no descent
still   without a ground: the Newton decrement and step of separate poses are small.
        On a ground: static friction carries the body.  The slope of the objective in
        the poses of a still span before a sample is the force [nats / m] that would
        move the body there.  Where it is larger than what friction dissipates by that
        motion, the body slips, by as much as the curvature of the objective allows:
        all slips together would lower the objective by little.
        (A page rounds friction, so that separate poses would creep.)
planar  planar poses explain the touches: see outliers.py
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from formulations.violation_implicit import WEIGHTS

from ..geometry.transforms import is_planar, turning
from ..nlp.kkt_sensitivity import newton_step
from .outliers import PLANAR_LIMIT, evidence_against_planar, planar_share
from .reductions import ARM, UNKNOWN_FRICTION, Reductions
from .unreduced import unreduced

NEUTRAL = 1e-6  # [relative] an exact reduction moves the objective by less
DECREMENT = 0.1  # [nats] a model reduction's Newton decrement stays below
SHIFT = 0.1  # [sigma] and no size and no last pose moves further
CUT = 0.1  # [-] of the longest step within a still span is worth a pose of its own
MM_PER_M = 1e3  # a page weighs friction in nats per mm
NEARLY_SLIPS = 0.5  # [-] of friction: such a span may slip when another one is cut
LONGEST_SLIP = 1e-3  # [m] more than bodies at rest were ever found to slip
LEAST_CURVATURE = 1e3  # [nats / m^2] softer than any touch: 1 / (30 mm)^2
LEAST_ARM = 1e-3  # [m] of a body that rests on one point
ON_ICE = 1.0  # [nats / m] least force: without friction a body at rest feels rounding


@dataclass(frozen=True)
class Skipped:
    """One reduction: what was dropped, why, and the check after the solve.

    value is compared with limit (both in `unit`); `holds` is the verdict.
    """

    name: str
    dropped: str
    reason: str
    check: str
    value: float
    limit: float
    holds: bool

    def __str__(self) -> str:
        verdict = "holds" if self.holds else "DOES NOT HOLD"
        return (
            f"{self.name}: {self.dropped} ({self.reason}); {self.check} "
            f"{self.value:.2g}, limit {self.limit:.2g}: {verdict}"
        )


@dataclass(frozen=True)
class Certificates:
    """Every reduction that was made, with its check.

    cuts: samples that need a pose of their own, where a still span does not hold.
    """

    skipped: tuple[Skipped, ...]
    cuts: tuple[int, ...] = ()

    @property
    def broken(self) -> tuple[str, ...]:
        """The names of the reductions that do not hold."""
        return tuple(s.name for s in self.skipped if not s.holds)


def certify(job, page, solved) -> Certificates:
    """Return the reductions of a solved page, each with its certificate."""
    made, found, cuts = job.reductions, [], ()
    if made.still or made.far or made.absent:
        whole = unreduced(job, page, solved)
        found += [far(solved, whole)] * made.far + [absent(solved, whole)] * made.absent
        shared = made.still and len(solved.window.pose) > solved.window.poses
        if shared and job.scene.ground is not None:
            rest = rest_force(job.scene, solved, whole)
            found.append(resting(solved, rest))
            cuts = rest.cuts
        elif shared:
            step = _step(solved, whole)
            found.append(still(solved, step))
            cuts = () if found[-1].holds else _cuts(solved.window, whole, step)
    if made.planar:
        found.append(planar_certificate(job, page, solved))
    found.append(frictionless(solved))
    return Certificates(tuple(s for s in found if s is not None), cuts)


def without(reductions: Reductions, names) -> Reductions:
    """Return the reductions less the named ones."""
    return replace(reductions, **dict.fromkeys(names, False))


def far(solved, whole) -> Skipped | None:
    """Certify that the dropped free samples cost nothing at the solution."""
    if not len(whole.far):
        return None
    cost = float(whole.problem.value("free", whole.x, whole.data)[whole.far].sum())
    limit = NEUTRAL * max(1.0, abs(solved.solution.objective))
    return Skipped(
        "far", f"{len(whole.far)} free samples", "certainly away from the object",
        "they would add to the objective [nats]", cost, limit, abs(cost) <= limit,
    )  # fmt: skip


def absent(solved, whole) -> Skipped | None:
    """Certify that no impulse of a finger that feels nothing lowers the objective."""
    if "finger" not in whole.problem.variables or not len(whole.unfelt):
        return None
    variable = whole.problem.variables["finger"]
    normal = whole.slope[variable.span].reshape(variable.columns, -1)[whole.unfelt, 0]
    gain = float(max(0.0, (-normal * variable.scale[0]).max()))
    return Skipped(
        "absent", f"{len(whole.unfelt)} impulses", "the finger feels nothing",
        "pushing by one weight would gain at most [nats]", gain, DECREMENT,
        gain <= DECREMENT,
    )  # fmt: skip


def still(solved, step) -> Skipped:
    """Certify that separate poses would lower the objective little."""
    window = solved.window
    dropped = len(window.pose) - window.poses
    shift = np.nanmax(np.abs(step.shift), initial=0.0)
    worst = max(step.decrement / DECREMENT, shift / SHIFT)
    holds = bool(0 <= worst <= 1)
    return Skipped(
        "still", f"{dropped} poses", "nothing touched or moved the object",
        f"Newton decrement of separate poses {step.decrement:.2g} nats, shift "
        f"{shift:.2g} sigma, in {DECREMENT} of either", worst, 1.0, holds,
    )  # fmt: skip


def _step(solved, whole):
    """Return the Newton step of the unreduced problem, unfelt impulses fixed."""
    problem = whole.problem
    theta, x = problem.variables["theta"], problem.variables["x"]
    chosen = np.r_[
        np.arange(theta.span.start, theta.span.stop),
        np.arange(x.span.stop - x.rows, x.span.stop),
    ]
    held = np.zeros(0, int)
    if "finger" in problem.variables:
        finger = problem.variables["finger"]
        first = finger.span.start + finger.rows * whole.unfelt
        held = (first[:, None] + np.arange(finger.rows)).ravel()
    given = whole.multipliers, whole.bound_multipliers, held, chosen
    return newton_step(problem, whole.x, whole.data, *given)


def _cuts(window, whole, step) -> tuple[int, ...]:
    """Return the samples at which still spans move most in the Newton step."""
    x = whole.problem.variables["x"]
    d = step.step[x.span].reshape(x.columns, x.rows)
    turns = x.rows // 2 if x.rows > 3 else 2
    way = np.hypot(
        np.linalg.norm(np.diff(d[:, :turns], axis=0), axis=1),
        ARM * np.linalg.norm(np.diff(d[:, turns:], axis=0), axis=1),
    )
    way = np.r_[0.0, np.where(np.diff(window.pose[whole.window.last]) == 0, way, 0.0)]
    cut = whole.window.last[way > CUT * way.max()]
    return tuple(cut.tolist())


def resting(solved, rest) -> Skipped:
    """Certify that static friction balances the forces on a body at rest."""
    window = solved.window
    return Skipped(
        "still", f"{len(window.pose) - window.poses} poses",
        f"nothing touched or moved the object; forces reach {rest.share:.2g} of static "
        "friction", "slipping would lower the objective by [nats]", rest.gain,
        DECREMENT, rest.gain <= DECREMENT,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class RestForce:
    """Forces on the still spans: the largest as a share of static friction [-].

    gain [nats]: by which slips would lower the objective; cuts: if that is too much,
    the samples of the largest force in each span where it exceeds NEARLY_SLIPS.
    """

    share: float
    gain: float
    cuts: tuple[int, ...]


def rest_force(scene, solved, whole) -> RestForce:
    """Return the forces on the still spans of a solved page against static friction.

    whole: the problem with a pose for every sample, at the solution (Expansion).
    """
    v = whole.problem.variables["x"]
    slope = whole.whole_slope[v.span].reshape(v.columns, v.rows)
    along = _along(whole.x[v.span].reshape(slope.shape).T)
    slope = np.einsum("tij,tj->ti", along, slope)[whole.window.pose]
    arm = np.array([1, 1, _lever_arm(solved, whole.window)])
    friction, slips, share = _static_friction(scene, solved.solution), [], 0.0
    for rows in _spans(solved.window.pose):
        force = np.cumsum(slope[rows[:-1]], axis=0) / arm
        size = np.linalg.norm(force, axis=1)
        i = int(np.argmax(size))
        share = max(share, size[i] / friction)
        if size[i] > NEARLY_SLIPS * friction:
            way = force[i] / size[i] / arm
            slips.append((size[i], rows[: i + 1], way))
    if not slips:
        return RestForce(share, 0.0, ())
    force, before, ways = zip(*slips, strict=True)
    curvature = _curvatures(whole, along, before, ways)
    gain = float(slip_gains(np.array(force) - friction, curvature).sum())
    cuts = tuple(int(rows[-1]) + 1 for rows in before)
    return RestForce(share, gain, cuts if gain > DECREMENT else ())


def _spans(pose) -> list[np.ndarray]:
    """Return the samples of each pose that several share."""
    ends = np.flatnonzero(np.diff(pose)) + 1
    spans = np.split(np.arange(len(pose)), ends)
    return [rows for rows in spans if len(rows) > 1]


def slip_gains(excess, curvature) -> np.ndarray:
    """Return by how much slips lower an objective [nats], friction included.

    excess [nats / m]: of the force over friction; curvature [nats / m^2].
    """
    excess = np.maximum(excess, 0.0)
    way = np.minimum(excess / np.maximum(curvature, LEAST_CURVATURE), LONGEST_SLIP)
    return way * (excess - np.maximum(curvature, LEAST_CURVATURE) * way / 2)


def _curvatures(whole, along, before, ways) -> np.ndarray:
    """Return the curvatures (n,) [nats / m^2] of the costs along slips.

    before: samples that move with each slip; ways (3,): along the ground, and a turn.
    """
    v, pose = whole.problem.variables["x"], whole.window.pose
    D = np.zeros((whole.problem.size, len(ways)))
    for d, rows, way in zip(D.T, before, ways, strict=True):
        at = np.unique(pose[rows])
        step = np.einsum("i,tij->tj", way, along[at])
        d[(v.span.start + v.rows * at)[:, None] + np.arange(v.rows)] = step
    given = whole.x, whole.data
    H = sum(whole.problem.hessian(name, *given) for name in whole.problem.costs)
    return np.einsum("ij,ij->j", D, H @ D)


def _along(x) -> np.ndarray:
    """Return (n, 3, u) two ways along the ground and a turn, as changes of x (u, n)."""
    out = np.zeros((x.shape[1], 3, len(x)))
    out[:, [0, 1], [0, 1]] = 1.0
    if is_planar(x):
        out[:, 2, 2] = 1.0
    else:
        out[:, 2, 3:] = np.linalg.inv(turning(x))[:, :, 2]
    return out


def _lever_arm(solved, window) -> float:
    """Return the arm [m] at which the ground's friction resists a turn."""
    legs = window.supports(solved.job.shape, solved.at.theta)
    return max(float(np.linalg.norm(legs[:, :2], axis=1).mean()), LEAST_ARM)


def _static_friction(scene, solution) -> float:
    """Return what friction dissipates when a body slides [nats / m].

    It is that of violation_implicit whatever page was solved, also one without
    dissipation; the page's own weight `kappa` and coefficient come first.
    """
    known = {"kappa": WEIGHTS["kappa"][0], "ground friction": scene.friction_ground}
    if known["ground friction"] is None:
        known["ground friction"] = UNKNOWN_FRICTION
    known |= solution.parameters | solution.values
    kappa, mu = (float(np.ravel(known[k])[0]) for k in ("kappa", "ground friction"))
    return max(MM_PER_M * kappa * mu * (scene.gravity > 0), ON_ICE)


def frictionless(solved) -> Skipped | None:
    """Certify dropped tangential impulses: without friction there are none."""
    window = solved.window
    of = {"finger": window.push, "ground": window.corner}
    count = sum(2 * len(of[name]) for name in window.frictionless)
    if not count:
        return None
    return Skipped(
        "frictionless", f"{count} tangential impulses", "friction is zero",
        "largest that the cone would allow [weights]", 0.0, 0.0, True,
    )  # fmt: skip


def planar_certificate(job, page, solved) -> Skipped | None:
    """Certify that an object that never tilts explains the touches (outliers.py)."""
    worst = planar_share(evidence_against_planar(job, solved))
    return Skipped(
        "planar", "height and two tilts of every pose", "the object lies flat",
        "share of an action's touches that no flat pose explains", worst, PLANAR_LIMIT,
        worst <= PLANAR_LIMIT,
    )  # fmt: skip
