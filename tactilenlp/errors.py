"""The errors that this package raises on purpose: what, where, got, expected, next."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from functools import wraps
from inspect import signature

SHOWN_CHARACTERS = 1000  # of what was got, in a message


class TactileError(Exception):
    """Say what went wrong, where, what was got, what was expected and what to do next.

    Every part is kept as an attribute, so that a script can act on it; the message is
    built from the parts that are given.  Parts are plain strings and numbers: an error
    survives a journey between processes.
    """

    def __init__(
        self,
        what: str,
        *,
        where: str = "",
        got: object = None,
        expected: str = "",
        next: str = "",
    ) -> None:
        self.what, self.where, self.got = what, where, got
        self.expected, self.next = expected, next
        place = where if isinstance(where, str) else shortened(where)
        message = f"{place}: {what}" if place else what
        if expected:
            message += f": expected {expected}"
        if got is not None:
            message += f"{',' if expected else ':'} got {shortened(got, str)}"
        if next:
            message += f"; {next}"
        super().__init__(message)


def shortened(value: object, words=repr, most: int = SHOWN_CHARACTERS) -> str:
    """Return a value in words, at most so many characters; its type if it has none."""
    try:
        text = words(value)
    except Exception as bad:  # any: of a foreign class, or an integer of 5000 digits
        text = f"a {type(value).__name__} that has no words ({type(bad).__name__})"
    return text if len(text) <= most else f"{text[: most - 3]}..."


class MeasurementError(TactileError, ValueError):
    """A measurement cannot be used; `where` is the key, `index` the first bad entry."""

    def __init__(self, what: str, *, index: tuple[int, ...] | None = None, **parts):
        self.index = index
        super().__init__(what, **parts)


class NoContactError(MeasurementError):
    """Nothing was ever touched, so nothing can be estimated."""


class MistakeError(MeasurementError):
    """The measurements are much more likely once a common mistake is undone.

    `mistake` says which; `nats` is the gain of log likelihood by undoing it.
    """

    def __init__(self, what: str, *, mistake: str = "", nats: float = 0.0, **parts):
        self.mistake, self.nats = mistake, nats
        super().__init__(what, **parts)


class FileError(TactileError, ValueError):
    """A file is not what it should be, or only half of it is there."""


class NoFileError(FileError, FileNotFoundError):
    """There is no file of this name."""


class WriteError(FileError, OSError):
    """A file cannot be written; what was there before is unchanged."""


class SceneError(TactileError, ValueError):
    """What is said to be known of the scene cannot be true."""


class OptionError(TactileError, ValueError):
    """An option is unknown or out of its range."""


class UnknownNameError(TactileError, KeyError):
    """A result has no entry of this name."""

    __str__ = Exception.__str__  # that of KeyError puts the words in quotes


class StartError(TactileError, ValueError):
    """A start does not belong to these data."""


class PageError(TactileError, ValueError):
    """A page declares a problem that cannot be solved as written."""


class NotConverged(TactileError):
    """A solve ended without a solution; names the worst terms, keeps what was reached.

    `solution` is the last iterate with its recomputed violations (plain arrays),
    `problem` the description of the problem that was solved, and `estimate` what
    throw=False returns: marked, with `success` False.
    """

    def __init__(
        self, what: str, *, problem=None, solution=None, estimate=None, **parts
    ):
        self.problem, self.solution, self.estimate = problem, solution, estimate
        super().__init__(what, **parts)


class MotionError(NotConverged):
    """The data contradict every motion that was tried, for instance by tumbling."""


class Interrupted(KeyboardInterrupt):
    """Ctrl-C ended a solve: `estimate` is what was found so far, marked, or None.

    It is Ctrl-C, no error: `except Exception` lets it pass, so that loops end as well.
    """

    def __init__(self, words: str, estimate=None):
        self.estimate = estimate
        super().__init__(words)


def typed_call(error: type[TactileError] = OptionError) -> Callable:
    """Return a decorator: a wrong call raises `error` instead of TypeError.

    It is for functions and for classes.  The error names the arguments that there are,
    and the one most like an unknown one.
    """

    def decorated(thing):
        accepted, a_class = signature(thing), isinstance(thing, type)
        made = thing.__init__ if a_class else thing

        @wraps(made)
        def call(*args, **given):
            try:
                return made(*args, **given)
            except TypeError as bad:
                try:
                    accepted.bind(*args[a_class:], **given)  # without self
                except TypeError as wrong:
                    names = [*accepted.parameters]
                    raise _wrong_call(error, thing, names, wrong, given) from bad
                raise

        if not a_class:
            return call
        thing.__init__ = call
        return thing

    return decorated


def did_you_mean(name, names) -> str:
    """Return a question for the name that is most like an unknown one, or ""."""
    words = [known for known in names if isinstance(known, str)]
    like = get_close_matches(name, words, 1) if isinstance(name, str) else []
    return f"did you mean {like[0]!r}?" if like else ""


def _wrong_call(error, cls, names: list, wrong: TypeError, given: dict) -> TactileError:
    """Return the error for arguments that a class does not take."""
    unknown = [name for name in given if name not in names]
    if is_dataclass(cls):  # without arguments of older versions
        names = [field.name for field in fields(cls) if field.init]
    _, lacks, missing = f"{wrong}".partition("missing a required argument: ")
    help_ = "check the spelling" if unknown else "see its documentation"
    return error(
        "no such argument" if unknown else "wrong arguments", where=cls.__name__,
        got=", ".join(unknown) or f"{wrong}", expected=f"arguments among {names}",
        next=did_you_mean((unknown or [""])[0], names)
        or (f"give {missing}" if lacks else help_),
    )  # fmt: skip
