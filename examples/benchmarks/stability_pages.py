"""Pages of the stress suite: the same equations in other units or weights."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module

import casadi as ca
import numpy as np
from stability_judge import WAYS

from tactilenlp.nlp.terms import Columns, Variable


def page_of(way):
    """Return the page of a way."""
    return import_module(f"formulations.{WAYS[way][1]}")


class Edited:
    """A page with some parameters multiplied: factors, by name."""

    __name__ = "edited"

    def __init__(self, page, factors: dict[str, float]) -> None:
        self.page, self.factors = page, factors
        self.REDUCTIONS = getattr(page, "REDUCTIONS", {})
        for levels in ("LEVELS", "ROUGH"):
            if hasattr(page, levels):
                setattr(self, levels, tuple(map(self._level, getattr(page, levels))))

    def _level(self, level):
        values = level.parameters.items()
        values = {name: v * self.factors.get(name, 1) for name, v in values}
        return replace(level, parameters=values)

    def build(self, nlp, window, scene, shape) -> None:
        parameter = nlp.parameter

        def changed(name, value, *args):
            return parameter(name, value * self.factors.get(name, 1), *args)

        nlp.parameter = changed
        self.page.build(nlp, window, scene, shape)


class InUnits:
    """A page whose unknowns are kept in other units: numbers[unit] of them make one.

    {"m": 1000}: in millimetres; {"N s": 1000}: impulses in g m/s.  The equations stay
    in SI, and read every unknown converted back.
    """

    def __init__(self, page, numbers: dict[str, float]) -> None:
        self.page, self.numbers, self.by_name = page, numbers, {}
        self.LEVELS = page.LEVELS
        self.REDUCTIONS = getattr(page, "REDUCTIONS", {})

    def build(self, nlp, window, scene, shape) -> None:
        for name in ("minimize", "subject_to", "report", "follow"):
            setattr(nlp, name, self._reading(getattr(nlp, name)))
        variable = nlp.variable

        def converted(name, rows, columns=1, *, unit, **sizes):
            f = by_unit(unit, self.numbers) * np.ones(rows)
            self.by_name[name] = f
            sizes = {key: converted_size(v, f) for key, v in sizes.items()}
            return variable(name, rows, columns, unit=unit, **sizes)

        nlp.variable = converted
        self.page.build(nlp, window, scene, shape)

    def _reading(self, add):
        """Return what adds a term whose function reads its unknowns in SI."""

        def adding(name, function, *arguments, **more):
            factors = [self._of(a) for a in arguments]
            out = self._of(more["gives"]) if "gives" in more else None

            def there(*local):
                pairs = zip(local, factors, strict=True)
                value = function(*(in_si(v, f) for v, f in pairs))
                return value if out is None else value * out

            return add(name, there, *arguments, **more)

        return adding

    def _of(self, argument):
        """Return the factors of what an argument reads, None where it is SI."""
        if hasattr(argument, "_fields"):  # a named tuple of arguments
            return type(argument)(*map(self._of, argument))
        if isinstance(argument, Variable):
            return ca.DM(self.by_name[argument.name])  # a column for each instance
        if not isinstance(argument, Columns):
            return None
        each = int(np.prod(argument.columns.shape[1:]))
        return ca.DM(np.tile(self.by_name[argument.variable.name], each))


def in_si(value, factors):
    """Return what a function reads of an argument, in SI; factors: as of `_of`."""
    if hasattr(value, "_fields"):
        return type(value)(*map(in_si, value, factors))
    return value if factors is None else value / factors


def by_unit(unit: str, numbers: dict[str, float]):
    """Return the number of every row of unknowns, by their units: "m, m, rad"."""
    found = [numbers.get(word.strip(), 1.0) for word in unit.split(",")]
    return np.array(found) if len(found) > 1 else found[0]


def converted_size(value, f):
    """Return a guess or a bound, one number or one for each row, in other units."""
    if isinstance(value, (list, tuple)):
        return [np.asarray(v, float) * g for v, g in zip(value, f, strict=True)]
    value = np.asarray(value, float)
    if value.ndim == 2:
        return value * f[:, None]
    return value * (f if value.ndim == 1 or len(set(f)) > 1 else f[0])
