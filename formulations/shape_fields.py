"""Check the plain fields of a Shape: numbers, words and functions, before any is used.

CasADi must not see them before: a list that contains itself ends the process.
"""

from __future__ import annotations

from inspect import signature
from math import isfinite

MOST_SIZES = 3000  # [1] entries of theta: a hull of 1000 vertices
FUNCTIONS = {  # and what they are called with
    "distance": "theta, q, small", "normal": "theta, q, small",
    "corner": "theta, signs", "rest_height": "theta", "reach": "theta",
    "symbol": "name, rows", "pushed": "shape, theta",
}  # fmt: skip
OPTIONAL = {  # may be None
    "foot_squared": "theta, R_wo", "rounded": "theta, r",
    "mesh": "theta", "support": "theta, n", "inertia": "theta",
}  # fmt: skip
LOGICAL = "mirrored", "of_vertices", "round"
PAIRS = "bounds", "size_prior"
WORDS = "words", "units", "own_pages"
LISTS = "symmetries", "quantities"
SHOWN = 60  # characters of a value


def unfit_fields(shape) -> list[tuple[str, str, str, str]]:
    """Return (field, got, expected, remedy) of every field of another kind or size."""
    n = shape.theta
    if not (_whole(n) and 1 <= n <= MOST_SIZES):
        expected = f"a whole number from 1 to {MOST_SIZES}"
        return [("theta", _short(n), expected, "give how many sizes it has")]
    rules = {
        "name": (isinstance(shape.name, str), "a str"),
        "opposite_faces": (_faced(shape), "False, or True with three sizes"),
        "corners": (_points(shape.corners), "points of three numbers, at least one"),
        **{k: (_pair(getattr(shape, k), n), _pair_of(n)) for k in PAIRS},
        **{k: (_word_list(getattr(shape, k)), "a tuple of str") for k in WORDS},
        **{k: (_listed(getattr(shape, k)), "a tuple") for k in LISTS},
        **{k: (isinstance(getattr(shape, k), bool), "True or False") for k in LOGICAL},
        **{k: (_function(shape, k, False), f"{k}({v})") for k, v in FUNCTIONS.items()},
        **{
            k: (_function(shape, k, True), f"{k}({v}), or None")
            for k, v in OPTIONAL.items()
        },
    }
    remedies = dict.fromkeys(PAIRS, f"give one number, or {n}, for each of the pair")
    documented = "see the documentation of Shape"
    unfit = [
        (name, _short(getattr(shape, name)), expected, remedies.get(name, documented))
        for name, (fits, expected) in rules.items()
        if not fits
    ]
    return unfit or _unfit_prior(shape) or [
        (f"{name}: their number", str(len(getattr(shape, name))), str(n),
         f"give {n} {name}")
        for name in ("words", "units") if len(getattr(shape, name)) not in (0, n)
    ]  # fmt: skip


def _unfit_prior(shape) -> list[tuple[str, str, str, str]]:
    """Return what is wrong with the numbers of a size prior and of its bounds."""

    def each(value) -> list:
        return list(value) if _listed(value) else [value] * shape.theta

    low, high, mean, deviation = map(each, (*shape.bounds, *shape.size_prior))
    if not all(a < b for a, b in zip(low, high, strict=True)):
        fix = "give the least sizes first, then the largest"
        return [("bounds", _short(shape.bounds), "least below largest", fix)]
    if not all(d > 0 for d in deviation):
        fix = "give a mean and a standard deviation"
        return [("size_prior", _short(shape.size_prior), "a deviation above 0", fix)]
    if all(a <= m <= b for a, m, b in zip(low, mean, high, strict=True)):
        return []
    expected = f"a mean within the bounds, {shape.bounds} m"
    fix = "give metres: divide by 1000 if these are millimetres"
    return [("size_prior", _short(shape.size_prior), expected, fix)]


def _pair_of(n: int) -> str:
    return f"a pair, each one finite number or {n}"


def _whole(value) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _faced(shape) -> bool:
    faced = shape.opposite_faces
    return isinstance(faced, bool) and (shape.theta == 3 or not faced)


def _number(value) -> bool:
    """Tell whether a value is a finite real number."""
    plain = isinstance(value, (int, float)) and not isinstance(value, bool)
    try:
        return plain and isfinite(value)
    except OverflowError:  # an integer of 400 digits
        return False


def _listed(value) -> bool:
    return isinstance(value, (tuple, list))


def _word_list(value) -> bool:
    return _listed(value) and all(isinstance(word, str) for word in value)


def _points(value) -> bool:
    """Tell whether a value lists points of three numbers, at least one."""
    listed = _listed(value) and len(value) > 0
    return listed and all(
        _listed(point) and len(point) == 3 and all(map(_number, point))
        for point in value
    )


def _pair(value, n: int) -> bool:
    """Tell whether a value is a pair, each one a number or n numbers."""

    def one(part) -> bool:
        many = _listed(part) and len(part) == n and all(map(_number, part))
        return many or _number(part)

    return _listed(value) and len(value) == 2 and all(map(one, value))


def _function(shape, name: str, optional: bool) -> bool:
    """Tell whether a field is a function of as many arguments as it is called with."""
    value = getattr(shape, name)
    if value is None:
        return optional
    arguments = (FUNCTIONS | OPTIONAL)[name].count(",") + 1
    return callable(value) and takes(value, arguments)


def takes(function, arguments: int) -> bool:
    """Tell whether a function can be called with so many positional arguments."""
    try:
        signature(function).bind(*range(arguments))
    except TypeError:
        return False
    except ValueError:  # built in, without a signature
        return True
    return True


def _short(value) -> str:
    """Return a value in words, at most SHOWN characters."""
    try:
        text = repr(value)
    except Exception:  # of a foreign class, or an integer of 5000 digits
        text = f"a {type(value).__name__} that has no words"
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."
