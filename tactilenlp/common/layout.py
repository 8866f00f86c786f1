"""Check objects read from a file: kinds of plain values, shapes and ranges of arrays.

A class states the arrays in its files by `LAYOUT`, a dictionary from the path of a
value ("impulses/*": every value of that dictionary) to its shape.  A name in a shape
stands for one number in the whole object, ANY for any number, a number for itself,
Ellipsis for further axes.  A tuple has its length as shape, and None may stand for what
is optional.
`FINITE` names paths of arrays that are finite, `UNIT` those whose rows have length one.
"""

from __future__ import annotations

import numpy as np

ANY = "any"  # number along an axis
UNIT_TOLERANCE = 1e-6  # of the length of a row that should be one
PLAIN = {  # what an annotation admits, of types that JSON and .npz have
    "str": str, "bool": (bool, np.bool_), "dict": dict, "tuple": tuple,
    "int": (int, np.integer), "float": (int, float, np.number),
    "np.ndarray": np.ndarray,
}  # fmt: skip


def check_kinds(kind: type, fields: dict) -> None:
    """Raise TypeError unless the fields of a dataclass are of the annotated kinds."""
    for name, value in fields.items():
        words = str(kind.__dataclass_fields__[name].type)
        admitted = [word.split("[")[0].strip() for word in words.split(" | ")]
        if value is None and "None" in admitted:
            continue
        known = [PLAIN[word] for word in admitted if word in PLAIN]
        others = [word for word in admitted if word not in PLAIN and word != "None"]
        same_name = type(value).__name__ in others or "object" in others
        logical = isinstance(value, bool) and "bool" not in admitted
        plain = any(isinstance(value, one) for one in known) and not logical
        if not (plain or same_name):
            got = type(value).__name__
            raise TypeError(f"{kind.__name__}.{name} is a {got}, expected {words}")


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
            if not off < UNIT_TOLERANCE:
                raise ValueError(f"{kind.__name__}.{where}: lengths {off:.2g} off one")


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
    got = (len(value),) if isinstance(value, tuple) else np.shape(value)
    if isinstance(value, np.ndarray) and value.dtype.kind not in "biuf":
        raise ValueError(f"{where} has dtype {value.dtype}, expected numbers")
    axes = [axis for axis in shape if axis is not Ellipsis]
    fits = len(got) >= len(axes) if Ellipsis in shape else len(got) == len(axes)
    if fits:
        for axis, size in zip(axes, got, strict=False):
            named = isinstance(axis, str) and axis != ANY
            known = sizes.setdefault(axis, size) if named else axis
            fits = fits and known in (size, ANY)
    if not fits:
        expected = ", ".join(
            f"{axis} = {sizes[axis]}" if axis in sizes else str(axis) for axis in shape
        )
        raise ValueError(f"{where} has shape {got}, expected ({expected})")
