"""Read the poses that FoundationPose wrote: ground truth for `metrics` only.

One text file per picture, 4 x 4 numbers: the object in the camera (OpenCV axes: x
right, y down, z forward), in metres, for the origin of the mesh.  File names are the
stems of the pictures (`run_demo.py`) or bare counters 0, 1, 2, ..., 10 (the fork of the
paper's group), so that they are sorted by number, not by letter.
"""

from __future__ import annotations

import logging
import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from tactilenlp.common.validation import as_floats, check_range, is_rotation, numbers_of

from .clock import near_samples
from .errors import ClockError, RecordingError

log = logging.getLogger(__name__)
COUNTER = r"\d{1,7}"  # longer numbers are time stamps
RATE = 30.0  # [Hz] of the camera
ROTATION_TOLERANCE = 1e-3  # [1], largest entry of R'R - 1
LARGEST_GAP = 2.5  # [pictures]: poses are not interpolated over more than two


@dataclass(frozen=True, eq=False)
class Poses:
    """Hold poses of the object in the world, at N pictures.

    time:       (N,) [s]
    position:   (N, 3) [m], of the mesh's origin
    quaternion: (N, 4) wxyz, mesh to world, of continuous sign
    valid:      (N,) bool, False where there is no usable pose; 0 and identity there
    """

    time: np.ndarray
    position: np.ndarray
    quaternion: np.ndarray
    valid: np.ndarray

    def at(self, time: np.ndarray) -> Poses:
        """Return the poses at times (n,) [s]: linear, slerp, between close pictures.

        Not valid outside the record, and between neighbours that are further apart than
        two pictures at their median interval.
        """
        time = np.asarray(time, float)
        good = np.flatnonzero(self.valid)
        if len(good) < 2:
            return _nothing(time)
        known, p_w = self.time[good], self.position[good]
        gap = LARGEST_GAP * np.median(np.diff(self.time))
        close = near_samples(known, time, gap)
        valid = (known[0] <= time) & (time <= known[-1]) & close
        inside = np.clip(time, known[0], known[-1])
        position = np.stack([np.interp(inside, known, p) for p in p_w.T], axis=-1)
        xyzw = np.roll(self.quaternion[good], -1, axis=-1)
        turn = Slerp(known, Rotation.from_quat(xyzw))(inside)
        out = _nothing(time)
        out.position[valid] = position[valid]
        out.quaternion[valid] = _continuous(_wxyz(turn))[valid]
        out.valid[:] = valid
        return out


def load_poses(
    folder: str | os.PathLike,
    times: np.ndarray | None = None,
    world_from_camera: np.ndarray | None = None,
    rate: float = RATE,
) -> Poses:
    """Read `ob_in_cam/*.txt`.

    folder:            that folder, or the one that holds it
    times:             (N,) [s] of all pictures, in their order: the number of a file,
                       where names are counters, is its place; otherwise its rank.
                       None: from 0, at `rate`, which drifts; a warning is logged
    world_from_camera: (4, 4) of the camera in the world, None: the camera is the world
    rate:              [Hz] of the pictures

    A picture without a file, and a file that holds no rigid motion, are not valid.
    Raises RecordingError where there are no files, ClockError where times do not fit.
    """
    files = _files(Path(folder))
    place = _places(files)
    time = _times(times, max(place) + 1, rate, str(folder))
    X_wc = np.eye(4) if world_from_camera is None else _given(world_from_camera)
    poses = _nothing(time)
    for k, file in zip(place, files, strict=True):
        X_co = _matrix(file)
        if X_co is None:
            continue
        X_wo = X_wc @ X_co
        poses.position[k] = X_wo[:3, 3]
        poses.quaternion[k] = _wxyz(Rotation.from_matrix(X_wo[:3, :3]))
        poses.valid[k] = True
    poses.quaternion[poses.valid] = _continuous(poses.quaternion[poses.valid])
    return poses


def _files(folder: Path) -> list[Path]:
    if (folder / "ob_in_cam").is_dir():
        folder = folder / "ob_in_cam"
    files = sorted(folder.glob("*.txt"), key=_natural)
    if not files:
        expected = "ob_in_cam/*.txt as FoundationPose writes them"
        raise RecordingError("no poses", where=str(folder), expected=expected)
    return files


def _places(files: list[Path]) -> list[int]:
    """Return the number of the picture of each file: its counter, or its rank."""
    counters = [int(f.stem) for f in files if re.fullmatch(COUNTER, f.stem)]
    return counters if len(counters) == len(files) else list(range(len(files)))


def _times(given, count: int, rate: float, where: str) -> np.ndarray:
    """Return the times (N,) [s] of at least `count` pictures; raises ClockError."""
    if given is None:
        check_range("rate", rate, 1e-3, 1e5, "Hz", ClockError)
        log.warning("%s: no times, pictures are taken as %g Hz", where, rate)
        return np.arange(count) / rate
    time = numbers_of("times", given, ClockError, "N", finite=True)
    if len(time) < count:
        raise ClockError(
            "more pictures than times",
            where=where,
            got=f"{count} pictures or more, {len(time)} times",
            expected="a time for every picture",
        )
    if not (np.diff(time) > 0).all():
        step = np.diff(time).min()
        raise ClockError(
            "times do not increase", where=where, got=f"a step of {step:g} s",
            expected="steps above zero",
        )  # fmt: skip
    return time


def _natural(path: Path) -> list:
    """Return a key that sorts by number: 10 after 9."""
    parts = re.split(r"(\d+)", path.stem)
    return [(part.isdigit(), int(part) if part.isdigit() else part) for part in parts]


def _matrix(file: Path) -> np.ndarray | None:
    """Return the motion (4, 4) in a file, None where it holds none."""
    try:
        X_co = np.array(file.read_text().split(), float)
    except (ValueError, OSError):  # no numbers, or no text at all
        return None
    if X_co.size != 16 or not _rigid(X_co.reshape(4, 4)):
        return None
    return X_co.reshape(4, 4)


def _given(matrix: np.ndarray) -> np.ndarray:
    X_wc = as_floats(matrix)
    if X_wc.shape != (4, 4) or not _rigid(X_wc):
        raise RecordingError(
            "no rigid motion",
            where="world_from_camera",
            got=f"shape {X_wc.shape}",
            expected="(4, 4): a rotation, a translation [m], and 0 0 0 1",
            next="camera-from-world, as the paper's group saves it, must be inverted",
        )
    return X_wc


def _rigid(matrix: np.ndarray) -> bool:
    if not np.isfinite(matrix).all() or not np.allclose(matrix[3], [0, 0, 0, 1]):
        return False
    return is_rotation(matrix[:3, :3], ROTATION_TOLERANCE)


def _nothing(time: np.ndarray) -> Poses:
    turn = np.tile([1.0, 0.0, 0.0, 0.0], (len(time), 1))
    return Poses(time, np.zeros((len(time), 3)), turn, np.zeros(len(time), bool))


def _wxyz(rotation: Rotation) -> np.ndarray:
    return np.roll(rotation.as_quat(), 1, axis=-1)


def _continuous(wxyz: np.ndarray) -> np.ndarray:
    """Return the same rotations (n, 4) without jumps of sign."""
    flips = np.where((wxyz[1:] * wxyz[:-1]).sum(axis=1) < 0, -1.0, 1.0)
    return wxyz * np.concatenate([[1.0], np.cumprod(flips)])[: len(wxyz), None]
