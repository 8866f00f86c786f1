"""Check objects read from a file: kinds of plain values, shapes and ranges of arrays.

A class states the arrays in its files by `LAYOUT`, a dictionary from the path of a
value ("impulses/*": every value of that dictionary) to its shape.  A name in a shape
stands for one number in the whole object, ANY for any number, a number for itself,
Ellipsis for further axes.  A tuple has its length as shape, and None may stand for what
is optional.  "3 V" stands for three times V.
`FINITE` names paths of arrays that are finite, `UNIT` those whose rows have length one,
`SOLID` those of points whose convex hull has a volume.
"""

from __future__ import annotations

import re

import numpy as np

ANY = "any"  # number along an axis
ROW_TOLERANCE = 1e-6  # of the length of a row that should be one
PLAIN = {  # what an annotation admits, of types that JSON and .npz have
    "str": str, "bool": (bool, np.bool_), "dict": dict, "tuple": tuple,
    "int": (int, np.integer), "float": (int, float, np.number),
    "np.ndarray": np.ndarray,
}  # fmt: skip


def check_kinds(kind: type, fields: dict) -> None:
    """Raise TypeError unless the fields of a dataclass are of the annotated kinds."""
    for name, value in fields.items():
        words = str(kind.__dataclass_fields__[name].type)
        if not _admitted(value, words):
            got = type(value).__name__
            if isinstance(value, (dict, tuple)):
                entries = value.values() if isinstance(value, dict) else value
                got += f" of {sorted({type(entry).__name__ for entry in entries})}"
            raise TypeError(f"{kind.__name__}.{name} is a {got}, expected {words}")


def _admitted(value, words: str) -> bool:
    """Return whether an annotation such as "dict[str, float] | None" admits a value."""
    return any(_is(value, word) for word in re.split(r" \| (?![^\[]*\])", words))


def _is(value, word: str) -> bool:
    """Return whether a value is of one kind, and its entries of theirs."""
    name, _, inner = word.removesuffix("]").partition("[")
    if name == "None":
        return value is None
    if name not in PLAIN:
        return name in ("object", type(value).__name__)
    if isinstance(value, bool) and name != "bool":
        return False
    if not isinstance(value, PLAIN[name]) or not inner:
        return isinstance(value, PLAIN[name])
    kinds = inner.split(", ")
    if name == "dict":
        return all(_admitted(entry, kinds[1]) for entry in value.values())
    kinds = kinds[:1] * len(value) if kinds[-1] == "..." else kinds
    return len(kinds) == len(value) and all(map(_admitted, value, kinds))


def check_layout(found) -> None:
    """Raise ValueError unless the arrays of an object are as its class states."""
    sizes: dict[str, int] = {}
    kind = type(found)
    for path, shape in getattr(kind, "LAYOUT", {}).items():
        for where, value in _at(found, path.split("/")):
            if value is not None:
                _check_shape(f"{kind.__name__}.{where}", value, shape, sizes)
    for path in getattr(kind, "FINITE", ()):
        for where, value in _at(found, path.split("/")):
            if not np.isfinite(value).all():
                raise ValueError(f"{kind.__name__}.{where} is not finite")
    for path in getattr(kind, "UNIT", ()):
        for where, value in _at(found, path.split("/")):
            off = np.abs(np.linalg.norm(value, axis=-1) - 1).max(initial=0.0)
            if not off < ROW_TOLERANCE:
                raise ValueError(f"{kind.__name__}.{where}: lengths {off:.2g} off one")
    for path in getattr(kind, "SOLID", ()):
        for where, value in _at(found, path.split("/")):
            if not has_volume(value):
                raise ValueError(f"{kind.__name__}.{where}: a body without a volume")


def has_volume(points) -> bool:
    """Return whether points (n, 3) have a convex hull that can be computed."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return bool(0 < ConvexHull(points).volume < np.inf)
    except (QhullError, ValueError):
        return False


def _at(found, steps, where=""):
    """Yield the names and values at a path; "*" stands for every entry."""
    if not steps:
        yield where, found
        return
    first, *rest = steps
    if found is None:
        return
    if isinstance(found, dict):
        pairs = found.items() if first == "*" else [(first, found.get(first))]
    elif isinstance(found, tuple):
        pairs = enumerate(found)
    else:
        pairs = [(first, getattr(found, first))]
    for name, value in pairs:
        yield from _at(value, rest, f"{where}/{name}".strip("/"))


def _check_shape(where: str, value, shape: tuple, sizes: dict) -> None:
    """Raise ValueError unless an array has a shape; sizes: of names, extended."""
    got = (len(value),) if isinstance(value, tuple) else np.shape(value)
    if isinstance(value, np.ndarray) and value.dtype.kind not in "biuf":
        raise ValueError(f"{where} has dtype {value.dtype}, expected numbers")
    axes = [axis for axis in shape if axis is not Ellipsis]
    fits = len(got) >= len(axes) if Ellipsis in shape else len(got) == len(axes)
    if fits:
        for axis, size in zip(axes, got, strict=False):
            expected_size = _known_size(axis, size, sizes)
            fits = fits and expected_size in (size, ANY)
    if not fits:
        expected = ", ".join(
            f"{axis} = {sizes[axis]}" if axis in sizes else str(axis) for axis in shape
        )
        raise ValueError(f"{where} has shape {got}, expected ({expected})")


def _known_size(axis, size: int, sizes: dict):
    """Return the size that an axis should have; a new name takes `size`."""
    if not isinstance(axis, str) or axis == ANY:
        return axis
    times, _, name = axis.rpartition(" ")
    return int(times or 1) * sizes.setdefault(name, size // int(times or 1))
