"""Benchmark the printed equations: the page `paper`, and the default's departures.

python examples/benchmarks/paper_terms.py ../shared/scenes/cuboid_0[0-2]*.npz

Solved from the same hypotheses: the default page, `paper`, and the default with one
departure undone.  It is undone while the page is built: a function of `formulations` is
replaced by the printed one, or a term is left out, added or said differently.  Of the
departures that the default names these are not here: hard ground and rest (a lying
object has z = 0 whatever the page says), unfelt (by reduction, no finger that feels
nothing has an impulse).  (1) and (2) are unbounded below: bounded here as in `paper`.

Truth is read here, never by the package.  cone: largest |lam_t| - mu lam_n, recomputed,
in weights.  CPU seconds exclude the derivation of kinds: who derives some is run again.
"""

import argparse
import csv
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from unittest.mock import patch

import casadi as ca
import numpy as np
from trimesh.creation import box
from trimesh.transformations import quaternion_matrix, translation_matrix

from formulations import contact, paper, sensing
from formulations import violation_implicit as default
from tactilenlp import Measurements, Scene, solve_estimate
from tactilenlp.errors import TactileError
from tactilenlp.kind import seconds_deriving
from tactilenlp.metrics import surface_distance

INFORMATION = ca.inv(ca.DM(paper.SIGMA_N))  # (3, 3) [1/rad^2]
WEIGHT = {name: value for name, (value, _) in paper.WEIGHTS.items()}


@dataclass(frozen=True, eq=False)
class Undone:
    """The default page with one departure undone.

    functions: (module, name, printed function); terms(body): functions by the name of
    the cost they replace, None leaves it out; added(nlp, window, body) says more;
    fixed: variables that stay at their guess.
    """

    functions: tuple = ()
    terms: Callable = lambda body: {}
    added: Callable = lambda nlp, window, body: None
    fixed: tuple[str, ...] = ()

    @property
    def LEVELS(self):
        return tuple(replace(v, fixed=v.fixed + self.fixed) for v in default.LEVELS)

    def build(self, nlp, window, scene, shape):
        """Fill `nlp` as the default does, but for the one departure."""
        body, minimize = paper.Body(window, scene, shape), nlp.minimize
        printed = self.terms(body)

        def say(name, function, *arguments, role):
            function = printed.get(name.split(",")[0], function)
            if function is not None:
                minimize(name, function, *arguments, role=role)

        with ExitStack() as stack:
            for place in (*self.functions, (nlp, "minimize", say)):
                stack.enter_context(patch.object(*place))
            default.build(nlp, window, scene, shape)
        self.added(nlp, window, body)


def dynamics(body):
    """Replace the balance of impulses by |x_{t+1} - f|^2."""

    def printed(theta, x, x_1, x_2, dt, w, sigma, *impulses):
        deviation = WEIGHT["dynamics deviation"]
        return body.unpredicted(theta, x, x_1, x_2, dt, deviation, *impulses)

    return {"balance": printed}


def link(body):
    """Replace the Cauchy link between actions by |x_{t+1} - f|^2 without impulses."""
    deviation = WEIGHT["dynamics deviation"]
    return {"between actions": lambda *args: body.moved(*args[:3], deviation)}


def bounded(nlp, window, body):
    """Bound the normal impulses as `paper` does."""
    for name, rows in (("finger", window.push), ("ground", window.corner)):
        w = body.scene.mass * paper.G * window.step.dt[rows.step]
        lam = nlp.variables[name]
        nlp.subject_to(f"{name} most", lambda lam, w: lam[0] / w, lam, w,
                       upper=paper.MOST)  # fmt: skip


def squeezed(nlp, window, body):
    """Add complementarity (1) and non-penetration (3) of felt fingers."""
    theta, x, lam = (nlp.variables[name] for name in ("theta", "x", "finger"))
    push, touch, step = window.push, window.touch, window.step
    energy = body.scene.mass * paper.G * step.dt[push.step] * paper.LIFT

    def printed(theta, x, lam, p_wf, rho, energy):
        gap = body.finger_gap(theta, x, p_wf, rho)
        loss = contact.printed_complementarity(lam, gap) / energy
        return WEIGHT["complementarity"] * loss

    nlp.minimize("squeezing", printed, theta, x[:, step.knot[push.step]], lam,
                 push.p_wf, push.radius, energy, role="physics")  # fmt: skip
    name = "penetration deviation"
    nlp.parameter(name, WEIGHT[name], "m")
    where = touch.p_wf, touch.radius
    paper.apart(nlp, "felt finger", body.finger_gap, theta, x[:, touch.knot], where)
    bounded(nlp, window, body)


def printed_normal(n, n_m, sigma):
    return sensing.normal_within(n, n_m, INFORMATION)


def printed_dissipation(mu, lam, v_s, *_):
    weight = WEIGHT["dissipation"] / default.KAPPA
    return weight * contact.printed_dissipation(lam, v_s)


PAGES = {
    "default": default,
    "paper": paper,
    "logistic touch": Undone((
        (sensing, "touch", lambda phi, sigma: sensing.felt(phi, paper.ALPHA)),
        (sensing, "free", lambda phi, alpha: sensing.softplus(-paper.ALPHA * phi)),
    )),
    "no mixture": Undone(((sensing, "mixture", lambda cost, ceiling: cost),)),
    "Sigma_n": Undone(((sensing, "normal", printed_normal),)),
    "no depth": Undone(fixed=("depth",)),
    "no size prior": Undone(terms=lambda body: {"size prior": None}),
    "plain link": Undone(terms=link),
    "pose dynamics": Undone(terms=dynamics),
    "(1) and (3)": Undone(added=squeezed),
    "(2) dissipation": Undone(
        ((contact, "dissipation", printed_dissipation),), added=bounded
    ),
    "exact cone": Undone((
        (contact, "cone", lambda mu, lam, rounding: contact.cone_squared(mu, lam)),
    )),
    "no least impulse": Undone(terms=lambda body: dict.fromkeys(
        ("least finger impulse", "least ground impulse")
    )),
}  # fmt: skip


def run(file, na, name) -> dict:
    """Return the row of one page on the first `na` actions of one file."""
    data, truth = Measurements.load(file), np.load(file)
    data, scene = data.select(np.unique(data.action)[:na]), Scene.load(file)
    row = {"scene": Path(file).stem, "na": na, "page": name, "converged": False}
    how = {"formulation": PAGES[name], "throw": False}
    try:
        derived = seconds_deriving[0]
        estimate = solve_estimate(data, scene, **how)
        if seconds_deriving[0] > derived:
            estimate = solve_estimate(data, scene, **how)
    except TactileError as error:
        return row | {"status": f"{type(error).__name__}: {error}"}
    pose = translation_matrix(truth["object_position"][data.samples - 1])
    pose = pose @ quaternion_matrix(truth["object_quaternion"][data.samples - 1])
    distance = surface_distance(estimate.mesh(), box(truth["side_lengths"], pose))
    outside = 0.0
    for which, mu in (("finger", scene.friction_finger), ("ground", scene.friction_ground)):
        normal, *tangential = estimate.unknowns[which] / (scene.mass * paper.G * data.dt)
        outside = max(outside, (np.hypot(*tangential) - mu * normal).max(initial=0.0))
    *presolve, joint = estimate.iterations_by_level
    return row | {
        "converged": bool(estimate.success), "mm": 1e3 * distance.mean,
        "presolve": sum(presolve), "joint": joint, "cpu_s": estimate.seconds["total"],
        "cone": float(outside), "nats": estimate.objective, "status": estimate.status,
    }  # fmt: skip
