"""Measure the optical flow of a tactile picture since its reference, with a check.

Brightness is normalised locally (coloured light is uneven, and a touch changes it),
then dense inverse search (DIS) computes the flow.  DIS replaces the paper's RAFT: it
needs neither GPU nor weights, and the authors of the decomposition use it too.
"""

from __future__ import annotations

import numpy as np

from .errors import FrameError, HardwareError

NEIGHBOURHOOD = 6.0  # [px], sigma of the local mean and deviation
CONTRAST = 40.0  # [grey levels] of one local standard deviation
FLAT = 2.0  # [grey levels], smaller local deviations are noise and not amplified
AGREE = 1.0  # [px], largest difference of valid forward and backward flow


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
    grey_or_bgr = frame.ndim == 2 or (frame.ndim == 3 and frame.shape[2] in (3, 4))
    if frame.dtype != np.uint8 or frame.size == 0 or not grey_or_bgr:
        raise FrameError(
            "no picture", where="frame", got=f"{frame.dtype} {frame.shape}",
            expected="uint8, (H, W) or (H, W, 3 or 4)",
        )  # fmt: skip
    if frame.ndim == 3:
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
        self._back = make(
            opencv().DISOPTICAL_FLOW_PRESET_FAST
        )  # sufficient for a check
        self._reference = normalised(grey(reference))
        rows, columns = np.indices(self._reference.shape, dtype=np.float32)
        self._grid = np.stack([columns, rows], axis=-1)

    def __call__(self, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the flow and its forward-backward error (H, W) [px]."""
        now = normalised(grey(frame))
        if now.shape != self._reference.shape:
            raise FrameError(
                "another picture size", where="frame", got=now.shape,
                expected=f"{self._reference.shape}, as the reference",
            )  # fmt: skip
        there = self._there.calc(self._reference, now, None)
        back = self._back.calc(now, self._reference, None)
        arrive = self._grid + there
        back = opencv().remap(back, arrive, None, opencv().INTER_LINEAR)
        return there, np.linalg.norm(there + back, axis=-1)
