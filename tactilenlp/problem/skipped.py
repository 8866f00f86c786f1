"""What was left out of a page, and how that was checked after the solve."""

from __future__ import annotations

from dataclasses import dataclass

from .reductions import REDUCTION_NAMES


@dataclass(frozen=True)
class Skipped:
    """One reduction: what was dropped, why, and the check after the solve.

    value is compared with limit (same unit, stated in `check`); `holds`: the verdict.
    """

    name: str
    dropped: str
    reason: str
    check: str
    value: float
    limit: float
    holds: bool

    def __str__(self) -> str:
        named = self.name in REDUCTION_NAMES
        remedy = f' (Options(without="{self.name}") does not make it)' if named else ""
        verdict = "holds" if self.holds else f"DOES NOT HOLD{remedy}"
        return (
            f"{self.name}: {self.dropped} ({self.reason}); {self.check} "
            f"{self.value:.2g}, limit {self.limit:.2g}: {verdict}"
        )


@dataclass(frozen=True)
class Certificates:
    """Every reduction that was made, with its check.

    cuts: samples that need a pose of their own, where a still span does not hold.
    """

    skipped: tuple[Skipped, ...]
    cuts: tuple[int, ...] = ()

    @property
    def broken(self) -> tuple[str, ...]:
        """The names of the reductions that do not hold."""
        return tuple(s.name for s in self.skipped if not s.holds)
