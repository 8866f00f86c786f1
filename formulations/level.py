"""A level of a homotopy: what a page tells the machine about one solve."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Level:
    """One solve: parameter values by name, variables held fixed, IPOPT's first mu.

    eliminate: unknowns that `nlp.follow` gives are computed from the others at every
    evaluation (single shooting), instead of solved for (multiple shooting).  warm:
    the level before leaves its multipliers, and IPOPT's first mu is this, or first
    `barrier` where that level did not converge; None: they are not taken, nor after a
    level that holds something fixed.  anew: the page is filled again where the level
    before ended: what it chose by where it started, as which vertices a contact reads,
    is chosen again.
    """

    name: str
    parameters: dict = field(default_factory=dict)
    fixed: tuple[str, ...] = ()
    barrier: float = 1e-2
    iterations: int = 200
    eliminate: bool = False
    warm: float | None = None
    anew: bool = False
