"""Check after the solve that what was dropped was not needed; put back what was.

Exact reductions (far, absent) must leave the optimum where it is; model reductions
(still, planar) must not be contradicted by the data.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .nlp import Problem
from .reduce import Reductions, reduce
from .result import Skipped
from .tumble import contradicts

EXACT = 1e-6  # [relative] an exact reduction moves the objective by less
STIFF = 25.0  # [nats / mm^2] price of a millimetre of motion under static friction
DECREMENT = 0.1  # [nats] a model reduction's Newton decrement stays below
SHARE = 0.25  # [-] of all touches may stay unexplained, else the motion is another
MOST = 0.6  # [-] and so may this share of one action's
FEW = 4  # touches that may stay unexplained in any action


def broken(skipped) -> tuple[str, ...]:
    """Return the names of the reductions that do not hold."""
    return tuple(s.name for s in skipped if not s.holds)


def certify(job, page, solved) -> tuple[Skipped, ...]:
    """Return what was dropped for a solved page, each with the check of it."""
    checks = {"far": far, "absent": absent, "still": still, "planar": planar}
    made = [name for name in checks if getattr(job.reductions, name)]
    found = [checks[name](job, page, solved) for name in made]
    return tuple(s for s in found if s is not None)


def without(reductions: Reductions, names) -> Reductions:
    """Return the reductions less the named ones."""
    return replace(reductions, **dict.fromkeys(names, False))


def far(job, page, solved) -> Skipped | None:
    """The free samples that were dropped cost nothing at the solution."""
    again, problem = _with(job, page, solved, "far")
    dropped = len(again.free) - len(solved.window.free)
    if not dropped:
        return None
    x = problem.pack(solved.solution.values)
    data = problem.data(solved.solution.parameters)
    cost = float(problem.value("free", x, data).sum())
    cost -= solved.solution.costs.get("free", 0.0)
    limit = EXACT * max(1.0, abs(solved.solution.objective))
    return Skipped(
        "far", f"{dropped} free samples", "certainly away from the object",
        "they would add to the objective [nats]", cost, limit, abs(cost) <= limit,
    )  # fmt: skip


def absent(job, page, solved) -> Skipped | None:
    """No finger that feels nothing would gain by pushing."""
    values = solved.solution.values
    if "finger" not in values:
        return None
    again, problem = _with(job, page, solved, "absent")
    dropped = len(again.push) - len(solved.window.push)
    if not dropped:
        return None
    lam = np.zeros((values["finger"].shape[0], len(again.push)))
    felt = np.setdiff1d(np.arange(len(again.push)), again.apart)
    lam[:, felt] = values["finger"]
    x = problem.pack({**values, "finger": lam})
    data = problem.data(solved.solution.parameters)
    slope = sum(
        np.asarray(problem.jacobian(name, x, data).sum(axis=0)).ravel()
        for name in problem.costs
    )
    variable = problem.variables["finger"]
    normal = slope[variable.span].reshape(variable.columns, variable.rows)[
        again.apart, 0
    ]
    gain = float(max(0.0, (-normal * variable.scale[0]).max()))
    return Skipped(
        "absent", f"{dropped} impulses", "the finger feels nothing",
        "pushing by one weight would gain at most [nats]", gain, DECREMENT,
        gain <= DECREMENT,
    )  # fmt: skip


def still(job, page, solved) -> Skipped | None:
    """Samples that share a pose pull it apart by less than friction holds.

    A free sample's slope g against the stiffness h of the motion that was left out,
    there and back: g^2 / (2 h).  A bound by friction at STIFF, not the page's own h.
    """
    window = solved.window
    dropped = len(window.knot) - window.knots
    if not dropped:
        return None
    problem, values = solved.problem, solved.solution.values
    x, data = problem.pack(values), problem.data(solved.solution.parameters)
    decrement = 0.0
    if "free" in problem.costs:
        slopes = problem.jacobian("free", x, data).toarray() * problem.scale
        span = problem.variables["x"].span
        shared = np.bincount(window.free.knot, minlength=window.knots)
        merged = shared[window.free.knot] > 1
        slope = np.linalg.norm(slopes[:, span], axis=1)[merged]
        decrement = float((slope**2 / 2).max(initial=0.0)) / STIFF
    return Skipped(
        "still", f"{dropped} poses", "nothing touched or moved the object",
        "Newton decrement of separate poses at most [nats]", decrement, DECREMENT,
        decrement <= DECREMENT,
    )  # fmt: skip


def planar(job, page, solved) -> Skipped | None:
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


def _with(job, page, solved, name):
    """Return the window and the problem that have what one reduction left out."""
    h = solved.hypothesis
    window = reduce(
        job.data, job.scene, job.shape, job.precision, without(job.reductions, [name]),
        guess=(h.theta, h.x),
    )  # fmt: skip
    problem = Problem()
    page.build(problem, window, job.scene, job.shape)
    return window, problem
