"""Compare derivatives with central differences.

One local unknown is moved at a time, in all instances of a term at once, so that the
comparison costs about as much as a few iterations.  Steps are in scaled units.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .terms import Term

if TYPE_CHECKING:
    from .problem import Problem

DIFFERENCE_STEP = 6e-6  # [scales] of differences: cube root of a double's precision
ROUNDING_SHARE = 1e-4  # [-] of a value is no derivative: 11 of 16 digits are lost
NO_CHANGE = 1e-12  # [-] change over one scale of an unknown that no difference resolves
TOLERATED = 1e-4  # [-] relative error above which a derivative is called wrong


def derivative_errors(
    problem: Problem, term: Term, x, data, rng
) -> tuple[float, float]:
    """Return the relative error of Jacobian and Hessian of a term, over all instances.

    Relative to the largest entry of its instance, or to a ten-thousandth of the largest
    of all.  What two widths of a difference disagree about is the difference's error.
    """
    function = term.function
    z, d = x[term.unknowns].T, data[term.data].T
    scale = problem.scale[term.unknowns].T
    weight = rng.normal(size=(function.rows, term.instances))
    value, *exact = _scaled(function, z, d, weight, scale)
    fine, wide = (
        _differences(function, z, d, weight, scale, k * DIFFERENCE_STEP) for k in (1, 2)
    )
    errors, size = [], np.abs(value).max(axis=0)
    for derivative, near, far in zip(exact, fine, wide, strict=True):
        largest = np.abs(derivative).max(axis=(0, 1), initial=0.0)
        size = ROUNDING_SHARE * (size + largest.max(initial=0.0)) + largest
        unsure = np.abs(near - far).max(initial=0.0)
        off = np.abs(near - derivative).max(axis=(0, 1), initial=0.0)
        errors.append(_worst(off, size + unsure / TOLERATED))
    return tuple(errors)


def _differences(function, z, d, weight, scale, width):
    """Return central differences of value (r, n, k) and gradient (n, n, k), scaled."""
    slope = np.empty((function.rows, *z.shape))
    bend = np.empty((len(z), *z.shape))
    for j in range(len(z)):
        step = np.zeros_like(z)
        step[j] = width * scale[j]
        (v, s, _), (v_1, s_1, _) = (
            _scaled(function, z + side * step, d, weight, scale, second=False)
            for side in (1, -1)
        )
        taken = ((z[j] + step[j]) - (z[j] - step[j])) / scale[j]
        slope[:, j] = (v - v_1) / taken
        bend[:, j] = np.einsum("rk,rjk->jk", weight, s - s_1) / taken
    return slope, bend


def _scaled(function, z, d, weight, scale, second=True):
    """Return value (r, k), Jacobian (r, n, k), weighted Hessian (n, n, k), scaled."""
    value, nonzeros = function.evaluated("first", z, d)
    i, j = (np.array(p, int) for p in function.jacobian_sparsity.get_triplet())
    jacobian = np.zeros((function.rows, *z.shape))
    jacobian[i, j] = nonzeros * scale[j]
    hessian = np.zeros((len(z), *z.shape))
    if second:
        i, j = (np.array(p, int) for p in function.hessian_sparsity.get_triplet())
        upper = function.evaluated("second", z, d, weight)[0]
        hessian[i, j] = hessian[j, i] = upper * scale[i] * scale[j]
    return value, jacobian, hessian


def assembled_error(problem: Problem, x, data, rng) -> float:
    """Return the relative error of the assembled derivatives along one direction."""
    of, x = problem.assembly, x / problem.scale
    lam, way = rng.normal(size=problem.rows), rng.normal(size=x.size)
    (_, grad, *_), J = of.evaluated(x, data), of.slopes(x, data)
    exact = grad @ way, J @ way, of.curvature(x, data, 1.0, lam) @ way
    ends = []
    for y in (x + DIFFERENCE_STEP * way, x - DIFFERENCE_STEP * way):
        cost, g = of.value(y, data)
        ends.append((cost, g, of.lagrangian(y, data, lam)[0]))
    worst = 0.0
    for plus, minus, product in zip(*ends, exact, strict=True):
        size = np.abs(product).max(initial=0.0)
        size += ROUNDING_SHARE * np.abs(plus).max(initial=0.0)
        off = np.abs((plus - minus) / (2 * DIFFERENCE_STEP) - product)
        worst = max(worst, _worst(off.max(initial=0.0), size))
    return worst


def _worst(error, size) -> float:
    """Return the largest error / size; infinite where a number is not finite."""
    ratio = np.where(error > 0, error / np.where(size > 0, size, 1.0), error)
    return float(np.where(np.isfinite(ratio), ratio, np.inf).max(initial=0.0))


def not_finite(problem, x, data, place: str):
    """Yield a sentence for each term that is not finite at x, which is called `place`.

    x (unknowns,) SI; data: of all parameters, as Problem.data returns it.
    """
    for name, term in problem.terms.items():
        value = problem.value(name, x, data)
        slope = problem.jacobian(name, x, data)
        bend = problem.hessian(name, x, data)
        bad = np.argwhere(~np.isfinite(value))
        if len(bad):
            yield f'"{name}" is not finite at {place}, first at instance {bad[0, 0]}'
        elif not (np.isfinite(slope.data).all() and np.isfinite(bend.data).all()):
            yield (
                f'"{name}" has {term.instances} finite values at {place} but no '
                "derivatives: round roots and norms where they can be zero"
            )


def flat_terms(problem, points, data):
    """Yield the names of terms whose derivatives vanish at all points, in scales."""
    for name in problem.terms:
        slopes = (abs(problem.jacobian(name, p, data)) @ problem.scale for p in points)
        if max(s.max(initial=0.0) for s in slopes) < NO_CHANGE:
            yield name
