"""Options of an estimate."""

from __future__ import annotations

import warnings
from dataclasses import InitVar, dataclass, field

from ..common.validation import check_types, check_whole
from ..errors import OptionError, shortened, typed_call
from ..solvers.options import check_positive
from .reductions import REDUCTION_NAMES, Reductions

MOST_STARTS = 1_000_000  # [-] hypotheses or starts
# (hypotheses, starts) for noisy, for precise sensors.  Of 22 noisy recordings four
# starts end higher than six in one, by 0.2 nats; three miss that of a poor guess.
NOISY_WIDTHS, PRECISE_WIDTHS = (4, 5), (2, 4)
# Of noisy sensors whose trajectory is doubtful: of nine such recordings five end 5 to
# 20 nats lower than with NOISY_WIDTHS, one ends 4 nats higher.
DOUBTFUL_WIDTHS = (8, 10)


@typed_call()
@dataclass(frozen=True)
class Options:
    """How to estimate.

    hypotheses: [-], kept for an update; by default by the sensors' noise, as starts
    starts: [-], of the page, per estimate (NOISY_WIDTHS, PRECISE_WIDTHS; of a search
        action by action DOUBTFUL_WIDTHS), from 2 on one more where the yaw is open
    tolerance: [-], of the optimality conditions of the last solve, scaled
    time_limit: [s], of all, compilation included, kept within 10 % or 1 s: actions not
        searched are extrapolated; the status says what was left out
    ipopt: options by IPOPT's names; with one that is no field of
        solvers.options.Settings, IPOPT solves everything
    profile_likelihood: hold each size that no touch determines, a position and a yaw
        away from the optimum, and solve again: gives these a sigma, and may meet a
        better optimum
    check_mistakes: refuse measurements in which axes, signs, units, fingers or times
        are probably wrong (MistakeError); name a likely mistake where the fit is not
        good
    without: names of reductions not to make: ("planar",) for what may tilt
    Of older versions, each with a FutureWarning:
    reduce: is turned into `without`: the same names, False for all, or a Reductions
    rivals: is turned into `profile_likelihood`
    seed: has no effect
    """

    hypotheses: int | None = None
    starts: int | None = None
    tolerance: float = 1e-6
    time_limit: float = 600.0
    ipopt: dict = field(default_factory=dict)
    profile_likelihood: bool = True
    check_mistakes: bool = True
    without: object = ()
    reduce: InitVar[object] = True
    rivals: InitVar[object] = None
    seed: InitVar[object] = None

    def __post_init__(self, reduce, rivals, seed):
        check_types(
            ipopt=(self.ipopt, dict), check_mistakes=(self.check_mistakes, bool),
            profile_likelihood=(self.profile_likelihood, bool),
            rivals=(rivals, (bool, type(None))), seed=(seed, (int, type(None))),
        )  # fmt: skip
        if seed is not None:
            words = "Options.seed has no effect: an estimate draws from a fixed seed"
            warnings.warn(words, FutureWarning, stacklevel=4)
        if rivals is not None:
            words = "Options(rivals=) is profile_likelihood="
            warnings.warn(words, FutureWarning, stacklevel=4)
            object.__setattr__(self, "profile_likelihood", rivals)
        without = self.without if reduce is True else self._without_by(reduce)
        Reductions.of(without)
        names = (without,) if isinstance(without, str) else tuple(without)
        object.__setattr__(self, "without", names)
        for name in ("hypotheses", "starts"):
            if (value := getattr(self, name)) is not None:
                check_whole(name, value, 1, MOST_STARTS)
        check_positive(self, "tolerance", "time_limit")

    def _without_by(self, reduce):
        """Return what `reduce` is as `without`, with a FutureWarning."""
        if self.without:
            raise OptionError(
                "two choices of reductions", where="without",
                got=shortened(self.without, most=80), next="leave reduce out",
            )  # fmt: skip
        warnings.warn("Options(reduce=) is without=", FutureWarning, stacklevel=5)
        if isinstance(reduce, Reductions):
            return [name for name in REDUCTION_NAMES if not getattr(reduce, name)]
        return REDUCTION_NAMES if reduce is False else reduce

    @property
    def reductions(self) -> Reductions:
        """The reductions that may be made."""
        return Reductions.of(self.without)

    def widths(self, precise: bool, doubtful=False) -> tuple[int, int]:
        """Return hypotheses and starts for sensors that are precise, or for others.

        doubtful: whether an earlier search may have lost the trajectory.
        """
        noisy = DOUBTFUL_WIDTHS if doubtful else NOISY_WIDTHS
        kept, solved = PRECISE_WIDTHS if precise else noisy
        return self.hypotheses or kept, self.starts or solved
