"""Free what a page holds fixed where the data ask for it: selection of nested models.

A nuisance parameter that is fixed by default (fingertips are rigid) is freed from the
optimum of the smaller model, by one warm-started solve.  It is kept free where that
lowers the objective by REASON nats or more: the Laplace evidence of the larger model
is lower by the logarithm of the ratio of prior to posterior deviation, about three.
"""

from __future__ import annotations

import logging
from dataclasses import replace

from ..problem.certificates import Skipped
from ..search.local_solve import (
    CLOSE,
    REASON,
    Solved,
    best_first,
    gone_on,
    settings_of,
)

log = logging.getLogger("tactilenlp")


def may_be_soft(job, page) -> bool:
    """Tell whether fingertips are rigid by assumption, and a page can free them."""
    unknown = job.scene.compliance is None and job.reductions.rigid
    return unknown and getattr(page, "COMPLIANT", False)


def with_soft_fingertips(job, page, solved, options, solve) -> tuple:
    """Return job and solves, best first; the compliance is free where data ask for it.

    solved: with rigid fingertips, best first; solve(job): solves the page of a job from
    all starts of the search.
    """
    best = solved[0]
    if not (may_be_soft(job, page) and best.solution.success):
        return job, solved
    soft = replace(job, reductions=replace(job.reductions, rigid=False))
    freed = gone_on(soft, page, best, settings_of(job, options), CLOSE)
    gain = best.solution.objective - freed.solution.objective
    if not freed.solution.success or gain < REASON:
        return job, [declined(best, gain), *solved[1:]]
    log.info("fingertips are soft: the objective falls by %.1f nats", gain)
    return soft, best_first([freed, *solve(soft)])


def declined(solved: Solved, gain: float) -> Solved:
    """Return a solve with the certificate that rigid fingertips explain the touches."""
    skipped = Skipped(
        "rigid", "compliance of the fingertips", "they are rigid unless touches say so",
        "freeing it would lower the objective by [nats]", gain, REASON, gain < REASON,
    )  # fmt: skip
    return replace(solved, declined=(skipped,))
