"""Name what the data leave open: sizes, faces and coordinates of the final pose."""

from __future__ import annotations

import numpy as np

from .measurement_noise import KNOWN_FACE
from .tangent_space import AXES

KNOWN_SIZE = 0.1  # [prior deviations] a size with a smaller deviation is observed
OPEN_POSITION = 0.05  # [m] a position with a larger deviation is not observed
OPEN_ROTATION = np.radians(45)  # a rotation with a larger deviation is not observed


def open_directions(tangent, C, shape, faces) -> tuple[tuple, np.ndarray]:
    """Return words and unit vectors (k, r) for what only the prior determines."""
    n = shape.theta
    prior = np.ones(len(C)) * OPEN_POSITION
    prior[:n] = shape.size_prior[1]
    prior[len(C) - tangent.turning :] = OPEN_ROTATION
    values, vectors = np.linalg.eigh(C / np.outer(prior, prior))
    directions = vectors[:, values > KNOWN_SIZE**2]
    deviation = np.sqrt(np.abs(np.diag(C)))
    turn, way = (
        tangent.maps[name] @ np.diag(deviation) for name in ("rotation", "position")
    )
    words = unobserved(
        faces, deviation[:n] / shape.size_prior[1],
        np.linalg.norm(np.nan_to_num(turn)), np.linalg.norm(way),
    )  # fmt: skip
    return words, directions


def unobserved(faces, sides=None, turn=0.0, way=0.0) -> tuple[str, ...]:
    """Name what touches do not determine.

    faces (axes, 2): samples that touched each face; sides (axes,): sigma of each size
    in deviations of its prior, small where edges or physics determine it; turn [rad]
    and way [m]: sigma of rotation and position.
    """
    words = []
    for axis, (low, high) in enumerate(faces):
        if sides is not None and sides[axis] < KNOWN_SIZE:
            continue
        missing = [s for s, n in (("-", low), ("+", high)) if n < KNOWN_FACE]
        if axis == 2:
            if high < KNOWN_FACE:
                words.append("side z: top never touched")
        elif len(missing) == 2:
            words.append(f"side {AXES[axis]}: neither face touched")
        elif missing:
            face = f"{missing[0]}{AXES[axis]}"
            words.append(f"side {AXES[axis]}: face {face} never touched")
    if turn > OPEN_ROTATION:
        words.append("rotation: no side says which way the object is turned")
    if way > OPEN_POSITION:
        words.append("position: no side says where on the ground the object lies")
    return tuple(words)


def untouched_polygons(faces) -> tuple[str, ...]:
    """Name how many faces were never touched."""
    missing = int(np.count_nonzero(faces == 0))
    return (f"{missing} of {len(faces)} faces never touched",) if missing else ()
