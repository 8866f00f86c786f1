"""Find the page and the shape that a name stands for; extend a page by terms."""

from __future__ import annotations

import importlib
import inspect
import re
from contextlib import contextmanager
from functools import partial
from types import ModuleType
from typing import Protocol

from formulations.ellipsoid import ELLIPSOID
from formulations.finger_offset import displaced
from formulations.level import Level
from formulations.names import EXACT, RESPONSE
from formulations.page_contract import INHERITED, NO_REDUCTIONS, contract_of
from formulations.polytope import polytope
from formulations.shape import CUBOID, Shape
from formulations.shape_fields import takes, unfit_fields
from formulations.upright import CYLINDER, prism

from ..common.validation import check_one_of
from ..errors import OptionError, PageError, did_you_mean, shortened
from .reductions import REDUCTION_NAMES

_short = partial(shortened, most=80)
SHAPES = {
    "cuboid": CUBOID, "polytope": polytope(), "cylinder": CYLINDER,
    "ellipsoid": ELLIPSOID,
}  # fmt: skip
PRISM = re.compile(r"prism of (\d{1,3}) sides")
FORMULATIONS = (
    *("quasi_static", "violation_implicit", "paper"),
    *("shooting", "multiple_shooting", "complementarity"),
)


class Page(Protocol):
    """What a formulation is: a module, or an object, that states one programme.

    Optional members, in capital letters, are those of PageContract
    (formulations/page_contract.py); `formulations/README.md` explains each.
    """

    LEVELS: tuple  # of formulations.level.Level, solved one after another

    def build(self, nlp, window, scene, shape) -> None:
        """Declare unknowns, costs and constraints of a window of data in a Problem."""


def shape_of(shape) -> Shape:
    """Return the shape of a name, or a user's; OptionError for an unknown name."""
    if isinstance(shape, Shape):
        for field, got, expected, remedy in unfit_fields(shape):
            raise OptionError(
                "unfit", where=f"shape.{field}", got=got, expected=expected, next=remedy
            )
        return shape
    sides = PRISM.fullmatch(shape) if isinstance(shape, str) else None
    if sides and int(sides[1]) >= 3:
        return prism(int(sides[1]))
    if not isinstance(shape, str) or shape not in SHAPES:
        raise OptionError(
            "unknown shape", where="shape", got=shape,
            expected=f"one of {[*SHAPES]}, or a Shape such as tactilenlp.prism(6)",
            next="call it: prism(6), polytope(30)" if callable(shape)
            else did_you_mean(shape, SHAPES) or "pass a class of your own as shape=",
        )  # fmt: skip
    return SHAPES[shape]


def page_of(formulation, shape):
    """Return the page of a name, the shape's own if it has any, or a user's page."""
    if isinstance(formulation, str):
        return importlib.import_module(f"formulations.{_module_of(formulation, shape)}")
    _check_page(formulation)
    return formulation


def _check_page(page) -> None:
    """Raise OptionError unless an object has the members of a Page."""
    for name in ("build", "LEVELS"):
        if not hasattr(page, name):
            raise OptionError(
                f"a page needs {name}", where="formulation", got=_short(page),
                next="see tactilenlp.Page and formulations/README.md",
            )  # fmt: skip
    levels = page.LEVELS
    listed = isinstance(levels, (tuple, list)) and len(levels) > 0
    if not (listed and all(isinstance(k, Level) for k in levels)):
        raise OptionError(
            "a page needs levels", where="formulation.LEVELS", got=_short(levels),
            expected="a tuple of formulations.level.Level, at least one",
        )  # fmt: skip
    if not (callable(page.build) and takes(page.build, 4)):
        raise OptionError(
            "a page needs a function", where="formulation.build",
            got=_short(page.build), expected="build(nlp, window, scene, shape)",
        )  # fmt: skip
    made, freed = contract_of(page).reductions, contract_of(page).freed
    if not (isinstance(made, dict) and {*made} <= {*REDUCTION_NAMES}):
        raise OptionError(
            "no such reduction", where="formulation.REDUCTIONS", got=_short(made),
            expected=f"a dict of bool by name, of {', '.join(REDUCTION_NAMES)}",
        )  # fmt: skip
    allowed = *REDUCTION_NAMES, *NO_REDUCTIONS
    for name in freed:
        check_one_of("formulation.FREED", name, allowed, "no such assumption")


def _module_of(formulation: str, shape) -> str:
    """Return the module of a formulation; OptionError where the shape has none."""
    check_one_of(
        "formulation", formulation, FORMULATIONS, "unknown formulation",
        unit="or a page", next="import a page of your own, and give the module",
    )  # fmt: skip
    if not shape.own_pages:
        return formulation
    if formulation not in shape.own_pages:
        raise OptionError(
            f"no page of this name for a {shape.name}", where="formulation",
            got=formulation, expected=" or ".join(f'"{n}"' for n in shape.own_pages),
            next='use shape="cuboid", or give a page of your own',
        )  # fmt: skip
    return f"{shape.name}_{formulation}"


def check_unknowns(problem, theta, x) -> None:
    """Raise PageError unless the unknowns theta and x have the sizes of a start."""
    declared = {n: (v.rows, v.columns) for n, v in problem.variables.items()}
    rows, columns = declared.get("theta", (0, 0))
    if rows * columns == theta.size and declared.get("x") == x.shape:
        return
    raise PageError(
        "the page lacks an unknown, or it has another size", where="formulation",
        got=", ".join(f"{n} {size}" for n, size in declared.items()) or "none",
        expected=f"theta of {theta.size} numbers [m], x {x.shape}, a column a pose",
        next='declare nlp.variable("theta", ...) and nlp.variable("x", ...) in build',
    )  # fmt: skip


def extend(
    base, *terms, replace=None, without=(), shape="cuboid", **parts
) -> ModuleType:
    """Return a page: another one with terms added, replaced or omitted.

    base: the name of a formulation, for bodies of class `shape`, or a page; terms:
    functions term(nlp, window, scene, shape), called after the base has filled `nlp`,
    so that they read its unknowns as nlp.variables["theta"] and nlp.variables["x"];
    replace: by the name of a term of the base, or by the part of it before a comma, the
    function that takes its place with the same arguments; without: names of terms to
    omit; parts: further arguments of the base's `build`, such as `law`.

    Reports about replaced and omitted terms, "<name>, exact" and "<name>, impulse
    response", are omitted; `terms` may add others.  LEVELS and other constants are the
    base's, as are its shared term functions; where fingers have offsets, terms read
    displaced fingers.
    Raises OptionError, and in `build` PageError where no term of the base has a name.
    """
    base = page_of(base, shape_of(shape))
    replace = {} if replace is None else replace
    without = (without,) if isinstance(without, str) else without
    _check_extension(base, terms, replace, without, parts)
    name = _extended_name(base, terms, (*replace, *parts), without)
    page = ModuleType(name, base.__doc__)
    vars(page).update({n: getattr(base, n) for n in INHERITED if hasattr(base, n)})

    def build(nlp, window, scene, shape):
        """Fill `nlp` with the base, then with the terms."""
        edited = _Edited(nlp, replace, without)
        base.build(edited, window, scene, shape, **parts)
        edited.check_met()
        if terms:
            window = displaced(nlp, window, scene)
        with _unshared(nlp):
            for term in terms:
                term(nlp, window, scene, shape)

    page.build = build
    return page


def name_of(page) -> str:
    """Return the name of a page in an estimate."""
    return getattr(page, "__name__", "page").rpartition(".")[2]


def _extended_name(base, terms, others, without) -> str:
    """Return the name of a page that extends another one."""
    names = [getattr(t, "__name__", "term") for t in terms]
    names += [f"other {name}" for name in others]
    names += [f"no {name}" for name in without]
    return " + ".join([name_of(base), *names])


def _check_extension(base, terms, replace, without, parts) -> None:
    """Raise OptionError for what cannot extend a page."""
    if not isinstance(replace, dict):
        raise OptionError(
            "no replacements", where="replace", got=_short(replace),
            expected='a dict, such as {"finger cone": function}',
        )  # fmt: skip
    listed = isinstance(without, (list, tuple, set, frozenset))
    if not listed or not all(isinstance(name, str) for name in without):
        raise OptionError(
            "no names of terms", where="without", got=_short(without),
            expected='names of terms of the page, such as ("finger cone",)',
        )  # fmt: skip
    for term in (*terms, *replace.values()):
        if not callable(term):
            raise OptionError(
                "no function", where="extend", got=_short(term),
                expected="term(nlp, window, scene, shape)",
                next="give the function itself, without calling it",
            )  # fmt: skip
    for term in terms:
        if not takes(term, 4):
            raise OptionError(
                "a term of other arguments", where="extend",
                got=_signature(term), expected="term(nlp, window, scene, shape)",
            )  # fmt: skip
    names = [*inspect.signature(base.build).parameters][4:]
    if unknown := [name for name in parts if name not in names]:
        raise OptionError(
            "the page's build has no such argument", where="extend",
            got=", ".join(unknown), expected=" or ".join(names) or "none",
        )  # fmt: skip


class _Edited:
    """A problem as the base of an extended page sees it: some terms are others."""

    def __init__(self, nlp, replace: dict, without: tuple):
        self._nlp, self._stated = nlp, []
        self._edits = {**replace, **dict.fromkeys(without)}  # None: omitted

    def __getattr__(self, name):
        """Return a method of the problem; its terms may be omitted, or others."""
        found = getattr(self._nlp, name)
        edited = name in ("minimize", "subject_to", "follow")
        return partial(self._add, found) if edited else found

    def report(self, name, function, *arguments):
        """Add a report, unless it is about a term that is omitted or another one."""
        if self._key_of(name.removesuffix(EXACT).removesuffix(RESPONSE)) is None:
            self._nlp.report(name, function, *arguments)

    def _key_of(self, name) -> str | None:
        """Return the name under which a term is edited: its own, or up to a comma."""
        names = name, name.partition(",")[0]
        return next((key for key in names if key in self._edits), None)

    def _add(self, add, name, function, *arguments, **more):
        self._stated.append(name)
        key = self._key_of(name)
        if key is None:
            add(name, function, *arguments, **more)
        elif (other := self._edits[key]) is not None:
            if not takes(other, len(arguments)):
                raise PageError(
                    "a term of other arguments", where=f"replace: {key}",
                    got=_signature(other), expected=_signature(function),
                    next="take as many arguments as the term that is replaced",
                )  # fmt: skip
            with _unshared(self._nlp):
                add(name, other, *arguments, **more)

    def check_met(self) -> None:
        """Raise PageError where the base states no term of a name."""
        met = {n for name in self._stated for n in (name, name.partition(",")[0])}
        if unknown := sorted(self._edits.keys() - met):
            raise PageError(
                "the page states no such term", where="extend", got=str(unknown)[1:-1],
                expected=f"one of {self._stated}",
                next=did_you_mean(unknown[0], self._stated)
                or "problem_of(data, scene, page).describe() lists the terms",
            )  # fmt: skip


def _signature(function) -> str:
    """Return the name and the arguments of a function, as far as they are known."""
    name = getattr(function, "__name__", _short(function))
    try:
        return f"{name}{inspect.signature(function)}"
    except ValueError:  # built in, without a signature
        return name


@contextmanager
def _unshared(nlp):
    """Derive the terms that are added here anew: they may depend on the window."""
    shared, nlp.functions_by_name = nlp.functions_by_name, {}
    try:
        yield
    finally:
        nlp.functions_by_name = shared
