"""Goodness of fit of an identified body: what its likelihood terms cost, and should.

A step costs 4 (sqrt(1 + off / 4) - 1), with off chi-square of six degrees of freedom
under the noise model; the corner in contact, one a step, costs half a chi-square of one
degree, above or below the ground.  Unknown impulses explain a part, so that the
expected costs are upper bounds.  The verdict and the widening are those of
information/goodness_of_fit.py, for the worst of the terms.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..information.goodness_of_fit import MARGIN, Misfit, verdict_of

STEP_MEAN, STEP_SPREAD = 2.24, 1.05  # [nats] of the pseudo-Huber cost of chi-square(6)
TOUCH_MEAN, TOUCH_SPREAD = 0.5, 0.71  # [nats] of half a chi-square(1)
SURFACE_TERMS = ("on the surface", "not below")


@dataclass(frozen=True)
class BodyFit:
    """How well a body explains its motion.

    verdict: "good", "poor" or "bad"; terms: the Misfit of the momentum balance and of
    the heights of the corners; widening: factor of all standard deviations.
    """

    verdict: str
    terms: dict[str, Misfit]
    widening: float

    @property
    def text(self) -> str:
        """The verdict in a sentence, with the term that fits worst."""
        name = max(self.terms, key=lambda key: _excess(self.terms[key]))
        worst = self.terms[name]
        words = (
            f"The fit is {self.verdict}: {name} costs {worst.actual:.0f} nats where at "
            f"most {worst.expected:.0f} ± {worst.spread:.0f} are expected"
        )
        if self.verdict == "good":
            return f"{words}."
        words += f"; standard deviations are multiplied by {self.widening:.1f}"
        bad = ", and the result is not to be trusted" if self.verdict == "bad" else ""
        return f"{words}{bad}."


def fit_of(costs: dict[str, float], steps: int) -> BodyFit:
    """Return the fit of a solution with these costs, by name, of so many steps."""
    balance = sum(cost for name, cost in costs.items() if name.startswith("balance"))
    heights = sum(costs[name] for name in SURFACE_TERMS)
    terms = {
        "the momentum balance": _misfit(balance, steps, STEP_MEAN, STEP_SPREAD),
        "the height of the corners": _misfit(heights, steps, TOUCH_MEAN, TOUCH_SPREAD),
    }
    worst = max(terms.values(), key=_excess)
    verdict, widening = verdict_of(worst)
    return BodyFit(verdict, terms, widening)


def _misfit(actual: float, count: int, mean: float, spread: float) -> Misfit:
    return Misfit(float(actual), mean * count, spread * count**0.5)


def _excess(misfit: Misfit) -> float:
    """Return the excess in spreads."""
    return misfit.excess / (misfit.spread + MARGIN)
