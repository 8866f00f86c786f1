"""A level of a continuation (homotopy): the data of one solve of a page's problem."""

from __future__ import annotations

from dataclasses import dataclass, field, replace


@dataclass(frozen=True)
class Level:
    """One solve of a sequence; each starts where the one before ended.

    parameters: values by name, in place of those that the page declared.
    fixed: what is held where it starts: names of variables, or arrays of indices of
    unknowns.
    eliminate: the unknowns that `nlp.follow` gives are computed from the others at
    every evaluation (single shooting), not solved for (multiple shooting).
    rebuild: `build` is called again, with the end of the level before as the start, so
    that what it derives from the start (which vertices a contact reads) is updated.
    ipopt: options by their names of IPOPT, as {"mu_init": 1e-3, "max_iter": 400}.
    warm_start: options that change where the solve also starts from the multipliers of
    the level before (warm_start_init_point).  After a level that did not converge,
    `ipopt` is tried first, with these multipliers, then `warm_start`.  None: the
    multipliers are not used, nor are those of a level that holds something fixed.
    """

    name: str
    parameters: dict = field(default_factory=dict)
    fixed: tuple = ()
    eliminate: bool = False
    rebuild: bool = False
    ipopt: dict = field(default_factory=dict)
    warm_start: dict | None = None

    def with_ipopt(self, **options) -> Level:
        """Return this level with some of IPOPT's options changed."""
        return replace(self, ipopt=self.ipopt | options)
