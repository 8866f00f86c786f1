"""Check the plain fields of a Shape: numbers, words and functions, before any is used.

CasADi must not see them before: a list that contains itself ends the process.
"""

from __future__ import annotations

from math import isfinite

MOST_SIZES = 3000  # [1] entries of theta: a hull of 1000 vertices
FUNCTIONS = "distance", "normal", "corner", "rest_height", "inertia", "reach", "symbol"
OPTIONAL = "foot_squared", "pushed", "rounded", "mesh", "support"
LOGICAL = "mirrored", "last_pose_held", "window_depends_on_start", "round"
PAIRS = "bounds", "size_prior"
WORDS = "words", "units", "own_pages"
LISTS = "symmetries", "quantities"
LISTING = "sizes", "vertices"  # what theta may list
SHOWN = 60  # characters of a value


def unfit_fields(shape) -> list[tuple[str, str, str, str]]:
    """Return (field, got, expected, remedy) of every field of another kind or size."""
    n = shape.theta
    if not (_whole(n) and 1 <= n <= MOST_SIZES):
        expected = f"a whole number from 1 to {MOST_SIZES}"
        return [("theta", _short(n), expected, "give how many sizes it has")]
    hull = _one_of(shape.parameters, LISTING[1:])  # no inertia
    rules = {
        "name": (isinstance(shape.name, str), "a str"),
        "parameters": (_one_of(shape.parameters, LISTING), f"one of {LISTING}"),
        "hypotheses": (_count(shape.hypotheses), "None, or a whole number from 1"),
        "corners": (_points(shape.corners), "points of three numbers, at least one"),
        **{k: (_pair(getattr(shape, k), n), _pair_of(n)) for k in PAIRS},
        **{k: (_word_list(getattr(shape, k)), "a tuple of str") for k in WORDS},
        **{k: (_listed(getattr(shape, k)), "a tuple") for k in LISTS},
        **{k: (isinstance(getattr(shape, k), bool), "True or False") for k in LOGICAL},
        **{k: (_function(shape, k, hull), "a function") for k in FUNCTIONS},
        **{k: (_function(shape, k, True), "a function or None") for k in OPTIONAL},
    }
    remedies = dict.fromkeys(PAIRS, f"give one number, or {n}, for each of the pair")
    documented = "see the documentation of Shape"
    found = [
        (name, _short(getattr(shape, name)), expected, remedies.get(name, documented))
        for name, (fits, expected) in rules.items()
        if not fits
    ]
    return found or [
        (f"{name}: their number", str(len(getattr(shape, name))), str(n),
         f"give {n} {name}")
        for name in ("words", "units") if len(getattr(shape, name)) not in (0, n)
    ]  # fmt: skip


def _pair_of(n: int) -> str:
    return f"a pair, each one finite number or {n}"


def _whole(value) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _number(value) -> bool:
    plain = isinstance(value, (int, float)) and not isinstance(value, bool)
    try:
        return plain and isfinite(value)
    except OverflowError:  # an integer of 400 digits
        return False


def _listed(value) -> bool:
    return isinstance(value, (tuple, list))


def _word_list(value) -> bool:
    return _listed(value) and all(isinstance(word, str) for word in value)


def _one_of(value, known) -> bool:
    return isinstance(value, str) and value in known


def _count(value) -> bool:
    return value is None or (_whole(value) and value >= 1)


def _points(value) -> bool:
    listed = _listed(value) and len(value) > 0
    return listed and all(
        _listed(point) and len(point) == 3 and all(map(_number, point))
        for point in value
    )


def _pair(value, n: int) -> bool:
    def one(part) -> bool:
        many = _listed(part) and len(part) == n and all(map(_number, part))
        return many or _number(part)

    return _listed(value) and len(value) == 2 and all(map(one, value))


def _function(shape, name: str, optional: bool) -> bool:
    value = getattr(shape, name)
    return callable(value) or (optional and value is None)


def _short(value) -> str:
    try:
        text = repr(value)
    except Exception:  # of a foreign class, or an integer of 5000 digits
        text = f"a {type(value).__name__} that has no words"
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."
