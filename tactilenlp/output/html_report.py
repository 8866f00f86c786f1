"""Write an estimate as one HTML page that needs nothing else: no network, no server."""

from __future__ import annotations

import json
import os
from importlib.resources import files
from pathlib import Path

import numpy as np

from ..common.validation import check_path, check_types
from ..geometry.faces import face_sigma, polygons
from .colours import BLUE, PALE, RED, information_colour

FINGER_COLOURS = ((0, 158, 115), (204, 121, 167), (230, 159, 0), (240, 228, 66))
PICTURE_MARGIN = 1.5  # [1] of the picture, to the reach of the object: fingers fit in
LINES, SPACING = 8, 0.02  # lines of the ground's grid to each side, [m] between them
IMPULSE_ARROW = 0.35  # [1] of the picture: length of the largest impulse's arrow
ANGLE, LENGTH = ("deg", np.degrees(1.0)), ("mm", 1e3)
UNITS = {"side_lengths": LENGTH, "position": LENGTH, "rotation": ANGLE}
QUANTITY_WORDS = {
    "side_lengths": "side",
    "position": "position",
    "rotation": "rotation about",
}
AXES = ("x", "y", "z")


def write_report(estimate, path: str | os.PathLike) -> None:
    """Write one page: motion to turn and scrub, measurements, words, costs."""
    check_types(estimate=(estimate, "Estimate"))
    check_path(path)
    page = (
        files("tactilenlp.output").joinpath("report.html").read_text(encoding="utf-8")
    )
    content = json.dumps(_content(estimate), separators=(",", ":"), allow_nan=False)
    # No word of a file may open or close a tag.
    page = page.replace("{{DATA}}", content.replace("<", "\\u003c"))
    Path(path).write_text(page, encoding="utf-8")


def _content(estimate) -> dict:
    """Return all that the page shows, as plain lists."""
    data = estimate.measurements
    first, *_ = estimate.summary().split("\n")
    centre, reach = _frame(estimate)
    pushes = [estimate.impulses[f"finger {f}"] for f in range(data.fingers)]
    most = max((np.linalg.norm(push, axis=1).max() for push in pushes), default=0.0)
    return {
        "title": f"A {estimate.shape}, from touch alone",
        "subtitle": first,
        "time": _plain(data.time, 3),
        "action": data.action.tolist(),
        "position": _plain(estimate.position),
        "quaternion": _plain(estimate.quaternion, 6),
        "vertices": _plain(estimate.vertices),
        "faces": _faces(estimate),
        "finger": [
            {
                "position": _plain(estimate.seen_positions[:, f]),
                "radius": float(data.finger_radius[f]),
                "contact": (data.contact & data.valid)[:, f].tolist(),
                "valid": data.valid[:, f].tolist(),
                "impulse": _plain(push),
                "colour": FINGER_COLOURS[f % len(FINGER_COLOURS)],
            }
            for f, push in enumerate(pushes)
        ],
        "touches": _touches(estimate),
        "grid": _grid(estimate, centre),
        "centre": _plain(centre),
        "reach": reach,
        "bar": 0.02,
        "arrow": IMPULSE_ARROW * reach / most if most > 0 else 0.0,
        "ramp": [BLUE, PALE, RED],
        "sigma": _sigma(estimate),
        "costs": sorted(estimate.costs.items(), key=lambda cost: -abs(cost[1])),
        "objective": f"{estimate.objective:.2f} nats",
        "unobserved": list(estimate.information.unobserved),
        "solve": _solve(estimate),
        "skipped": [str(skipped) for skipped in estimate.skipped],
    }


def _plain(values, digits: int = 5) -> list:
    """Return numbers rounded to 10 um, or so many digits: a third of the size."""
    return np.round(np.nan_to_num(np.asarray(values, float)), digits).tolist()


def _frame(estimate) -> tuple[np.ndarray, float]:
    """Return centre (3,) and reach [m] of a picture that holds the whole motion."""
    low, high = estimate.position.min(axis=0), estimate.position.max(axis=0)
    size = np.linalg.norm(estimate.vertices, axis=1).max()
    return (low + high) / 2, float(
        np.linalg.norm(high - low) / 2 + PICTURE_MARGIN * size
    )


def _faces(estimate) -> list[dict]:
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
    """Return every contact: its point and normal on the body as it was then."""
    data, centre, found = estimate.measurements, estimate.seen_positions, []
    for t, f in np.argwhere(data.contact & data.valid):
        R_wo, n_w = estimate.rotation(t), data.normal[t, f]
        p_w = centre[t, f] - data.finger_radius[f] * n_w
        point, normal = R_wo.T @ (p_w - estimate.position[t]), R_wo.T @ n_w
        found.append(
            {
                "sample": int(t),
                "finger": int(f),
                "point": _plain(point),
                "normal": _plain(normal),
            }
        )
    return found


def _grid(estimate, centre) -> list:
    """Return the lines of the ground under the object, each as two points."""
    ground = estimate.scene.ground
    if ground is None:
        return []
    middle = np.round(ground.to_ground(centre)[:2] / SPACING) * SPACING
    steps, far = np.arange(-LINES, LINES + 1) * SPACING, LINES * SPACING
    along = [[[s, -far, 0], [s, far, 0]] for s in steps]
    lines = np.array(along + [[[-far, s, 0], [far, s, 0]] for s in steps])
    return _plain(ground.from_ground(lines + np.array([*middle, 0.0])))


def _sigma(estimate) -> list[list[str]]:
    """Return what is known of each quantity, in words: value and deviation."""
    rows, information = [], estimate.information
    where = {"position": estimate.position[-1]}
    if estimate.shape == "cuboid":
        where["side_lengths"] = estimate.side_lengths
    for name in ("side_lengths", "position", "rotation"):
        if name not in information.maps:
            continue
        unit, factor = UNITS[name]
        values = where.get(name, np.zeros(3))
        for axis, value, s in zip(AXES, values, information.sigma(name), strict=True):
            words = f"± {s * factor:.2f} {unit}" if np.isfinite(s) else "not known"
            words = "fixed by a reduction" if np.isnan(s) else words
            words = "none: a hull's axes are the world's" if s == 0.0 else words
            if name != "rotation":
                words = f"{value * factor:.2f} {words}"
            rows.append([f"{QUANTITY_WORDS[name]} {axis}", words])
    return rows


def _solve(estimate) -> list[list[str]]:
    violation = max(estimate.violations.values(), default=0.0)
    return [
        ["formulation", estimate.formulation],
        ["status", estimate.status],
        ["iterations", str(estimate.iterations)],
        ["CPU time", f"{estimate.seconds['total']:.1f} s"],
        ["largest violation", f"{violation:.1g}"],
        [
            "samples, actions",
            f"{len(estimate.position)}, {estimate.measurements.actions}",
        ],
        ["mass (given)", f"{estimate.scene.mass:g} kg"],
        *([name, number] for name, number in estimate.versions.items()),
    ]
