"""Check after the solve that what was dropped was not needed; say what to put back.

Exact reductions (far, absent, frictionless) must leave the optimum where it is; model
reductions (still, planar) must not be contradicted by the data.  One unreduced problem,
written out at the solution, answers for far, absent and still.

Check that friction holds what shares a pose: the certificate of still spans.

Were a body at rest to move within a span that nothing touches, the objective would
fall by its pull, in nats per metre, and friction would dissipate more than that.  It is
rounded where a page is solved: poses of their own would creep, which no body does.  The
pull at a sample is the slope of the objective in the poses before it in its span: along
the ground, the weight holds the body down.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from formulations.violation_implicit import WEIGHTS

from ..geometry.transforms import is_planar, turning
from ..nlp.kkt import newton_step
from .outliers import contradicts
from .reductions import ARM, SLIPPERY, Reductions
from .unreduced import expand

EXACT = 1e-6  # [relative] an exact reduction moves the objective by less
DECREMENT = 0.1  # [nats] a model reduction's Newton decrement stays below
SHIFT = 0.1  # [sigma] and no size and no last pose moves further
CUT = 0.1  # [-] of the longest way within a still span is worth a pose of its own
SHARE = 0.25  # [-] of all touches may stay unexplained, else the motion is another
MOST = 0.6  # [-] and so may this share of one action's
FEW = 4  # touches that may stay unexplained in any action
BY_METRE = 1e3  # [mm / m]: the page weighs friction in nats per mm
HARDLY = 0.5  # [-] what is pulled so hard may give way when another span is cut
LEAST = 1.0  # [nats / m] on ice a body at rest is pulled by nothing, up to rounding


@dataclass(frozen=True)
class Certificates:
    """What was dropped, each with its check.

    cuts: samples that need a pose of their own, where still spans do not hold.
    """

    skipped: tuple[Skipped, ...]
    cuts: tuple[int, ...] = ()

    @property
    def broken(self) -> tuple[str, ...]:
        """The names of the reductions that do not hold."""
        return tuple(s.name for s in self.skipped if not s.holds)


def certify(job, page, solved) -> Certificates:
    """Return what was dropped for a solved page, each with the check of it."""
    made, found, cuts = job.reductions, [], ()
    if made.still or made.far or made.absent:
        whole = expand(job, page, solved)
        found += [far(solved, whole)] * made.far + [absent(solved, whole)] * made.absent
        shared = made.still and len(solved.window.pose) > solved.window.poses
        if shared and job.scene.ground is not None:
            hold = held(job.scene, solved, whole)
            found.append(resting(solved, hold))
            cuts = hold.cuts
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
    """The free samples that were dropped cost nothing at the solution."""
    if not len(whole.far):
        return None
    cost = float(whole.problem.value("free", whole.x, whole.data)[whole.far].sum())
    limit = EXACT * max(1.0, abs(solved.solution.objective))
    return Skipped(
        "far", f"{len(whole.far)} free samples", "certainly away from the object",
        "they would add to the objective [nats]", cost, limit, abs(cost) <= limit,
    )  # fmt: skip


def absent(solved, whole) -> Skipped | None:
    """No finger that feels nothing would gain by pushing."""
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
    """Poses of their own would gain little for samples that share one."""
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


def resting(solved, hold) -> Skipped:
    """Friction holds a body at rest against all that pulls it."""
    window = solved.window
    return Skipped(
        "still", f"{len(window.pose) - window.poses} poses",
        "nothing touched or moved the object",
        "hardest pull on a body at rest, in what friction holds", hold.share, 1.0,
        hold.share <= 1,
    )  # fmt: skip


def frictionless(solved) -> Skipped | None:
    """A cone of no friction holds no tangential impulse: nothing to check."""
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
    """The touches are explained by an object that never tilts.

    Wrong booleans and a wrong mode leave touches unexplained here and there; an object
    that tumbled leaves most of an action so.
    """
    evidence = contradicts(job, solved.window, solved.solution.values)
    touches = sum(e.touches for e in evidence)
    wrong = sum(e.unexplained for e in evidence)
    shares = [e.unexplained / e.touches for e in evidence if e.unexplained >= FEW]
    worst = max([*shares, wrong / touches * MOST / SHARE])
    return Skipped(
        "planar", "height and two tilts of every pose", "the object lies flat",
        "share of an action's touches that no flat pose explains", worst, MOST,
        worst <= MOST,
    )  # fmt: skip


def _step(solved, whole):
    """Return the Newton step of the unreduced problem, unfelt fingers held."""
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
    given = whole.multipliers, whole.pulls, held, chosen
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


@dataclass(frozen=True, eq=False)
class Hold:
    """How hard still spans are pulled: largest share of what friction holds [-].

    cuts: the samples of the hardest pull in each span that friction hardly holds, if it
    does not hold one of them.
    """

    share: float
    cuts: tuple[int, ...]


def held(scene, solved, whole) -> Hold:
    """Return how well friction holds the still spans of a solved page.

    whole: the problem with a pose for every sample, at the solution (Expansion).
    """
    v = whole.problem.variables["x"]
    slope = whole.whole_slope[v.span].reshape(v.columns, v.rows)
    slope = _along(whole.x[v.span].reshape(slope.shape).T, slope)[whole.window.pose]
    pose, arm = solved.window.pose, _arm(solved, whole.window)
    price, cuts, worst = _price(scene, solved.solution), [], 0.0
    for k in np.unique(pose):
        rows = np.nonzero(pose == k)[0]
        pull = np.cumsum(slope[rows[:-1]], axis=0)
        pull = np.hypot(np.linalg.norm(pull[:, :2], axis=1), pull[:, 2] / arm) / price
        worst = max(worst, pull.max(initial=0.0))
        if pull.max(initial=0.0) > HARDLY:
            cuts.append(int(rows[1 + np.argmax(pull)]))
    return Hold(float(worst), tuple(cuts) if worst > 1 else ())


def _along(x, slope) -> np.ndarray:
    """Return slopes (n, 3) along the ground: two ways and a turn, of all (n, u)."""
    if is_planar(x):
        return slope
    turn = np.linalg.solve(turning(x).transpose(0, 2, 1), slope[:, 3:, None])
    return np.c_[slope[:, :2], turn[:, 2]]


def _arm(solved, window) -> float:
    """Return the arm [m] at which the ground's friction resists a turn."""
    legs = window.supports(solved.job.shape, solved.at.theta)
    return float(np.linalg.norm(legs[:, :2], axis=1).mean())


def _price(scene, solution) -> float:
    """Return what friction takes of a body that slides [nats / m].

    The price is that of the physics (violation_implicit) whatever page was solved, also
    one that weighs no dissipation; only its own `kappa` and coefficient come first.
    """
    known = {"kappa": WEIGHTS["kappa"][0], "ground friction": scene.friction_ground}
    if known["ground friction"] is None:
        known["ground friction"] = SLIPPERY
    known |= solution.parameters | solution.values
    kappa, mu = (float(np.ravel(known[k])[0]) for k in ("kappa", "ground friction"))
    return max(BY_METRE * kappa * mu * (scene.gravity > 0), LEAST)


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
