"""A dictionary whose missing names raise an error that lists the names there are."""

from __future__ import annotations

from ..errors import UnknownNameError
from .validation import check_one_of


class Named(dict):
    """Values by name; an unknown name raises UnknownNameError, which is a KeyError.

    where: what the dictionary is called in the error.
    """

    def __init__(self, where: str = "", values=()) -> None:
        super().__init__(values)
        self.where = where

    def __missing__(self, name):
        check_one_of(self.where, name, self, "no such name", UnknownNameError)

    def __reduce__(self):
        return Named, (self.where, dict(self))
