"""Render the pictures of a DenseTact: a texture that a touch expands.

The skin moves by the gradient of a Gaussian: away from the touch, most at one `spread`
from it.  The truth is known exactly.  The texture is better than a real one: on real
texture the errors of the centre of pressure are 5 to 40 times larger.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import ndimage

from .optical import Lens

GRAIN = 1.5  # [px], size of the speckles
CONTRAST = 45.0  # [grey levels], one standard deviation
NOISE = 1.5  # [grey levels] of the camera
SPREAD = 0.2  # [1], width of a touch by the edge of the field of view
COMPLIANCE = 2.0  # [px/N], the most that the skin moves under a force


class SimulatedSkin:
    """Render pictures (H, W) uint8 of one sensor.

    lens:  position of the dome in the picture
    shape: (H, W) [px]
    """

    def __init__(self, lens: Lens, shape: tuple[int, int], seed: int = 0) -> None:
        self.lens, self.shape = lens, shape
        self._rng = np.random.default_rng([seed, 7])
        speckles = ndimage.gaussian_filter(self._rng.normal(size=shape), GRAIN)
        self._texture = 128 + CONTRAST * speckles / speckles.std()
        rows, columns = np.indices(shape, dtype=float)
        self._pixel = np.stack([columns, rows], axis=-1)

    def picture(
        self, direction: np.ndarray | None = None, force: float = 0.0
    ) -> np.ndarray:
        """Return a picture while a force [N] presses along a normal of the dome.

        direction: (3,) outward normal of the dome at the touch, in the sensor's frame,
        None for no touch.
        """
        picture = self._texture
        if direction is not None and force > 0:
            u, v = np.moveaxis(self._pixel - self.displacement(direction, force), -1, 0)
            picture = ndimage.map_coordinates(picture, [v, u], order=1, mode="reflect")
        picture = picture + NOISE * self._rng.normal(size=self.shape)
        return np.clip(picture.round(), 0, 255).astype(np.uint8)

    def displacement(self, direction: np.ndarray, force: float) -> np.ndarray:
        """Return the displacement (H, W, 2) [px] of the skin at each pixel."""
        spread = SPREAD * self.lens.edge
        out = self._pixel - self.lens.pixel(direction)
        square = (out**2).sum(axis=-1, keepdims=True) / spread**2
        most = COMPLIANCE * force
        return most * out / spread * np.exp((1 - square) / 2)

    def strength(self, force: float) -> float:
        """Return the largest pressure -psi [px^2] of that displacement."""
        spread = SPREAD * self.lens.edge
        return COMPLIANCE * force * spread * math.exp(0.5)
