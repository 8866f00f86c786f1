"""An estimate in words: size, pose, standard deviations, fit, what is not observed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from formulations.names import (
    CENTRE_OF_MASS,
    LATE_NORMALS,
    RADIUS_OF,
    ROUNDED_EDGES,
    SOFT_FINGERTIPS,
)
from formulations.rigid_body import G
from formulations.shape import CUBOID

from ..common.brief import MM_PER_M, MS_PER_S
from ..geometry.faces import has_sides, is_hull
from ..solvers.solution import violation_in_words
from .orientation import orientation_of

WORTH_TELLING = 0.9  # [-] probability of what is told of a quantity taken as given
MIN_WEIGHT = 0.02  # [-] optima of less weight are not listed one by one
LEAST_SHARE = 1e-3  # [-] of evidence that is told in digits


def summary_of(estimate) -> str:
    """Return a paragraph: size, pose, sigma, solve, remarks, what was left out."""
    x, y, z = MM_PER_M * estimate.position[-1]
    a, b, c = MM_PER_M * estimate.information.sigma("position")
    article = "An" if estimate.shape[:1].lower() in "aeiou" else "A"
    lines = [] if estimate.success else [f"NOT SOLVED ({estimate.status})."]
    lines += [
        f"{article} {estimate.shape} of {size_of(estimate)} "
        f"at ({x:.2f}, {y:.2f}, {z:.2f}) mm ± ({a:.2f}, {b:.2f}, {c:.2f}) mm, "
        f"{orientation_of(estimate)}, at the last sample.",
        f"{estimate.formulation}: {estimate.status}, objective "
        f"{estimate.objective:.2f} nats after {estimate.iterations} iterations, "
        f"{estimate.seconds['total']:.1f} CPU s; "
        f"{violation_in_words(estimate.violations)}.",
    ]
    if estimate.information.path is not None:
        off = MM_PER_M * estimate.sigma_position.max(axis=1)
        ends = dict.fromkeys((f"{off.min():.2f}", f"{off.max():.2f}"))
        lines.append(
            f"Along the path the position is known to {' to '.join(ends)} mm (one "
            "standard deviation)."
        )
    lines += remarks_of(estimate)
    lines += [f"Skipped {s}." for s in estimate.skipped]
    return "\n".join(lines)


def headline(estimate) -> str:
    """Return the first line of its summary: what it is, or that it is not solved."""
    return estimate.summary().partition("\n")[0]


def remarks_of(estimate) -> list[str]:
    """Return sentences on classes, fit, nuisance parameters, what is not observed."""
    lines = []
    if estimate.classes:
        lines.append(classes_in_words(estimate.classes))
    if estimate.fit is not None:
        lines.append(estimate.fit.text)
        if estimate.fit.verdict == "bad" and not estimate.classes:
            lines.append('The body may be of another class: shape="auto" compares.')
    lines += nuisances_in_words(estimate)
    if open_ := estimate.information.unobserved:
        lines.append(f"Not observed: {'; '.join(open_)}.")
    lines += untouched_in_words(estimate.measurements)
    if curved := estimate.information.indefinite:
        lines.append(
            "The Hessian of the objective is not positive definite at the solution "
            f"({'; '.join(curved)}): it tells no standard deviation in that direction."
        )
    lines += doubts_in_words(estimate)
    return lines + optima_in_words(estimate.information)


def untouched_in_words(data) -> Iterator[str]:
    """Yield a sentence where no finger touched the body in the last actions."""
    touched = data.action[data.contact.any(axis=1)][-1]
    since = np.unique(data.action[data.action > touched])
    if len(since):
        first, last = since[0], since[-1]
        during = f"action {first}" if first == last else f"actions {first} to {last}"
        yield (
            f"No finger touched the body in {during}: the last pose is that after "
            f"action {touched}, which holds if nothing has moved the body since."
        )


def nuisances_in_words(estimate) -> Iterator[str]:
    """Yield sentences on what was estimated besides shape and pose."""
    ground = estimate.scene.ground
    if ground is not None and ground.told is not None:
        x, y, z = np.degrees(ground.tilt)
        yield (
            "The ground leans against the one that was told, by a rotation of "
            f"({x:.2f}, {y:.2f}, {z:.2f}) deg."
        )
    if estimate.latency and estimate.scene.latency is None:
        sensors = estimate.sensors
        late, error = MS_PER_S * sensors.latency, MS_PER_S * sensors.latency_error
        yield (
            f"Contacts and normals are {late:.0f} ± {error:.0f} ms later than finger "
            "positions: poses are moved on by that time."
        )
    if lag := estimate.sensors.normal_lag:
        error = MS_PER_S * estimate.sensors.normal_lag_error
        late = f"{MS_PER_S * lag:.0f} ± {error:.0f} ms"
        yield f"Normals are {late} later than contacts: they are moved back by that."
    if estimate.compliance is not None:
        yield _compliance(estimate)
    if estimate.finger_turn is not None:
        turns = np.degrees(np.linalg.norm(estimate.finger_turn, axis=1))
        each = (f"finger {f} by {turn:.1f} deg" for f, turn in enumerate(turns))
        yield f"The sensors' normals are turned: {', '.join(each)}."
    if CENTRE_OF_MASS in estimate.unknowns:
        x, y, z = MM_PER_M * estimate.centre_of_mass
        yield (
            f"The centre of mass is off the centroid by ({x:.1f}, {y:.1f}, {z:.1f}) mm "
            "in the axes of the body."
        )
    if estimate.finger_offset is not None:
        C = estimate.information.offsets
        yield offsets_in_words(estimate.finger_offset, C)


def size_of(estimate) -> str:
    """Return the size of the body, with standard deviations."""
    if has_sides(estimate):
        sigma = MM_PER_M * estimate.information.sigma("side_lengths")
        sides = zip(MM_PER_M * estimate.theta, sigma, strict=True)
        return " x ".join(f"{s:.2f} ± {e:.2f}" for s, e in sides) + " mm"
    unknown_sides = estimate.information.names[:3] == CUBOID.words
    if is_hull(estimate) or unknown_sides:
        return _size_of_hull(estimate)
    return ", ".join(map(" ".join, named_sizes(estimate)))


def named_sizes(estimate) -> list[tuple[str, str]]:
    """Return the name and the value in words of each entry of theta."""
    information = estimate.information
    sigma = _sigma_of_names(information)
    sizes = zip(information.names, estimate.theta, sigma, strict=False)
    return [named_size(*size) for size in sizes]


def _sigma_of_names(information) -> np.ndarray:
    """Return the standard deviation (k,) of each of the names, SI."""
    return np.sqrt(np.maximum(np.diag(information.covariance_matrix), 0.0))


def _size_of_hull(estimate) -> str:
    """Return the size of a hull, and how well touched planes are known, in words."""
    touched = np.count_nonzero(estimate.faces)
    extent = MM_PER_M * np.ptp(estimate.vertices, axis=0)
    across = " x ".join(f"{s:.1f}" for s in extent)
    planes = estimate.supporting_planes()
    sigma = MM_PER_M * planes.sigma[planes.touches > 0]
    words = f" to ± {np.median(sigma):.2f} mm (median)" if len(sigma) else ""
    return (
        f"{len(estimate.vertices)} vertices, {across} mm across, {touched} of "
        f"{estimate.faces.size} faces touched{words},"
    )


def named_size(name: str, value: float, sigma: float) -> tuple[str, str]:
    """Return a size in words, in mm unless its name ends with another unit."""
    word, scale, unit = _unit_of(name)
    return word, f"{value * scale:.2f} ± {sigma * scale:.2f} {unit}"


def _unit_of(name: str) -> tuple[str, float, str]:
    """Return the name of a number without its unit, how many of this are one of SI."""
    word, bracket, unit = name.partition(" [")
    if bracket:
        return word, 1.0, unit[:-1]
    return (word, 180 / np.pi, "deg") if "rotation" in word else (word, MM_PER_M, "mm")


def classes_in_words(classes) -> str:
    """Return the odds of the classes of shapes that were compared."""
    odds = [
        f"{one.shape} has {share_in_words(one.probability)}"
        for one in classes if not one.error
    ]  # fmt: skip
    failed = [
        f" {one.shape.capitalize()} could not be estimated: {one.error}."
        for one in classes if one.error
    ]  # fmt: skip
    words = "No class has evidence."
    if odds:
        words = f"Of the classes compared, {', '.join(odds)} of the evidence."
    return words + "".join(failed)


def share_in_words(share: float) -> str:
    """Return a probability in percent, a small one as less than LEAST_SHARE."""
    if 0 < share < LEAST_SHARE:
        return f"less than {100 * LEAST_SHARE:.1g} %"
    return f"{100 * share:.3g} %"


def offsets_in_words(offset, C) -> str:
    """Return offsets (F, 3) [m] of fingers, with their deviations; C: covariance."""
    each = []
    for f, sigma in enumerate(np.sqrt(np.diag(C)).reshape(-1, 3)):
        pairs = zip(MM_PER_M * offset[f], MM_PER_M * sigma, strict=True)
        by = ", ".join(f"{way:.1f} ± {error:.1f}" for way, error in pairs)
        each.append(f"finger {f} by ({by}) mm")
    return "Fingers are off their measured positions: " + "; ".join(each) + "."


def doubts_in_words(estimate) -> list[str]:
    """Return sentences on what was taken as given and is not so, as the touches say.

    What was estimated, as latencies, has sentences of its own.
    """
    lines, radii, considered = [], [], estimate.information.considered
    told = {n: c for n, c in considered.items() if c.probability > WORTH_TELLING}
    for name, (off, sigma, _) in told.items():
        size, error = MM_PER_M * abs(off), MM_PER_M * sigma
        if name == ROUNDED_EDGES:
            lines.append(f"The edges are rounded by {size:.1f} ± {error:.1f} mm.")
        elif name == SOFT_FINGERTIPS:
            by = f"{size:.1f} ± {error:.1f} mm under the object's weight"
            lines.append(f"Fingertips yield by {by}.")
        elif name == LATE_NORMALS and not estimate.sensors.normal_lag:
            late = f"{MS_PER_S * abs(off):.0f} ± {MS_PER_S * sigma:.0f} ms"
            lines.append(f"Normals are {late} later than contacts.")
        elif name.startswith(RADIUS_OF):
            side = "larger" if off > 0 else "smaller"
            radii.append(f"the {name} is {size:.2f} ± {error:.2f} mm {side}")
    if radii:
        lines.append(f"The touches fit one body if {' or '.join(radii)} than was told.")
    return [f"{line} Sigma allows for it." for line in lines]


def optima_in_words(information) -> list[str]:
    """Return sentences: the probability of what is reported and of each other optimum.

    Optima that differ by no more than the standard deviations count as what is
    reported.  Empty where there is no other one; percentages sum to 100.
    """
    modes, names = information.modes, information.names
    sigma = _sigma_of_names(information)
    alike = (np.abs(modes.offsets) <= sigma).all(axis=1)
    other = np.flatnonzero((modes.weights >= MIN_WEIGHT) & ~alike)
    if not len(other):
        return []
    listed = np.r_[modes.weights[alike].sum(), modes.weights[other]]
    shares = whole_percentages(np.r_[listed, max(1 - listed.sum(), 0.0)])
    words = [f"What is reported has a probability of {shares[0]} %."]
    for share, off in zip(shares[1:-1], modes.offsets[other], strict=True):
        most = np.argsort(np.abs(off) / np.where(sigma > 0, sigma, 1.0))[::-1][:2]
        parts = [_larger(names[i], off[i]) for i in most]
        words.append(f"With {share} %, {' and '.join(parts)}.")
    if shares[-1]:
        words.append(f"All other optima together have {shares[-1]} %.")
    return words


def _larger(name: str, by: float) -> str:
    """Return in words by what a number differs: in the unit of its name, [m], [rad]."""
    word, scale, unit = _unit_of(name)
    way = "larger" if by > 0 else "smaller"
    return f"{word} is {abs(by) * scale:.1f} {unit} {way}"


def whole_percentages(probabilities) -> list[int]:
    """Return percentages, whole numbers that add up to 100 (largest remainders)."""
    exact = 100 * np.asarray(probabilities) / np.sum(probabilities)
    whole = np.floor(exact).astype(int)
    most = np.argsort(whole - exact, kind="stable")[: 100 - whole.sum()]
    whole[most] += 1
    return whole.tolist()


def _compliance(estimate) -> str:
    """Return a sentence on how soft the fingertips are."""
    force = estimate.scene.mass * G  # [N] the weight of the object on Earth
    depth = MM_PER_M * estimate.compliance * force
    words = f"Fingertips are soft: they yield {depth:.2f} mm under {force:.1f} N"
    radius = MM_PER_M * estimate.measurements.finger_radius.min()
    if depth < radius:
        return f"{words}."
    return (
        f"{words}, more than their radius of {radius:.1f} mm, which no fingertip does: "
        "are radius, height of the ground, centres and missing positions right?"
    )
