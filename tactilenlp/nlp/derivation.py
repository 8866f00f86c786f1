"""A term as expressions, and its exact derivatives.

Of a term v(z, u) that reads roots u of F(u, z) = 0, as whoever poses it notes, with
U = du/dz = -F_u^-1 F_z, multipliers l, and m = -F_u^-T v_u' l,

    dv/dz = v_z + v_u U,     Hessian of l'v:  [1; U]' (l'v + m'F)'' [1; U],

the second derivatives by z and u.  The iteration that finds u is not differentiated; it
is a function of its own, a solver u = s(a) of arguments a(z), which terms share.
"""

from __future__ import annotations

from contextlib import nullcontext
from itertools import islice
from typing import NamedTuple

import casadi as ca

PARTS = ("arguments", "first", "second", "patterns")  # names of the derived functions


class TermExpressions(NamedTuple):
    """A term (z, d, u) -> v, F; (z, d) -> a of its roots; their solver, if any.

    A solver is applied to as many parts of a as there are roots, one after the other.
    """

    at: ca.Function
    arguments: ca.Function
    solver: ca.Function | None


def expressions_of(function, unknowns, order, noting=nullcontext) -> TermExpressions:
    """Return the term `function`; arguments as of TermFunctionCache.of."""
    z = [ca.SX.sym(f"z{i}", n) for i, n in enumerate(unknowns)]
    d = [ca.SX.sym(f"d{i}", n) for i, (role, n) in enumerate(order) if role == "d"]
    zs, ds = iter(z), iter(d)
    with noting() as roots:
        value = function(*(next(zs) if role == "z" else next(ds) for role, _ in order))
    value = ca.densify(ca.vec(ca.SX(value)))
    z, d = ca.vertcat(*z), ca.vertcat(*d)
    roots, value = _merged(roots or [], value)
    solver, argument = _common(roots, ca.vertcat(z, d))
    none = [ca.SX(0, 1)]
    u, residual = (ca.vertcat(*none, *(root[k] for root in roots)) for k in (0, 1))
    return TermExpressions(
        ca.Function("term", [z, d, u], [value, residual]),
        ca.Function("arguments", [z, d], [ca.densify(argument)], {"cse": True}),
        solver,
    )


def _merged(roots: list[tuple], value) -> tuple[list[tuple], ca.SX]:
    """Return the roots of which no two have one equation, and the value of these."""
    most = ca.SX.sym("u", max((root[0].numel() for root in roots), default=0))
    equations = [ca.substitute(F, u, most[: u.numel()]) for u, F, *_ in roots]
    if len(roots) > 1:
        left = iter(ca.cse(ca.vertcat(*equations)).elements())
        equations = [ca.vertcat(*islice(left, F.numel())) for F in equations]
    root_by_equation = {}
    for root, equation in zip(roots, equations, strict=True):
        key = tuple(one.element_hash() for one in equation.elements())
        first = root_by_equation.setdefault(key, root)
        value = ca.substitute(value, root[0], first[0])
    return [*root_by_equation.values()], value


def _common(roots: list[tuple], whole) -> tuple[ca.Function | None, ca.SX]:
    """Return the solver of all roots, and its arguments.

    Roots of several solvers are those of one, whose argument is all that a term reads.
    """
    if not roots:
        return None, ca.SX(0, 1)
    *_, solvers, arguments = zip(*roots, strict=True)
    if len({*solvers}) == 1:
        return solvers[0], ca.vertcat(*arguments)
    found = [one(a) for one, a in zip(solvers, arguments, strict=True)]
    return ca.Function("root", [whole], [ca.vertcat(*found)], {"cse": True}), whole


def values(term: TermExpressions) -> list[ca.Function]:
    """Return `arguments` and `first`, without derivatives."""
    z, d, u = (ca.SX.sym(name, term.at.size1_in(k)) for k, name in enumerate("zdu"))
    return [term.arguments, ca.Function("first", [z, d, u], [term.at(z, d, u)[0]])]


def derivatives(at: ca.Function, arguments: ca.Function) -> list[ca.Function]:
    """Return the functions named in PARTS; their source is part of the compiled key."""
    z, d, u = (ca.SX.sym(name, at.size1_in(k)) for k, name in enumerate("zdu"))
    value, residual = (ca.cse(ca.densify(part)) for part in at(z, d, u))
    multiplier, m = ca.SX.sym("l", value.numel()), ca.SX.sym("m", u.numel())
    lagrangian = ca.dot(multiplier, value)
    jacobian = ca.jacobian(value, z)
    hessian, _ = ca.hessian(lagrangian + ca.dot(m, residual), ca.vertcat(z, u))
    if u.numel():
        by_u = ca.jacobian(residual, u)
        moved = -ca.solve(by_u, ca.jacobian(residual, z))
        jacobian += ca.jacobian(value, u) @ moved
        m_of = -ca.solve(by_u.T, ca.gradient(lagrangian, u))
        hessian = ca.substitute(hessian, m, m_of)
        n = z.numel()
        mixed = hessian[:n, n:] @ moved
        hessian = hessian[:n, :n] + mixed + mixed.T + moved.T @ hessian[n:, n:] @ moved
    hessian = ca.triu(hessian)
    nonzeros = [ca.vertcat(*matrix.nonzeros()) for matrix in (jacobian, hessian)]
    nonzeros = [ca.SX(0, 1) if n.is_empty() else ca.densify(n) for n in nonzeros]
    patterns = [ca.DM(matrix.sparsity(), 1) for matrix in (jacobian, hessian)]
    cse = {"cse": True}
    return [
        arguments,
        ca.Function("first", [z, d, u], [value, nonzeros[0]], cse),
        ca.Function("second", [z, d, u, multiplier], [nonzeros[1]], cse),
        ca.Function("patterns", [], patterns),
    ]
