"""Mistakes of who writes pages, shapes and worlds: each with words of its remedy."""

from dataclasses import replace
from types import ModuleType, SimpleNamespace

import casadi as ca

import tactilenlp as tn
from formulations import quasi_static
from formulations.level import Level


def page(term=None, **parts):
    """Return a page: the quasi-static one, with a term, or with other members."""

    def build(nlp, window, scene, shape):
        quasi_static.build(nlp, window, scene, shape)
        if term is not None:
            term(nlp, nlp.variables["theta"], nlp.variables["x"], window.step)

    made = ModuleType("my_page")
    made.build, made.LEVELS = build, (Level("only"),)
    vars(made).update(parts)
    return made


def cost(function, **more):
    """Return a page with a cost that is a function of theta."""
    more.setdefault("role", "prior")
    return page(lambda nlp, theta, x, step: nlp.minimize("a", function, theta, **more))


class Mute:
    """A world that returns nothing."""

    def execute(self, trajectory):
        """Feel nothing."""


class Deaf:
    """A world that takes no trajectory."""

    def execute(self):
        """Go nowhere."""


def explored(world, **more):
    return next(tn.explore(world, tn.Scene(), **more))


PAGES = {
    "no build": (
        lambda k: k.posed(SimpleNamespace(LEVELS=(Level("a"),))), "tactilenlp.Page",
    ),
    "one level for many": (
        lambda k: k.posed(page(LEVELS=Level("a"))), "a tuple of formulations.level",
    ),
    "a build of two arguments": (
        lambda k: k.posed(page(build=lambda nlp, window: None)),
        "build(nlp, window, scene, shape)",
    ),
    "no unknowns": (
        lambda k: k.solved(formulation=page(build=lambda *given: None)),
        'declare nlp.variable("theta"',
    ),
    "a reduction that does not exist": (
        lambda k: k.posed(page(REDUCTIONS={"flat": True})), "planar",
    ),
    "an assumption that does not exist": (
        lambda k: k.posed(page(FREED=("rigid", "plannar"))), "'planar'",
    ),
    "float of a symbol": (
        lambda k: k.solved(formulation=cost(lambda theta: float(theta[0]) ** 2)),
        "use functions of casadi",
    ),
    "if with a symbol": (
        lambda k: k.posed(cost(lambda t: t[0] if t[0] > 0 else -t[0])), "if_else",
    ),
    "a vector as cost": (lambda k: k.posed(cost(lambda t: t**2)), "sum1"),
    "a role": (
        lambda k: k.posed(cost(lambda t: t[0], role="likelyhood")), "'likelihood'",
    ),
    "an argument too many": (
        lambda k: k.posed(cost(lambda t, y: t[0])), "each argument of the term",
    ),
    "a row too many": (lambda k: k.posed(cost(lambda t: t[5])), "count rows"),
    "lists of two lengths": (
        lambda k: k.posed(
            page(
                lambda nlp, theta, x, step: nlp.minimize(
                    "a", lambda x, y: x[0] - y[0], x[:, step.pose],
                    x[:, step.before[:-1]], role="prior",
                )
            )
        ),
        "as many columns of each",
    ),
    "a constraint without limits": (
        lambda k: k.posed(
            page(lambda nlp, theta, x, step: nlp.subject_to("a", ca.sum1, theta))
        ),
        "lower=0, upper=0 is an equation",
    ),
    "one name twice": (
        lambda k: k.posed(
            page(
                lambda nlp, theta, x, step: [
                    nlp.minimize("a", ca.sumsqr, theta, role="prior") for _ in "ab"
                ]
            )
        ),
        "give it another name",
    ),
    "a parameter of a level": (
        lambda k: k.solved(
            formulation=page(LEVELS=(Level("a", parameters={"touch scal": 1}),))
        ),
        "'touch scale'",
    ),
    "a term that was called": (
        lambda k: tn.extend("violation_implicit", 3.0), "without calling it",
    ),
    "a term of one argument": (
        lambda k: tn.extend("violation_implicit", lambda nlp: None),
        "term(nlp, window, scene, shape)",
    ),
    "a term to replace": (
        lambda k: k.posed(tn.extend("violation_implicit", replace={"cone": len})),
        "describe() lists the terms",
    ),
    "an unknown of the base": (
        lambda k: k.posed(
            tn.extend("violation_implicit", lambda nlp, *more: nlp.variables["tetha"])
        ),
        "'theta'",
    ),
}  # fmt: skip
SHAPES_AND_WORLDS = {
    "names for theta": (
        lambda k: k.solved(shape=replace(tn.CUBOID, theta=("x", "y"))),
        "give how many sizes it has",
    ),
    "a distance of two arguments": (
        lambda k: k.solved(shape=replace(tn.CYLINDER, distance=lambda theta, q: q[0])),
        "distance(theta, q, small)",
    ),
    "too few words": (
        lambda k: k.solved(shape=replace(tn.CYLINDER, words=("diameter",))), "give 2",
    ),
    "a size prior in mm": (
        lambda k: k.solved(shape=replace(tn.CYLINDER, size_prior=((60, 30), 20))),
        "divide by 1000",
    ),
    "a prism of two sides": (lambda k: tn.prism(2), "from 3"),
    "a hull of three vertices": (lambda k: tn.polytope(3), "from 4"),
    "a class in a list": (lambda k: k.solved(shape=["cuboid", "prizm"]), "prism(6)"),
    "a world without execute": (lambda k: explored(object()), "TouchedWorld"),
    "a world that returns nothing": (
        lambda k: explored(Mute()), "return what was felt on the way",
    ),
    "an execute without argument": (lambda k: explored(Deaf()), "execute(trajectory)"),
    "a class as world": (lambda k: explored(tn.World), "make one: World(...)"),
    "a truth that is no method": (
        lambda k: explored(SimpleNamespace(execute=lambda path: 0, true_body=(1, 2))),
        "a method",
    ),
    "settings twice": (
        lambda k: explored(Mute(), settings=tn.ExploreOptions(), actions=1),
        "put all of them into ExploreOptions",
    ),
    "a name of a setting": (lambda k: explored(Mute(), action=1), "'actions'"),
    "a name of a policy": (lambda k: explored(Mute(), policy="fischer"), "'fisher'"),
    "a box in mm": (lambda k: tn.World((50, 35, 40)), "divide by 1000"),
    "one side of a box": (lambda k: tn.World(0.05), "shape (3,)"),
    "angles in degrees": (lambda k: tn.Workspace(bound=72), "numpy.radians"),
    "a name of a search": (
        lambda k: tn.choose_action(k.estimate, search="facin"), "'facing'",
    ),
}  # fmt: skip
