"""A dictionary whose missing names raise an error that lists the names there are."""

from __future__ import annotations

from ..errors import UnknownNameError, did_you_mean, shortened


class Named(dict):
    """Values by name; an unknown name raises UnknownNameError, which is a KeyError.

    where: what the dictionary is called in the error.
    """

    def __init__(self, where: str = "", values=()) -> None:
        super().__init__(values)
        self.where = where

    def __missing__(self, name):
        names = [*self]
        raise UnknownNameError(
            "no such name", where=self.where, got=shortened(name, most=80),
            expected=f"one of {names}", next=did_you_mean(name, names),
        )  # fmt: skip

    def __reduce__(self):
        return Named, (self.where, dict(self))
