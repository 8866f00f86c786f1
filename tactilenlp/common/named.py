"""A dictionary whose missing names raise an error that lists the names there are."""

from __future__ import annotations

from difflib import get_close_matches

from ..errors import UnknownNameError, shortened


class Named(dict):
    """Values by name; an unknown name raises UnknownNameError, which is a KeyError.

    where: what the dictionary is called in the error.
    """

    def __init__(self, where: str = "", values=()) -> None:
        super().__init__(values)
        self.where = where

    def __missing__(self, name):
        names = [*self]
        like = get_close_matches(name, names, 1) if isinstance(name, str) else []
        fix = f"did you mean {like[0]!r}?" if like else ""
        raise UnknownNameError(
            "no such name", where=self.where, got=shortened(name, most=80),
            expected=f"one of {names}", next=fix,
        )  # fmt: skip

    def __reduce__(self):
        return Named, (self.where, dict(self))
