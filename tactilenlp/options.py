"""Options of an estimate."""

from __future__ import annotations

from dataclasses import dataclass, field

from .checks import check_types
from .errors import OptionError
from .reduce import Reductions
from .solve import check_positive


@dataclass(frozen=True)
class Options:
    """How to estimate.

    seed: of everything random [-] (nothing is, at present); reduce: True, False, a
    Reductions, or names of reductions to switch off; hypotheses: kept from action to
    action [-]; starts: solved per action [-]; tolerance: of the last solve [-];
    time_limit [s]: then what is left is guessed, and the result is marked; ipopt:
    passed on verbatim; rivals: also solve from other sizes and paths, and with sizes
    held elsewhere, which tells how far those that touch leaves open may be off.
    """

    seed: int = 0
    reduce: object = True
    hypotheses: int = 4
    starts: int = 8
    tolerance: float = 1e-6
    time_limit: float = 600.0
    ipopt: dict = field(default_factory=dict)
    rivals: bool = True

    def __post_init__(self):
        check_types(
            seed=(self.seed, int), ipopt=(self.ipopt, dict), rivals=(self.rivals, bool)
        )
        Reductions.of(self.reduce)
        for name in ("hypotheses", "starts"):
            value = getattr(self, name)
            if not (isinstance(value, int) and value >= 1):
                raise OptionError(
                    "out of range", where=name, got=value, expected="an integer >= 1"
                )
        check_positive(self, "tolerance", "time_limit")
