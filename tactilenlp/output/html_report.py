"""Write an estimate as one HTML page, which needs no network and no server."""

from __future__ import annotations

import json
import math
import os
from importlib.resources import files
from pathlib import Path

import numpy as np

from ..common.brief import MM_PER_M
from ..common.validation import check_path, check_types
from ..common.whole_file import write_whole
from ..geometry.faces import face_sigma, has_sides, is_hull, polygons
from ..solvers.solution import violation_in_words
from .colours import BLUE, FINGER_RGB, PALE, RED, information_colour
from .export import check_format
from .orientation import is_level, sigma_of_yaw, yaw_of
from .summary import headline, named_sizes

REACH_FACTOR = 1.5  # [-] radius of the picture over that of the object
GROUND_LINES = 8  # [1] lines of the ground's grid to each side
GROUND_SPACING = 0.02  # [m] between them
ARROW_SHARE = 0.35  # [-] largest impulse's arrow over the radius of the picture
QUANTITIES = {  # words, unit, and how many of it are one of SI
    "side_lengths": ("side", "mm", MM_PER_M),
    "position": ("position", "mm", MM_PER_M),
    "rotation": ("rotation about", "deg", np.degrees(1.0)),
}
WORST_TOUCHES = 4  # [1] fingers in actions that the table of the fit lists


def write_report(estimate, path: str | os.PathLike) -> None:
    """Write a page with the motion, measurements, standard deviations and costs.

    Raises OptionError unless the path ends with .html or .htm.
    """
    check_types(estimate=(estimate, "Estimate"))
    check_path(path)
    check_format(Path(path), (".html", ".htm"))
    template = files("tactilenlp.output").joinpath("report.html")
    page = template.read_text(encoding="utf-8")
    content = _with_null(_content(estimate))
    content = json.dumps(content, separators=(",", ":"), allow_nan=False)
    # No text of an estimate may open or close a tag.
    page = page.replace("{{DATA}}", content.replace("<", "\\u003c"))
    write_whole(path, page)


def _content(estimate) -> dict:
    """Return what the page shows, as numbers, strings and lists."""
    data = estimate.measurements
    centre, reach = _frame(estimate)
    pushes = [estimate.impulses[f"finger {f}"] for f in range(data.fingers)]
    sigma = None  # (T, 3) [m] of the position, where it is known
    if estimate.information.path is not None:
        sigma = _plain(estimate.sigma_position, 6)
    most = max((np.linalg.norm(push, axis=1).max() for push in pushes), default=0.0)
    return {
        "title": f"Estimated {estimate.shape}",
        "subtitle": headline(estimate),
        "time": _plain(data.time, 3),
        "action": data.action.tolist(),
        "position": _plain(estimate.position),
        "position_sigma": sigma,
        "quaternion": _plain(estimate.quaternion, 6),
        "vertices": _plain(estimate.vertices),
        "faces": _faces(estimate),
        "finger": [_finger(estimate, f) for f in range(data.fingers)],
        "touches": _touches(estimate),
        "grid": _grid(estimate, centre),
        "centre": _plain(centre),
        "reach": reach,
        "bar": 0.02,
        "arrow": ARROW_SHARE * reach / most if most > 0 else 0.0,
        "ramp": [BLUE, PALE, RED],
        "sigma": _sigma(estimate),
        "costs": sorted(estimate.costs.items(), key=_descending),
        "objective": f"{estimate.objective:.2f} nats",
        "remarks": estimate.remarks,
        "fit": _fit(estimate.fit),
        "solve": _solve(estimate),
        "skipped": [str(skipped) for skipped in estimate.skipped],
    }


def _finger(estimate, f: int) -> dict:
    """Return path, contacts and impulses of a finger."""
    data = estimate.measurements
    return {
        "position": _plain(estimate.seen_positions[:, f]),
        "radius": float(data.finger_radius[f]),
        "contact": data.contact[:, f].tolist(),
        "valid": data.valid[:, f].tolist(),
        "impulse": _plain(estimate.impulses[f"finger {f}"]),
        "colour": FINGER_RGB[f % len(FINGER_RGB)],
    }


def _plain(values, digits: int = 5) -> list:
    """Return lists of rounded numbers, a third of the size of the exact ones."""
    return np.round(np.asarray(values, float), digits).tolist()


def _with_null(content):
    """Return the content with None, null in JSON, for numbers that are not finite."""
    if isinstance(content, dict):
        return {name: _with_null(value) for name, value in content.items()}
    if isinstance(content, (list, tuple)):
        return [_with_null(value) for value in content]
    number = isinstance(content, float)
    return None if number and not math.isfinite(content) else content


def _descending(cost: tuple[str, float]) -> float:
    """Return the key that sorts costs by size, those first that are not finite."""
    return -abs(cost[1]) if math.isfinite(cost[1]) else -math.inf


def _frame(estimate) -> tuple[np.ndarray, float]:
    """Return centre (3,) and radius [m] of a picture that holds the whole motion."""
    low, high = estimate.position.min(axis=0), estimate.position.max(axis=0)
    size = np.linalg.norm(estimate.vertices, axis=1).max()
    return (low + high) / 2, float(np.linalg.norm(high - low) / 2 + REACH_FACTOR * size)


def _faces(estimate) -> list[dict]:
    """Return corners, normal and colour of every face; the colour tells its sigma."""
    return [
        {
            "corners": corners.tolist(),
            "normal": _plain(normal, 6),
            "colour": information_colour(sigma).tolist(),
        }
        for (corners, normal), sigma in zip(
            polygons(estimate.vertices), face_sigma(estimate), strict=True
        )
    ]


def _touches(estimate) -> list[dict]:
    """Return every contact: sample, finger, point and normal in the body frame."""
    points, normals = estimate.contacts()
    return [
        {
            "sample": int(t),
            "finger": int(f),
            "point": _plain(points[t, f]),
            "normal": _plain(normals[t, f]),
        }
        for t, f in np.argwhere(estimate.measurements.contact)
    ]


def _grid(estimate, centre) -> list:
    """Return the lines of the ground under the object, each as two points."""
    ground = estimate.scene.ground
    if ground is None:
        return []
    middle = np.round(ground.to_ground(centre)[:2] / GROUND_SPACING) * GROUND_SPACING
    steps = np.arange(-GROUND_LINES, GROUND_LINES + 1) * GROUND_SPACING
    far = GROUND_LINES * GROUND_SPACING
    along = [[[s, -far, 0], [s, far, 0]] for s in steps]
    lines = np.array(along + [[[-far, s, 0], [far, s, 0]] for s in steps])
    return _plain(ground.from_ground(lines + np.array([*middle, 0.0])))


def _sigma(estimate) -> list[list[str]]:
    """Return name, value and standard deviation of each quantity, in words."""
    rows, information = [], estimate.information
    where = {"position": estimate.position[-1]}
    if has_sides(estimate):
        where["side_lengths"] = estimate.theta
    planar = estimate.reductions["planar"]  # else all axes of rotation are alike
    if planar and is_level(estimate):
        where["rotation"] = np.array([0.0, 0.0, yaw_of(estimate)])
    if not {"side_lengths", "vertices"} & {*information.maps}:
        rows += [[*size] for size in named_sizes(estimate)]
    for name, (quantity, unit, factor) in QUANTITIES.items():
        if name not in information.maps:
            continue
        values = where.get(name, (None,) * 3)
        for axis, value, s in zip("xyz", values, information.sigma(name), strict=True):
            words = f"± {s * factor:.2f} {unit}" if np.isfinite(s) else "± unobserved"
            words = "fixed by a reduction" if np.isnan(s) else words
            words = "held: the axes are the world's" if s == 0.0 else words
            if name in where and (name != "rotation" or s > 0.0):
                words = f"{value * factor:.2f} {words}"
            rows.append([f"{quantity} {axis}", words])
        if causes := _largest_errors(information, name):
            rows.append([f"largest error: {causes}", ""])  # the first cell wraps
    if planar and not is_level(estimate) and not is_hull(estimate):
        turn, sigma = np.degrees([yaw_of(estimate), sigma_of_yaw(estimate)])
        words = f"{turn:.2f} ± {sigma:.2f} deg"
        rows.append(["rotation about the ground's normal", words])
    return rows


def _largest_errors(information, name: str) -> str:
    """Return the errors that add most to sigma of some axis, "" where none is known."""
    errors = information.error_budget(name) if information.budget else {}
    sigma, axes = np.nan_to_num([*errors.values()]).reshape(-1, 3).T, {}
    for axis, by_error in zip("xyz", sigma, strict=True):
        if by_error.any():
            axes.setdefault([*errors][np.argmax(by_error)], []).append(axis)
    return ", ".join(f"{error} ({', '.join(axes[error])})" for error in axes)


def _fit(fit) -> dict | None:
    """Return the verdict, and actual and expected nats by term and by touch, worst."""
    if fit is None:
        return None
    named = [*fit.terms.items(), ("all terms", fit.total)]
    named += [
        (f"touches of finger {touch.finger} in action {touch.action}", touch.misfit)
        for touch in fit.touches[:WORST_TOUCHES]
    ]
    rows = [
        [name, f"{one.actual:.1f}", f"{one.expected:.1f} ± {one.spread:.1f}"]
        for name, one in named
    ]
    return {"verdict": fit.verdict, "rows": rows}


def _solve(estimate) -> list[list[str]]:
    """Return the rows of the table about the solve."""
    return [
        ["formulation", estimate.formulation],
        ["status", estimate.status],
        ["iterations", str(estimate.iterations)],
        ["CPU time", f"{estimate.seconds['total']:.1f} s"],
        ["constraints", violation_in_words(estimate.violations)],
        [
            "samples, actions",
            f"{len(estimate.position)}, {estimate.measurements.actions}",
        ],
        ["mass (given)", f"{estimate.scene.mass:g} kg"],
        *([name, number] for name, number in estimate.versions.items()),
    ]
