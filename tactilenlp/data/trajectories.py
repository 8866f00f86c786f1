"""Recorded motion of one body: poses at a constant rate, toss by toss."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..common.brief import shown
from ..common.npz import read_npz, write_npz
from ..common.validation import as_array, checked_choice, numbers_of
from ..errors import MeasurementError, shortened, typed_call

QUATERNION_TOLERANCE = 1e-3  # [1], of the length of a quaternion
LARGEST_POSITION = 100.0  # [m], further than any tracked body: the file is in mm
LEAST_SAMPLES = 3  # samples: a change of velocity needs three poses
TRAJECTORY_KEYS = ("toss", "position", "quaternion", "dt")


@shown
@typed_call()
@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Trajectories:
    """Poses of one body at T samples, recorded while nothing but the ground touched it.

    toss:       (T,) int, which recording a sample belongs to; samples of one lie
                together, dt apart
    position:   (T, 3) [m] of the body's origin, its centre of mass, world frame
    quaternion: (T, 4) wxyz, body to world
    dt:         [s] between samples

    Raises MeasurementError, which names the key and the first bad index.
    """

    toss: np.ndarray
    position: np.ndarray
    quaternion: np.ndarray
    dt: float

    def __post_init__(self) -> None:
        position = _numbers("position", self.position, 3, "[m]")
        quaternion = _numbers("quaternion", self.quaternion, 4, "wxyz")
        toss, dt = as_array(self.toss, "iu"), as_array(self.dt, "iuf")
        numbered = toss is not None and toss.ndim == 1
        _check(numbered, "toss", "(T,) whole numbers", shortened(self.toss, most=60))
        lengths = len(toss), len(position), len(quaternion)
        got = "{}, {} and {} samples".format(*lengths)
        one = len(set(lengths)) == 1
        _check(one, "toss, position, quaternion", "one length T", got)
        near = abs(position).max(axis=1) <= LARGEST_POSITION
        _check_each(near, "position", "within 100 m")
        length = np.linalg.norm(quaternion, axis=1)
        unit = abs(length - 1) <= QUATERNION_TOLERANCE
        _check_each(unit, "quaternion", "unit length")
        one = dt is not None and dt.ndim == 0 and 0 < dt < 1
        got = shortened(self.dt, most=60)
        _check(one, "dt", "one interval [s] between 0 and 1", got)
        _, counts = np.unique(toss, return_counts=True)
        together = np.count_nonzero(np.diff(toss)) + 1 == len(counts)
        got = "samples of one toss in several places"
        _check(together, "toss", "samples of one toss in a row", got)
        enough, words = counts.min() >= LEAST_SAMPLES, f"{LEAST_SAMPLES} samples a toss"
        _check(enough, "toss", f"{words} at least", f"{counts.min()} samples")
        quaternion = quaternion / length[:, None]
        arrays = [np.array(a) for a in (toss, position, quaternion)]  # copies
        for name, value in zip(TRAJECTORY_KEYS, (*arrays, float(dt)), strict=True):
            object.__setattr__(self, name, value)

    @classmethod
    def load(cls, path: str | os.PathLike) -> Trajectories:
        """Read toss, position, quaternion and dt from an .npz; ignore all others."""
        arrays = read_npz(path, TRAJECTORY_KEYS)
        for key in TRAJECTORY_KEYS:
            expected = f"the keys {', '.join(TRAJECTORY_KEYS)}"
            _check(key in arrays, key, expected, f"no {key}")
        return cls(**arrays)

    def save(self, path: str | os.PathLike) -> None:
        """Write an .npz file that loads to the same trajectories."""
        write_npz(path, {key: getattr(self, key) for key in TRAJECTORY_KEYS})

    @property
    def tosses(self) -> np.ndarray:
        """The numbers of the tosses, as recorded."""
        return self.toss[np.sort(np.unique(self.toss, return_index=True)[1])]

    def select(self, tosses: Iterable[int]) -> Trajectories:
        """Return some tosses, by number, in the order of recording.

        Raises MeasurementError of numbers that are not among `tosses`.
        """
        wanted = checked_choice("tosses", tosses, self.tosses, MeasurementError)
        rows = np.isin(self.toss, wanted)
        return Trajectories(
            toss=self.toss[rows], position=self.position[rows],
            quaternion=self.quaternion[rows], dt=self.dt,
        )  # fmt: skip

    def __repr__(self) -> str:
        rate, count = 1 / self.dt, len(self.tosses)
        return f"Trajectories({count} tosses, {len(self.toss)} poses at {rate:.0f} Hz)"


def _numbers(name: str, value, width: int, unit: str) -> np.ndarray:
    """Return finite numbers (T, width); MeasurementError for anything else."""
    array = numbers_of(name, value, MeasurementError, "T", width, unit=unit)
    _check(len(array) > 0, name, "a sample", "none")
    _check_each(np.isfinite(array).all(axis=1), name, "finite numbers")
    return array


def _check_each(good: np.ndarray, name: str, expected: str) -> None:
    if not good.all():
        first = int(np.argmin(good))
        _check(False, name, expected, f"another at sample {first}", (first,))


def _check(good: bool, name: str, expected: str, got: str, index=None) -> None:
    """Raise MeasurementError unless a value is good; index: where it is not."""
    if not good:
        raise MeasurementError(
            "cannot be used", index=index, where=name, expected=expected, got=got
        )
