"""Split a flow on a masked disc into irrotational, solenoidal and harmonic parts.

    flow = grad psi + rot chi + h

On the grid of the mask, flow lives on the edges between neighbouring nodes.  With d0
the difference along edges and d1 the circulation around faces, d1 d0 = 0, so that the
three parts are orthogonal to rounding:

    psi   0 on the rim of the mask     d0' d0 psi = d0' flow      divergence
    chi   on faces, 0 outside          d1 d1' chi = d1 flow       rotation
    h     neither: common motion, of a sheared gel for instance

Systems are factored once; edges and faces exist only inside the mask, so that its rim
causes no spurious divergence.  After Zhang et al., RA-L 2019 (the paper's
tactile_hhd).

psi = 0 on the rim would move a touch near the rim inwards.  `potential` therefore
leaves the rim free, after the common motion of all nodes is subtracted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from .errors import FrameError


@dataclass(frozen=True, eq=False)
class Parts:
    """Hold the three parts of a flow (H, W, 2) [px], zero outside the mask.

    psi: (H, W) [px^2] with irrotational = grad psi
    energy: of each part by name [px^2], they add up to that of the flow
    """

    irrotational: np.ndarray
    solenoidal: np.ndarray
    harmonic: np.ndarray
    psi: np.ndarray
    energy: dict[str, float]


class Hodge:
    """Decompose flows on one mask (H, W) whose nodes are `spacing` [px] apart."""

    def __init__(self, mask: np.ndarray, spacing: float = 1.0) -> None:
        self.mask, self.spacing = np.asarray(mask, bool), float(spacing)
        inner = _interior(self.mask)
        if not inner.any():
            raise FrameError(
                "nothing inside",
                where="mask",
                got=f"{self.mask.sum()} nodes",
                expected="a disc at least three nodes wide",
            )
        self._node = np.flatnonzero(inner)
        pairs, across = _edges(self.mask)
        self._pairs, self._across = pairs, across
        size = self.mask.size
        rows = np.repeat(np.arange(len(pairs)), 2)
        signs = np.tile([-1.0, 1.0], len(pairs))
        shape = len(pairs), size
        d0 = sparse.csc_array((signs, (rows, pairs.ravel())), shape=shape)
        self._d0 = d0[:, self._node]
        self._d1 = _faces(self.mask, pairs)
        self._mean = abs(d0).T.tocsr() * 0.5  # of the edges at a node, per direction
        self._solve_psi = splu((self._d0.T @ self._d0).tocsc()).solve
        self._free = np.flatnonzero(self.mask)[1:]  # the first is pinned
        self._free_d0 = d0[:, self._free]
        self._solve_free = splu((self._free_d0.T @ self._free_d0).tocsc()).solve
        self._solve_chi = splu((self._d1 @ self._d1.T).tocsc()).solve

    def potential(self, flow: np.ndarray) -> np.ndarray:
        """Return the psi (H, W) [px^2] whose gradient is nearest to a flow [px].

        The rim is free, the median flow is subtracted, the median of psi is zero.
        """
        common = np.median(flow[self.mask], axis=0)
        edge = self._along(flow - common)
        psi = np.zeros(self.mask.size)
        psi[self._free] = self.spacing * self._solve_free(self._free_d0.T @ edge)
        psi = psi.reshape(self.mask.shape)
        return np.where(self.mask, psi - np.median(psi[self.mask]), 0.0)

    def decompose(self, flow: np.ndarray) -> Parts:
        """Return the three parts of a flow (H, W, 2) [px]."""
        edge = self._along(flow)
        psi = np.zeros(self.mask.size)
        psi[self._node] = self.spacing * self._solve_psi(self._d0.T @ edge)
        psi = psi.reshape(self.mask.shape)
        spread = self._d0 @ psi.ravel()[self._node] / self.spacing
        swirl = self._d1.T @ self._solve_chi(self._d1 @ edge)
        parts = {
            "irrotational": spread,
            "solenoidal": swirl,
            "harmonic": edge - spread - swirl,
        }
        energy = {name: float(part @ part) for name, part in parts.items()}
        fields = {name: self._at_nodes(part) for name, part in parts.items()}
        return Parts(psi=psi, energy=energy, **fields)

    def _along(self, flow: np.ndarray) -> np.ndarray:
        """Return the flow along each edge [px]: the mean of both its ends."""
        if flow.shape != (*self.mask.shape, 2):
            expected = f"{(*self.mask.shape, 2)}"
            raise FrameError("wrong shape", got=flow.shape, expected=expected)
        ends = flow.reshape(-1, 2)[self._pairs, self._across[:, None]]
        return ends.mean(axis=1).astype(float)

    def _at_nodes(self, edge: np.ndarray) -> np.ndarray:
        """Return the field (H, W, 2) at the nodes: the mean of the edges there."""
        columns = []
        for across in (0, 1):
            mine = self._across == across
            count = self._mean @ mine.astype(float)
            total = self._mean @ np.where(mine, edge, 0.0)
            columns.append(total / np.where(count > 0, count, 1.0))
        return np.stack(columns, axis=-1).reshape(*self.mask.shape, 2)


def _interior(mask: np.ndarray) -> np.ndarray:
    """Return which nodes have all four neighbours in the mask."""
    wide = np.pad(mask, 1)
    rows = wide[:-2, 1:-1] & wide[2:, 1:-1]
    return mask & rows & wide[1:-1, :-2] & wide[1:-1, 2:]


def _edges(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return node pairs (E, 2) inside the mask, and 0 along x, 1 along y (E,)."""
    index = np.arange(mask.size).reshape(mask.shape)
    along_x = mask[:, :-1] & mask[:, 1:]
    along_y = mask[:-1] & mask[1:]
    x = np.column_stack([index[:, :-1][along_x], index[:, 1:][along_x]])
    y = np.column_stack([index[:-1][along_y], index[1:][along_y]])
    return np.concatenate([x, y]), np.repeat([0, 1], [len(x), len(y)])


def _faces(mask: np.ndarray, pairs: np.ndarray) -> sparse.csr_array:
    """Return d1 (faces, edges): the circulation around squares of four nodes."""
    index = np.arange(mask.size).reshape(mask.shape)
    square = mask[:-1, :-1] & mask[:-1, 1:] & mask[1:, :-1] & mask[1:, 1:]
    a, b = index[:-1, :-1][square], index[:-1, 1:][square]
    c, d = index[1:, :-1][square], index[1:, 1:][square]
    place = {tuple(pair): k for k, pair in enumerate(pairs.tolist())}
    edges = [
        [place[pair] for pair in zip(one.tolist(), two.tolist(), strict=True)]
        for one, two in ((a, b), (b, d), (c, d), (a, c))
    ]
    signs = np.repeat([1.0, 1.0, -1.0, -1.0], len(a))
    rows = np.tile(np.arange(len(a)), 4)
    columns = np.concatenate([np.array(e, int) for e in edges])
    return sparse.csr_array((signs, (rows, columns)), shape=(len(a), len(pairs)))
