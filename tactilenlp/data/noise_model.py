"""Synthetic sensor noise, added to clean measurements."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..common.validation import check_range, check_whole
from ..errors import typed_call
from .measurements import Measurements

MOST_SEED = 2**128 - 1  # numpy.random.SeedSequence draws 128 bits
MOST_NOISE = {  # largest value, and its unit
    "position": (np.finfo(float).max, "m"),
    "bias": (np.finfo(float).max, "m"),
    "normal": (np.finfo(float).max, "rad"),
    "flips": (1.0, ""),
    "dropped": (1.0, ""),
}


@typed_call()
@dataclass(frozen=True)
class Noise:
    """Errors of the sensors; all zero by default.

    position: [m]   standard deviation of each coordinate of the fingers, every sample
    bias:     [m]   standard deviation of a constant offset, one vector per finger
    normal:   [rad] standard deviation of the angle between measured and true normal,
                    about a random axis across the normal
    flips:    [1]   probability that a contact boolean is wrong
    dropped:  [1]   probability that a sample of a finger is lost (valid=False)
    seed:           the same seed gives the same noise, to the last digit
    """

    position: float = 0.0
    bias: float = 0.0
    normal: float = 0.0
    flips: float = 0.0
    dropped: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name, (most, unit) in MOST_NOISE.items():
            check_range(f"Noise.{name}", getattr(self, name), 0, most, unit)
        check_whole("Noise.seed", self.seed, 0, MOST_SEED)


def add_noise(data: Measurements, noise: Noise) -> Measurements:
    """Return the data with this noise added; nothing else changes.

    The bias depends on the seed alone, the rest on seed and action number: noise on a
    whole record equals noise on its actions one by one, and one kind of noise does not
    change the draws of another.  A missed contact loses its normal; a false one gets a
    normal drawn uniformly from the sphere.  Invalid samples are never flipped.
    """
    position, normal = data.finger_position.copy(), data.normal.copy()
    contact, valid = data.contact.copy(), data.valid.copy()
    bias = np.random.default_rng([noise.seed, 0]).normal(size=(contact.shape[1], 3))
    for action in np.unique(data.action):
        rows = data.action == action
        rng = np.random.default_rng([noise.seed, 1, int(action) % 2**64])
        shape = contact[rows].shape
        white = rng.normal(size=(*shape, 3))
        angle, axis = rng.normal(size=shape), rng.normal(size=(*shape, 3))
        anywhere = _unit(rng.normal(size=(*shape, 3)))
        flipped = (rng.random(shape) < noise.flips) & valid[rows]
        received = rng.random(shape) >= noise.dropped

        position[rows] += noise.position * white + noise.bias * bias
        noisy = _turned(normal[rows], axis, noise.normal * angle)
        noisy = np.where((flipped & ~contact[rows])[..., None], anywhere, noisy)
        contact[rows] = (contact[rows] ^ flipped) & received
        valid[rows] &= received
        normal[rows] = np.where(contact[rows][..., None], noisy, 0.0)
    return replace(
        data, finger_position=position, contact=contact, normal=normal, valid=valid
    )


def _turned(normal: np.ndarray, axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Turn unit vectors by an angle (..., ) [rad] about a random axis across them."""
    across = _unit(np.cross(normal, axis))
    cos, sin = np.cos(angle)[..., None], np.sin(angle)[..., None]
    return np.where(angle[..., None] == 0, normal, cos * normal + sin * across)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Return vectors (..., 3) of length one; those of length zero stay."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, 1.0)
