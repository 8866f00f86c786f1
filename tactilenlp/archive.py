"""Read the arrays of an .npz file from anybody: nothing in it is executed."""

from __future__ import annotations

import os
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterable

import numpy as np

from tactilenlp.checks import check_path
from tactilenlp.errors import MeasurementError

UNREADABLE = (  # AttributeError, TypeError: np.load gave an array, it was an .npy file
    *(ValueError, EOFError, OSError, RuntimeError, AttributeError, TypeError),
    *(NotImplementedError, zipfile.BadZipFile, zlib.error, struct.error, MemoryError),
    *(SyntaxError, tokenize.TokenError, OverflowError),  # of a damaged array's header
)


def read_npz(
    path: str | os.PathLike, keys: Iterable | None, error: type = MeasurementError
) -> dict[str, np.ndarray]:
    """Read those of `keys` (None: all) that an .npz file has; unpickle nothing.

    Raises `error` for what is no .npz file, FileNotFoundError for no file at all.
    """
    check_path(path)
    arrays, where = {}, os.fspath(path)
    with open(path, "rb") as stream:
        try:
            with np.load(stream, allow_pickle=False) as archive:
                keys = archive.files if keys is None else keys
                for where in (key for key in keys if key in archive):
                    arrays[where] = archive[where]
        except UNREADABLE as bad:
            parts = {"where": where, "got": f"{type(bad).__name__}: {bad}"}
            parts |= {"expected": "an .npz file of plain arrays"}
            raise error("cannot be read", next="use numpy.savez", **parts) from bad
    return arrays
