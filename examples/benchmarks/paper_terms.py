"""Compare the page `paper` with the default page, one departure at a time.

python examples/benchmarks/paper_terms.py ../shared/scenes/cuboid_0[0-2]*.npz
    [--executor processes|dask|mpi|none]

From the same hypotheses, the script solves the default page, `paper`, and the default
page with one departure undone at a time: a function of `formulations` is replaced by
the printed one, or a term is changed, omitted or added.  Not included: hard ground and
rest (an object at rest has z = 0 on any page), and unfelt contacts (reduced: no
contact, no impulse).  (1) and (2) are unbounded below; they are bounded as in `paper`.

The truth is read here, never by the package.  cone: largest |lam_t| - mu lam_n,
recomputed, in weights.  CPU seconds exclude the derivation of term functions; a case
that derives some is repeated.
"""

import argparse
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from pathlib import Path
from unittest.mock import patch

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np
from study import add_executor, executor_of, mapped, write_csv
from trimesh.creation import box
from trimesh.transformations import quaternion_matrix, translation_matrix

from formulations import contact, paper, paper_contact, sensing
from formulations import violation_implicit as default
from formulations.paper_physics import Physics
from tactilenlp import Measurements, Scene, solve_estimate
from tactilenlp.errors import TactileError
from tactilenlp.evaluation.metrics import surface_distance
from tactilenlp.nlp.term_functions import default_cache

INFORMATION = ca.inv(ca.DM(paper.SIGMA_N))  # (3, 3) [1/rad^2]
WEIGHT = {name: value for name, (value, _) in paper.WEIGHTS.items()}


@dataclass(frozen=True, eq=False)
class Undone:
    """The default page with one departure undone.

    functions: (module, name, printed function); terms: functions of (body, *arguments)
    by the name of the cost that they replace; added(nlp, window, body) says more.
    """

    LEVELS = default.LEVELS
    functions: tuple = ()
    terms: dict = field(default_factory=dict)
    added: Callable = lambda nlp, window, body: None

    def build(self, nlp, window, scene, shape):
        """Fill `nlp` as the default does, but for the one departure."""
        body, minimize = Physics(window, scene, shape), nlp.minimize

        def say(name, function, *arguments, role):
            key = name.split(",")[0]
            function = partial(self.terms[key], body) if key in self.terms else function
            minimize(name, function, *arguments, role=role)

        with ExitStack() as stack:
            for place in (*self.functions, (nlp, "minimize", say)):
                stack.enter_context(patch.object(*place))
            default.build(nlp, window, scene, shape)
        self.added(nlp, window, body)


def balance(body, theta, x, x_1, x_2, dt, w, sigma, *impulses):
    deviation = WEIGHT["dynamics deviation"]
    return body.unpredicted(theta, x, x_1, x_2, dt, deviation, *impulses)


def link(body, theta, x, x_1, scale):
    return body.moved(theta, x, x_1, WEIGHT["dynamics deviation"])


def normal(n, n_m, sigma):
    return sensing.normal_within(n, n_m, INFORMATION)


def dissipation(mu, lam, v_s, *_):
    weight = WEIGHT["dissipation"] / default.WEIGHTS["kappa"][0]
    return weight * contact.printed_dissipation(lam, v_s)


def bounded(nlp, window, body):
    """Bound the normal impulses as `paper` does."""
    for name, rows in (("finger", window.push), ("ground", window.corner)):
        w = body.scene.mass * paper.G * window.step.dt[rows.step]
        lam = nlp.variables[name]
        most = paper_contact.LAM_MAX
        nlp.subject_to(f"{name} most", lambda lam, w: lam[0] / w, lam, w, upper=most)


def squeezed(nlp, window, body):
    """Add complementarity (1), non-penetration (3) and inelasticity (4) of fingers."""
    theta, x, lam = (nlp.variables[name] for name in ("theta", "x", "finger"))
    for name in ("complementarity", "inelasticity", "penetration deviation"):
        nlp.parameter(name, WEIGHT[name])
    push, step, felt, gap = window.push, window.step, window.touch, body.finger_gap
    k, w = push.step, body.scene.mass * paper.G * step.dt[push.step]
    now = theta, x[:, step.pose[k]], x[:, step.before[k]], step.dt[k], w
    paper_contact.complementarity_and_inelasticity(
        nlp, "printed", gap, body.finger_velocity, now, lam,
        (push.p_wf, push.radius, push.p_wf_1, push.tangent),
    )  # fmt: skip
    at = felt.p_wf, felt.radius
    paper_contact.non_penetration(nlp, "printed", gap, theta, x[:, felt.pose], at)
    bounded(nlp, window, body)


PAGES = {
    "default": default,
    "paper": paper,
    "logistic touch": Undone((
        (sensing, "touch", lambda phi, sigma: sensing.felt(phi, paper.ALPHA)),
        (sensing, "free", lambda phi, alpha: sensing.softplus(-paper.ALPHA * phi)),
    )),
    "no mixture": Undone(((sensing, "mixture", lambda cost, outlier_cost: cost),)),
    "Sigma_n": Undone(((sensing, "normal", normal),)),
    "no depth": Undone(added=lambda nlp, *_: nlp.subject_to(
        "no depth", lambda d: d, nlp.variables["depth"], lower=0, upper=0)),
    "no size prior": Undone(terms={"size prior": lambda *_: 0}),
    "plain link": Undone(terms={"between actions": link}),
    "pose dynamics": Undone(terms={"balance": balance}),
    "(1) (3) (4)": Undone(added=squeezed),
    "(2)": Undone(((contact, "dissipation", dissipation),), added=bounded),
    "exact cone": Undone((
        (contact, "cone", lambda mu, lam, rounding: contact.cone_squared(mu, lam)),
    )),
    "no least impulse": Undone(terms=dict.fromkeys(
        ("least finger impulse", "least ground impulse"), lambda *_: 0)),
}  # fmt: skip


def run(file, na, name) -> dict:
    """Return the row of one page on the first `na` actions of one file."""
    data, truth = Measurements.load(file), np.load(file)
    data, scene = data.select(np.unique(data.action)[:na]), Scene.load(file)
    row, derived = {"scene": Path(file).stem, "page": name, "converged": False}, None
    try:
        while derived != default_cache().seconds:
            derived = default_cache().seconds
            estimate = solve_estimate(data, scene, formulation=PAGES[name], throw=False)
    except TactileError as error:
        return row | {"status": f"{type(error).__name__}: {error}"}
    pose = translation_matrix(truth["object_position"][data.samples - 1])
    pose = pose @ quaternion_matrix(truth["object_quaternion"][data.samples - 1])
    distance = surface_distance(estimate.mesh(), box(truth["side_lengths"], pose))
    outside, w = [0.0], scene.mass * paper.G * data.dt
    for which in ("finger", "ground"):
        lam, mu = estimate.unknowns[which] / w, getattr(scene, f"friction_{which}")
        outside.extend(np.hypot(lam[1], lam[2]) - mu * lam[0])
    *presolve, joint = estimate.iterations_by_level
    return row | {
        "converged": bool(estimate.success), "mm": 1e3 * distance.mean,
        "presolve": sum(presolve), "joint": joint, "cpu_s": estimate.seconds["total"],
        "cone": max(outside), "nats": estimate.objective, "status": estimate.status,
    }  # fmt: skip


def table(rows) -> None:
    """Print medians for every page, clean and noisy files apart, and the worst."""
    names = ("mm", "presolve", "joint", "cpu_s")
    print(f"{'page':24}{'good':>6}", *(f"{n:>8}" for n in (*names, "worst", "cone")))
    for page, noisy in product(PAGES, (False, True)):
        some = [r for r in rows if (r["page"], "noisy" in r["scene"]) == (page, noisy)]
        done = [r for r in some if "mm" in r]
        if done:
            figures = [np.median([r[n] for r in done]) for n in names]
            figures += [max(r[n] for r in done) for n in ("mm", "cone")]
            good = f"{sum(r['converged'] for r in some)}/{len(some)}"
            words = f"{page + ' noisy' * noisy:24}{good:>6}"
            print(words, *(f"{x:8.3g}" for x in figures))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="+")
    parser.add_argument("--actions", type=int, default=6)
    parser.add_argument("--out", type=Path, default=Path("benchmark"))
    add_executor(parser, "none")
    args = parser.parse_args()
    cases = product(args.files, [args.actions], PAGES)
    with executor_of(args, __file__) as executor:
        rows = list(mapped(executor, run, cases))
    args.out.mkdir(parents=True, exist_ok=True)
    write_csv(args.out / "paper_terms.csv", rows)
    table(rows)
    figure, axes = plt.subplots(figsize=(7, 5), layout="constrained")
    for r in (r for r in rows if "mm" in r):
        color = "tab:red" if "noisy" in r["scene"] else "tab:blue"
        axes.plot(r["mm"], r["page"], "o" if r["converged"] else "x", color=color)
    axes.set(xscale="log", xlabel="exact surface distance [mm] (red noisy, x unsolved)")
    figure.savefig(args.out / "paper_terms.png")


if __name__ == "__main__":
    main()
