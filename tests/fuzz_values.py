"""Hostile values, and changes of good ones, drawn from a seeded generator."""

from __future__ import annotations

import decimal
import fractions
import math
from pathlib import Path
from types import SimpleNamespace

import casadi as ca
import numpy as np
import scipy.sparse as sp

WORDS = (
    "", "x", "nan", "1e5", "finger0", "\0", "\ud800", "../..", "n" * 10_000, "%s{0}",
    "cuboid", "polytope", "eig", "auto", "é",
)  # fmt: skip
INTEGERS = (
    *(0, 1, -1, 2, 3, 7, 255, 2**31, -(2**31), 2**63, 2**63 + 1, 2**64, -(2**70)),
    *(10**30, 10**400, -(10**400), 10**5000),
)
FLOATS = (
    *(0.0, -0.0, 1.0, -1.0, 0.5, math.nan, math.inf, -math.inf, 1e300, -1e300, 1e-12),
    *(1e-300, 5e-324, 1e6, 50.0, 1e19),
)
DTYPES = (
    *("?", "i1", "u1", "i4", "i8", "u8", "f2", "f4", "f8", "g", "c8", "c16"),
    *("U3", "S3", "O", "m8[s]", "M8[s]", "V4", "i4,f8"),
)
SHAPES = ((), (0,), (1,), (2,), (3,), (4,), (2, 3), (3, 3), (0, 3), (4, 2, 3), (1, 1))
DEEP = 200  # lists within lists


class Spiteful:
    """An object whose words, length, entries and truth cannot be asked for."""

    def _refuse(self, *_):
        raise ValueError("spite")

    __repr__ = __str__ = __len__ = __getitem__ = __iter__ = __bool__ = _refuse
    __float__ = __array__ = __hash__ = __eq__ = _refuse


class Several(int):
    """An integer of a class of its own."""


def array(rng) -> np.ndarray:
    """Return an array of any dtype and shape, with odd numbers where it has numbers."""
    dtype, shape = np.dtype(pick(rng, DTYPES)), pick(rng, SHAPES)
    with np.errstate(all="ignore"):
        if dtype.kind in "fc":
            values = rng.choice([0, 1, -1, math.nan, math.inf, 1e300, 1e-300], shape)
            made = np.asarray(values, "f8").astype(dtype)
        elif dtype.kind in "iub":
            made = np.asarray(rng.integers(0, 3, shape)).astype(dtype)
        elif dtype.kind == "O":
            made = np.full(shape, pick(rng, (None, "x", 1.0)), object)
        else:
            made = np.zeros(shape, dtype)
    if rng.random() < 0.1 and dtype.kind in "fi":
        return np.ma.masked_equal(made, 1)
    return made


def recursive() -> list:
    """Return a list that contains itself."""
    made: list = [1.0]
    made.append(made)
    return made


def deep(levels: int = DEEP) -> list:
    """Return lists within lists."""
    made: list = [0.5]
    for _ in range(levels):
        made = [made]
    return made


MAKERS = (
    lambda rng: None,
    lambda rng: bool(rng.integers(2)),
    lambda rng: pick(rng, INTEGERS),
    lambda rng: pick(rng, FLOATS),
    lambda rng: float(rng.normal() * 10.0 ** rng.integers(-6, 6)),
    lambda rng: int(rng.integers(-5, 50)),
    lambda rng: pick(rng, WORDS),
    lambda rng: pick(rng, WORDS).encode(errors="replace"),
    lambda rng: complex(1, 1),
    lambda rng: fractions.Fraction(1, 3),
    lambda rng: decimal.Decimal("0.5"),
    lambda rng: np.timedelta64(3, "s"),
    lambda rng: np.datetime64("2020-01-01"),
    lambda rng: np.float32(pick(rng, FLOATS[:8])),
    lambda rng: np.longdouble("1e4000"),
    lambda rng: np.bool_(True),
    lambda rng: np.uint64(2**63 + 1),
    lambda rng: np.str_("x"),
    array,
    array,
    array,
    lambda rng: [anything(rng) for _ in range(rng.integers(0, 4))],
    lambda rng: tuple(pick(rng, FLOATS) for _ in range(rng.integers(0, 5))),
    lambda rng: [[1.0], [2.0, 3.0]],
    lambda rng: {"a": 1, 2: "b"},
    lambda rng: {"x"},
    lambda rng: range(3),
    lambda rng: (k for k in (1, 2)),
    lambda rng: lambda *a, **k: None,
    lambda rng: SimpleNamespace(time=[0, 1], finger_position=None),
    lambda rng: object(),
    lambda rng: Spiteful(),
    lambda rng: Several(2),
    lambda rng: int,
    lambda rng: math,
    lambda rng: Path("nowhere"),
    lambda rng: sp.identity(3),
    lambda rng: ca.DM([1, 2, 3]),
    lambda rng: ca.SX.sym("x", 3),
    lambda rng: recursive(),
    lambda rng: deep(),
    lambda rng: memoryview(b"abc"),
    lambda rng: NotImplemented,
    lambda rng: ...,
)


def pick(rng, options):
    """Return one of a sequence."""
    return options[int(rng.integers(len(options)))]


def anything(rng):
    """Return a value of any kind."""
    return pick(rng, MAKERS)(rng)


def changed(value, rng):
    """Return a good value, changed a little, or anything at all."""
    number = isinstance(value, float | int) and not isinstance(value, bool)
    listed = isinstance(value, tuple | list) and len(value) > 0
    if rng.random() < 0.4:
        return anything(rng)
    if isinstance(value, np.ndarray) or (listed and _numeric(value)):
        return changed_array(np.asarray(value), rng)
    if number:
        return value * pick(rng, (-1, 0, 2, 1e-3, 1e3, 1e-9, 1e9, math.nan))
    if isinstance(value, dict) and value:
        key = pick(rng, list(value))
        return {**value, key: changed(value[key], rng)}
    if listed:
        k = int(rng.integers(len(value)))
        swapped = [*value[:k], changed(value[k], rng), *value[k + 1 :]]
        return type(value)(swapped)
    return anything(rng)


def _numeric(value) -> bool:
    return all(isinstance(entry, float | int) for entry in value)


def changed_array(value: np.ndarray, rng):
    """Return an array with another dtype, shape, or odd entries."""
    with np.errstate(all="ignore"):
        return pick(rng, ARRAY_CHANGES)(value, rng)


def _with_entry(value, rng):
    if not value.size or value.dtype.kind not in "iufb":
        return value
    odd = pick(rng, FLOATS)
    made = value.astype(float if value.dtype.kind != "f" else value.dtype)
    made[np.unravel_index(int(rng.integers(value.size)), value.shape)] = odd
    return made


def _as_dtype(value, rng):
    try:
        return value.astype(pick(rng, DTYPES))
    except (TypeError, ValueError, OverflowError):
        return value


ARRAY_CHANGES = (
    _with_entry,
    _with_entry,
    _as_dtype,
    lambda v, rng: v.T,
    lambda v, rng: v.ravel(),
    lambda v, rng: v[:-1] if v.ndim else v,
    lambda v, rng: v[:0] if v.ndim else v,
    lambda v, rng: v[..., :-1] if v.ndim else v,
    lambda v, rng: v[None],
    lambda v, rng: v[::-1] if v.ndim else v,
    lambda v, rng: np.concatenate([v, v]) if v.ndim else v,
    lambda v, rng: v.tolist(),
    lambda v, rng: v * 1000 if v.dtype.kind in "iuf" else v,
    lambda v, rng: v * 0 if v.dtype.kind in "iuf" else v,
    lambda v, rng: v * 1e300 if v.dtype.kind == "f" else v,
    lambda v, rng: np.ma.masked_array(v, mask=np.ones(v.shape, bool)),
    lambda v, rng: np.asfortranarray(v),
    lambda v, rng: np.zeros_like(v),
    lambda v, rng: np.broadcast_to(v, (2, *v.shape)),
)
