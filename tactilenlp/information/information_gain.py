"""Compute the expected information gain of planned measurements, in nats."""

from __future__ import annotations

import numpy as np

from ..errors import OptionError, TactileError


def information_gain(known, told, asked: int | None = None) -> float:
    """Return (logdet(I + F) - logdet(I)) / 2 in nats, by two Cholesky factors.

    known: I (k, k), positive definite; told: F (k, k), positive semidefinite; asked:
    how many of the first unknowns count, all others being marginalised.
    """
    known, told = (np.asarray(matrix, float) for matrix in (known, told))
    if known.ndim != 2 or known.shape != told.shape or len(known) != known.shape[1]:
        raise OptionError(
            "wrong shape", where="information_gain",
            expected="two square matrices of one size",
            got=f"{known.shape} and {told.shape}",
        )  # fmt: skip
    if asked is not None and asked < len(known):  # logdet of a Schur complement
        rest = slice(asked, None)
        nuisance = information_gain(known[rest, rest], told[rest, rest])
        return information_gain(known, told) - nuisance
    scale = 1 / np.sqrt(np.abs(np.diag(known)))
    known, told = known * np.outer(scale, scale), told * np.outer(scale, scale)
    try:
        before, after = np.linalg.cholesky(known), np.linalg.cholesky(known + told)
    except np.linalg.LinAlgError as bad:
        raise TactileError(
            "not positive definite",
            where="information_gain",
            expected="I and I + F with positive eigenvalues only",
            got=f"{np.linalg.eigvalsh(known)[0]:.2g} as the least one of I",
            next="give what is known a prior in physical units",
        ) from bad
    return float(np.log(np.diag(after) / np.diag(before)).sum())
