"""Options of an estimate."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..common.validation import check_types
from ..errors import OptionError
from ..nlp.ipopt import check_positive
from ..problem.reductions import Reductions

WIDE, PRECISE = (4, 8), (2, 3)  # hypotheses and starts: noise leaves more of them open


@dataclass(frozen=True)
class Options:
    """How to estimate.

    seed: of everything random [-] (nothing is, at present); reduce: True, False, a
    Reductions, or names of reductions to switch off; hypotheses: kept from action to
    action [-], and starts: solved per action [-], by default as many as the sensors'
    noise leaves open (WIDE, PRECISE); tolerance: of the last solve [-];
    time_limit [s]: then what is left is guessed, and the result is marked; ipopt:
    passed on verbatim; rivals: also solve from other sizes and paths, and with sizes
    held elsewhere, which tells how far those that touch leaves open may be off.
    """

    seed: int = 0
    reduce: object = True
    hypotheses: int | None = None
    starts: int | None = None
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
            if value is not None and not (isinstance(value, int) and value >= 1):
                raise OptionError(
                    "out of range", where=name, got=value, expected="an integer >= 1"
                )
        check_positive(self, "tolerance", "time_limit")

    def widths(self, precise: bool) -> tuple[int, int]:
        """Return hypotheses and starts for sensors that are precise, or for others."""
        kept, solved = PRECISE if precise else WIDE
        return self.hypotheses or kept, self.starts or solved


@dataclass(frozen=True, eq=False)
class Guess:
    """What a user thinks the object is: size and pose at the first sample.

    side_lengths (3,) [m]; position (2,) or (3,) [m]; yaw [rad].
    """

    side_lengths: np.ndarray
    position: np.ndarray
    yaw: float = 0.0
