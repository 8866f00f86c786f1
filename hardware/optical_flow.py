"""Measure how a tactile picture has moved since its reference, and how surely.

Brightness is normalised locally first (coloured light is not even, and a touch changes
it), then dense inverse search (DIS) finds the flow.  DIS stands in for the paper's
RAFT: it needs neither GPU nor weights, and the decomposition's authors use it too.
"""

from __future__ import annotations

import numpy as np

from .errors import FrameError, HardwareError

NEIGHBOURHOOD = 6.0  # [px], sigma of what is local
CONTRAST = 40.0  # [grey levels] of one local standard deviation
FLAT = 2.0  # [grey levels], local deviations below it are noise and are not blown up
AGREE = 1.0  # [px], forward and backward flow agree to better than that where they hold


def opencv():
    """Return OpenCV, or say how to install it."""
    try:
        import cv2
    except ImportError as bad:
        fix = 'install it: pip install "tactilenlp[optical]"'
        raise HardwareError("OpenCV is missing", where="optical", next=fix) from bad
    return cv2


def grey(frame: np.ndarray) -> np.ndarray:
    """Return a picture as (H, W) uint8, contiguous; raises FrameError."""
    frame = np.asarray(frame)
    if frame.dtype != np.uint8 or frame.ndim not in (2, 3) or frame.size == 0:
        got = f"{frame.dtype} {frame.shape}"
        raise FrameError("no picture", got=got, expected="uint8, (H, W) or (H, W, 3)")
    if frame.ndim == 3:
        if frame.shape[2] not in (3, 4):
            expected = "1, 3 (BGR) or 4 channels"
            raise FrameError("no picture", got=frame.shape, expected=expected)
        colours = np.ascontiguousarray(frame[..., :3])
        frame = opencv().cvtColor(colours, opencv().COLOR_BGR2GRAY)
    return np.ascontiguousarray(frame)


def normalised(picture: np.ndarray) -> np.ndarray:
    """Return the local contrast (H, W) uint8: (g - mean) / deviation about 128."""
    blur, g = opencv().GaussianBlur, picture.astype(np.float32)
    mean = blur(g, (0, 0), NEIGHBOURHOOD)
    variance = blur(g * g, (0, 0), NEIGHBOURHOOD) - mean * mean
    contrast = (g - mean) / np.sqrt(np.maximum(variance, FLAT**2))
    return np.clip(np.rint(128 + CONTRAST * contrast), 0, 255).astype(np.uint8)


class Flow:
    """Measure flows (H, W, 2) [px] from one reference picture."""

    def __init__(self, reference: np.ndarray) -> None:
        make = opencv().DISOpticalFlow_create
        self._there = make(opencv().DISOPTICAL_FLOW_PRESET_MEDIUM)
        self._back = make(opencv().DISOPTICAL_FLOW_PRESET_FAST)  # enough for a check
        self._reference = normalised(grey(reference))
        rows, columns = np.indices(self._reference.shape, dtype=np.float32)
        self._grid = np.stack([columns, rows], axis=-1)

    def __call__(self, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the flow and by how much [px] going there and back misses (H, W)."""
        now = normalised(grey(frame))
        if now.shape != self._reference.shape:
            expected = f"{self._reference.shape}, as the reference"
            raise FrameError("another picture size", got=now.shape, expected=expected)
        there = self._there.calc(self._reference, now, None)
        back = self._back.calc(now, self._reference, None)
        arrive = self._grid + there
        back = opencv().remap(back, arrive, None, opencv().INTER_LINEAR)
        return there, np.linalg.norm(there + back, axis=-1)
