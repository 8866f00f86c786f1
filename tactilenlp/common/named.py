"""Values by name, of which missing names are said; arrays that cannot be written."""

from __future__ import annotations

import numpy as np

from ..errors import UnknownNameError
from .validation import check_one_of


class Named(dict):
    """Values by name; an unknown name raises UnknownNameError, which is a KeyError.

    where: what the dictionary is called in the error.  Arrays cannot be written.
    """

    def __init__(self, where: str = "", values=()) -> None:
        super().__init__({k: read_only(v) for k, v in dict(values).items()})
        self.where = where

    def __missing__(self, name):
        check_one_of(self.where, name, self, "no such name", UnknownNameError)

    def __reduce__(self):
        return Named, (self.where, dict(self))


def read_only(value):
    """Return an array as a view that cannot be written, any other value as it is."""
    if not isinstance(value, np.ndarray):
        return value
    view = value.view()
    view.flags.writeable = False
    return view
