"""C source of functions that evaluate several instances of a term at once (SIMD).

A term's function has no branch: each operation of CasADi's scalar expression becomes
one on vectors, a number for each of WIDTH instances, by the vector extension of GCC and
Clang.  Arguments and results are matrices with a column for each instance.  The digits
are those of one instance at a time: the same operations in the same order.  A function
that such a function calls, as often as it likes, becomes one of C's, written once.

A library exports what CasADi loads as external functions: name, name_n_in, ....
"""

from __future__ import annotations

import math
import platform
from collections.abc import Callable
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np

WIDTH = 8  # instances: a vector of 512 bits, or two to four smaller ones
# Vectors of more operations leave the caches: those of a hull's balance, 69 000, are
# hardly faster on 32 instances, and compilation takes twice the time.
MOST_OPERATIONS = 18_000
WRITTEN = {
    "ASSIGN": "{0}",
    "NEG": "-{0}",
    "SQ": "{0} * {0}",
    "TWICE": "2.0 * {0}",
    "INV": "1.0 / {0}",
    "ADD": "{0} + {1}",
    "SUB": "{0} - {1}",
    "MUL": "{0} * {1}",
    "DIV": "{0} / {1}",
    "LT": "one_if({0} < {1})",
    "LE": "one_if({0} <= {1})",
    "EQ": "one_if({0} == {1})",
    "NE": "one_if({0} != {1})",
    "NOT": "one_if({0} == 0.0)",
    "AND": "one_if(({0} != 0.0) & ({1} != 0.0))",
    "OR": "one_if(({0} != 0.0) | ({1} != 0.0))",
    "IF_ELSE_ZERO": "(vector)(({0} != 0.0) & (mask){1})",
    "FABS": "(vector)((mask){0} & 0x7fffffffffffffffLL)",
    "FMIN": "chosen(({0} < {1}) | ({1} != {1}), {0}, {1})",
    "FMAX": "chosen(({0} > {1}) | ({1} != {1}), {0}, {1})",
    "SIGN": "chosen(({0} > 0.0) | ({0} < 0.0), "
    "one_if({0} > 0.0) - one_if({0} < 0.0), {0})",  # of 0 and NaN: themselves
    "CONSTPOW": "each_pow({0}, {1})",
}
# Functions of math.h, called for each instance.
UNARY = (
    "SQRT", "EXP", "LOG", "SIN", "COS", "TAN", "ASIN", "ACOS", "ATAN", "SINH", "COSH",
    "TANH", "ASINH", "ACOSH", "ATANH", "FLOOR", "CEIL", "ERF", "LOG1P", "EXPM1",
)  # fmt: skip
BINARY = ("POW", "FMOD", "COPYSIGN", "ATAN2", "HYPOT", "REMAINDER")
TYPES = f"""
#include <math.h>
typedef double vector __attribute__((vector_size({8 * WIDTH})));
typedef long long mask __attribute__((vector_size({8 * WIDTH})));
typedef long long integer;
static inline vector one_if(mask which) {{
  vector one = {{0}};
  one = one + 1.0;
  return (vector)(which & (mask)one);
}}
static inline vector chosen(mask which, vector a, vector b) {{
  return (vector)((which & (mask)a) | (~which & (mask)b));
}}
#define EACH __attribute__((noinline, optimize("O3", "no-math-errno"))) static vector
"""


@cache
def processor() -> str:
    """Return the architecture, and on Linux the processor's features.

    By these a library differs that is made for the processor of its machine.
    """
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    features = {line for line in lines if line.startswith(("flags", "Features"))}
    return " ".join([platform.machine(), *sorted(features)])


def own_flags() -> tuple[str, ...]:
    """Return the compiler's flags for all vector operations that the processor has.

    Empty where libraries of different processors could not be told apart.
    """
    return ("-march=native",) if processor() != platform.machine() else ()


def can_be_vectors(function: ca.Function) -> bool:
    """Tell whether a function has scalar operations on dense columns, and not many."""
    if not function.is_a("SXFunction") or function.n_instructions() > MOST_OPERATIONS:
        return False
    called = _called(function)
    if len(called) > 1 or not all(map(can_be_vectors, called)):
        return False
    given = [function.sparsity_in(k) for k in range(function.n_in())]
    found = [function.sparsity_out(k) for k in range(function.n_out())]
    columns = all(s.is_dense() and s.size2() == 1 for s in given + found)
    numbers = range(function.n_instructions())
    known = _written().keys() | {ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST, ca.OP_CALL}
    return bool(given) and columns and known >= {*map(function.instruction_id, numbers)}


def vector_source(functions: list[ca.Function]) -> str:
    """Return the C source of a library of functions that `can_be_vectors`."""
    if not functions:
        return ""
    called = [_of_each(name, "a") for name in UNARY]
    called += [_of_each(name, "a", "b") for name in BINARY]
    return "\n".join([TYPES, *called, *map(_exported, functions)])


@cache
def _written() -> dict[int, str]:
    """Return C expressions of operands {0}, {1} by CasADi's number of an operation."""
    called = {name: f"each_{name.lower()}({{0}})" for name in UNARY}
    called |= {name: f"each_{name.lower()}({{0}}, {{1}})" for name in BINARY}
    return {getattr(ca, f"OP_{k}"): text for k, text in {**called, **WRITTEN}.items()}


def _of_each(name: str, *operands: str) -> str:
    """Return the C function that applies another one to each entry of vectors."""
    given = ", ".join(f"vector {one}" for one in operands)
    read = ", ".join(f"{one}[k]" for one in operands)
    each = f"for (int k = 0; k < {WIDTH}; ++k) a[k] = {name.lower()}({read});"
    return f"EACH each_{name.lower()}({given}) {{ {each} return a; }}"


def _called(function: ca.Function) -> list[ca.Function]:
    """Return the functions that a function calls by itself."""
    return function.find_functions(0)


def _exported(function: ca.Function) -> str:
    """Return the function and what CasADi asks a library about it."""
    name = function.name()
    given = [function.size1_in(k) for k in range(function.n_in())]
    found = [function.size1_out(k) for k in range(function.n_out())]

    def read(k, row):
        numbers = [f"x[{k}][{row + given[k] * one}]" for one in range(WIDTH)]
        return f"{{{', '.join(numbers)}}}"

    def write(k, row, value):
        each = f"y[{k}][{row} + {found[k]} * k] = {value}[k]"
        return f"if (y[{k}]) for (int k = 0; k < {WIDTH}; ++k) {each};"

    return "\n".join([
        *(_internal(one, f"{name}_calls") for one in _called(function)),
        f"int {name}(const double** x, double** y, integer* iw, double* w, int mem) {{",
        *_statements(function, name, read, write), "return 0; }",
        *_sizes(f"{name}_%s_in", given), *_sizes(f"{name}_%s_out", found),
        f"int {name}_work(integer* x, integer* y, integer* iw, integer* w) {{",
        f"*x = {len(given)}; *y = {len(found)}; *iw = *w = 0; return 0; }}",
    ])  # fmt: skip


def _internal(function: ca.Function, name: str) -> str:
    """Return a function that is called: of all numbers x, to all numbers y."""
    given = np.cumsum([0, *map(function.size1_in, range(function.n_in()))])
    found = np.cumsum([0, *map(function.size1_out, range(function.n_out()))])

    def read(k, row):
        return f"x[{given[k] + row}]"

    def write(k, row, value):
        return f"y[{found[k] + row}] = {value};"

    return "\n".join([
        *(_internal(one, f"{name}_calls") for one in _called(function)),
        f"static void {name}(const vector* x, vector* y) {{",
        *_statements(function, name, read, write), "}",
    ])  # fmt: skip


def _sizes(name: str, rows: list[int]) -> list[str]:
    """Return how many arguments there are, and their patterns, in CasADi's form."""
    patterns = ", ".join(f"{{{n}, {WIDTH}, 1}}" for n in rows)  # 1: dense
    return [
        f"integer {name % 'n'}(void) {{ return {len(rows)}; }}",
        f"const integer* {name % 'sparsity'}(integer k) {{",
        f"static const integer of[][3] = {{{patterns}}}; return of[k]; }}",
    ]


def _statements(function: ca.Function, name: str, read: Callable, write: Callable):
    """Yield the C statements; v<k>: the latest value of CasADi's work vector there.

    name: that of the function in C; read(k, row): the expression of a number that is
    given; write(k, row, value): the statement that makes one a result.
    """
    at: dict[int, str] = {}  # the variable of each place of the work vector
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        places, written = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            yield write(*written, at[places[0]])
            continue
        if operation == ca.OP_CALL:
            yield f"vector a{k}[] = {{{', '.join(at[place] for place in places)}}};"
            yield f"vector v{k}[{len(written)}]; {name}_calls(a{k}, v{k});"
            at |= {place: f"v{k}[{row}]" for row, place in enumerate(written)}
            continue
        if operation == ca.OP_INPUT:
            value = read(*places)
        elif operation == ca.OP_CONST:
            numbers = [_number(function.instruction_constant(k))] * WIDTH
            value = f"{{{', '.join(numbers)}}}"
        else:
            value = _written()[operation].format(*(at[place] for place in places))
        at[written[0]] = f"v{k}"
        yield f"const vector v{k} = {value};"


def _number(value: float) -> str:
    if math.isfinite(value):
        return repr(value)
    return "NAN" if math.isnan(value) else "INFINITY" if value > 0 else "-INFINITY"
