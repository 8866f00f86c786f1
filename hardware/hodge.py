"""Find the potential of the irrotational part of a flow on a masked disc.

    flow = common motion + grad psi + rest

On the grid of the mask, flow lives on the edges between neighbouring nodes.  With d0
the difference along edges, psi solves the normal equations of least squares:

    d0' d0 psi = d0' flow

The system is factored once; edges exist only inside the mask, so that its rim causes no
spurious divergence.  After Zhang et al., RA-L 2019 (the paper's tactile_hhd), who set
psi = 0 on the rim.  That would move a touch near the rim inwards; here the rim is free,
after the common motion of all nodes is subtracted.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage, sparse
from scipy.sparse.linalg import splu

from .errors import FrameError


class Hodge:
    """Find potentials of flows on one mask (H, W), nodes `spacing` [px] apart."""

    def __init__(self, mask: np.ndarray, spacing: float = 1.0) -> None:
        self.mask, self.spacing = np.asarray(mask, bool), float(spacing)
        if not ndimage.binary_erosion(self.mask).any():
            raise FrameError(
                "nothing inside",
                where="mask",
                got=f"{self.mask.sum()} nodes",
                expected="a disc at least three nodes wide",
            )
        pairs, across = _edges(self.mask)
        self._pairs, self._across = pairs, across
        rows = np.repeat(np.arange(len(pairs)), 2)
        signs = np.tile([-1.0, 1.0], len(pairs))
        shape = len(pairs), self.mask.size
        d0 = sparse.csc_array((signs, (rows, pairs.ravel())), shape=shape)
        self._free = np.flatnonzero(self.mask)[1:]  # the first is pinned
        self._free_d0 = d0[:, self._free]
        self._solve_free = splu((self._free_d0.T @ self._free_d0).tocsc()).solve

    def potential(self, flow: np.ndarray) -> np.ndarray:
        """Return the psi (H, W) [px^2] whose gradient is nearest to a flow (H, W, 2).

        The rim is free, the median flow [px] is subtracted, the median of psi is zero.
        """
        if flow.shape != (*self.mask.shape, 2):
            raise FrameError(
                "wrong shape", where="flow", got=flow.shape,
                expected=f"{(*self.mask.shape, 2)}",
            )  # fmt: skip
        common = np.median(flow[self.mask], axis=0)
        edge = self._along(flow - common)
        psi = np.zeros(self.mask.size)
        psi[self._free] = self.spacing * self._solve_free(self._free_d0.T @ edge)
        psi = psi.reshape(self.mask.shape)
        return np.where(self.mask, psi - np.median(psi[self.mask]), 0.0)

    def _along(self, flow: np.ndarray) -> np.ndarray:
        """Return the flow along each edge [px]: the mean of both its ends."""
        ends = flow.reshape(-1, 2)[self._pairs, self._across[:, None]]
        return ends.mean(axis=1).astype(float)


def _edges(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return node pairs (E, 2) inside the mask, and 0 along x, 1 along y (E,)."""
    index = np.arange(mask.size).reshape(mask.shape)
    along_x = mask[:, :-1] & mask[:, 1:]
    along_y = mask[:-1] & mask[1:]
    x = np.column_stack([index[:, :-1][along_x], index[:, 1:][along_x]])
    y = np.column_stack([index[:-1][along_y], index[1:][along_y]])
    return np.concatenate([x, y]), np.repeat([0, 1], [len(x), len(y)])
