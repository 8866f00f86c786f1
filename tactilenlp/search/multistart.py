"""Multistart with successive halving: a page solved from several hypotheses.

Hypotheses that differ by what least motion made of them often end in one optimum.  The
levels before the last one, solved from each, bring these together.  A start that comes
to the same body as an earlier one is not solved further, nor one that is far behind.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from formulations.indentation import NAME as COMPLIANCE

from ..common.interrupt import interruptible
from ..common.progress import progress
from ..local.hypothesis import same_body
from ..local.local_solve import (
    RANKING_TOLERANCE,
    built_page,
    in_motion_of,
    level_groups,
    solved_from,
)
from ..local.margins import DECISIVE, FAILED_BEHIND, LEAST_MOTION_BEHIND
from ..local.solved import Solves, best_first

log = logging.getLogger("tactilenlp")
HELD_ITERATIONS = 20  # of a level that holds poses
FREED_ITERATIONS = 20  # of the same level with nothing held
FREED_MU = 0.01  # IPOPT's mu_init of that level
RANKED_ITERATIONS = 400  # of a level from every start; the best one is finished


def held_briefly(level):
    """Return a level that holds poses, for few iterations: they are still wrong."""
    return level.with_ipopt(max_iter=HELD_ITERATIONS)


def freed_levels(levels):
    """Return levels that start a continuation from guessed poses.

    What holds poses is solved briefly, then once more with nothing held.
    """
    first = []
    for level in levels:
        if level.fixed:
            free = replace(level, fixed=())
            free = free.with_ipopt(mu_init=FREED_MU, max_iter=FREED_ITERATIONS)
            first += [held_briefly(level), free]
    return [*first, *(level for level in levels if not level.fixed)]


def levels_of(job):
    """Return the levels by which a page is solved from a search's hypothesis.

    From guesses that are far off, those of `ROUGH`, if the page has them: guesses of
    free motion, and those for soft fingertips or turned normals, as the search takes
    fingers for rigid and aligned.  Where the compliance is unknown, all levels hold it
    at its guess; then the last one is solved again with nothing held.  A page without
    `ROUGH` takes the last one alone: it is then solved from the optimum of ideal
    fingertips.
    """
    contract, page = job.contract, job.page
    unknown = not job.reductions.rigid and job.scene.compliance is None
    guess_levels = contract.rough or page.LEVELS[-1:]
    if unknown and "rigid" in contract.freed:
        held = [replace(k, fixed=(*k.fixed, COMPLIANCE)) for k in guess_levels]
        held[:-1] = [k.with_ipopt(tol=RANKING_TOLERANCE) for k in held[:-1]]
        return [*held, guess_levels[-1]]
    if not job.reductions.aligned and "aligned" in contract.freed:
        return guess_levels
    if job.scene.ground is None or job.shape.rolls:  # guesses in a plane
        return contract.from_guesses
    planar = job.reductions.planar
    return freed_levels(page.LEVELS) if planar else page.LEVELS


def multistart(job, hypotheses, levels, earlier=(), solves=None) -> list:
    """Return the page solved from hypotheses, the best first, each optimum once.

    levels: of the page, solved in two rounds, the last one by itself; earlier: solves
    that the new ones compete with; solves: where results are added, those before
    the last level as provisional ones.
    """
    solves, last = solves or Solves(), levels[-1]
    levels = [ranking(level) for level in levels]
    with interruptible():
        _multistart(job, hypotheses, levels, earlier, solves)
        if levels[-1] is not last:
            _finish(job, last, earlier, solves)
    return best_first(solves.ended)


def _multistart(job, hypotheses, levels, earlier, solves) -> None:
    """Add solves before the last level as provisional ones, and those after it."""
    provisional = solves.provisional()
    built = None  # each stage ends with a level that holds no poses
    stages = level_groups(levels[:-1], lambda before, _: "x" not in before.fixed)
    stage_ends = [[] for _ in stages]
    separate = len(levels) == 1 or "x" in levels[-2].fixed or levels[-1].rebuild
    separate = separate or not job.reductions.planar
    for h in progress(hypotheses, "solve"):
        any_ended = earlier or solves.ended or provisional.ended
        if any_ended and job.deadline.passed("all hypotheses"):
            break
        if built is None or job.shape.window_depends_on_start:
            built = built_page(job, in_motion_of(job, h))
        if separate:  # held or free poses do not come together before the last level
            solves.add(solved_from(job, h, built, levels))
            continue
        end, first = _solved_stages(job, h, built, stages, stage_ends)
        if first is None:
            provisional.add(end)
        elif first is min(provisional.ended, key=lambda s: s.at.rank).hypothesis:
            log.info("two starts lead to the best optimum: no others are solved")
            break
    earlier_ends = [end for s in earlier for end in (s.at, s.before_last_level) if end]
    for s in sorted(provisional.ended, key=lambda s: s.at.rank):
        known = [*earlier, *solves.ended]
        if known and job.deadline.passed("all hypotheses"):
            break
        if any(same_body(job.shape, s.at, end) for end in earlier_ends):
            continue
        good = [k.solution.objective for k in known if k.solution.success]
        margin = LEAST_MOTION_BEHIND if s.solution.success else FAILED_BEHIND
        if s.solution.objective > min(good, default=np.inf) + margin:
            continue  # too far behind the best to be solved to the end
        end = solved_from(job, s.hypothesis, s.built, levels[-1:], s.solution)
        solves.add(replace(end, before_last_level=s.at))
        earlier_ends.append(s.at)


def ranking(level):
    """Return a level with few enough iterations to be solved from every start."""
    if level.ipopt.get("max_iter", 0) <= RANKED_ITERATIONS or level.rebuild:
        return level
    return level.with_ipopt(max_iter=RANKED_ITERATIONS)


def _finish(job, level, earlier, solves) -> None:
    """Solve the best start to the end, if it is unfinished and ahead of the others."""
    ended = [s.cost for s in (*earlier, *solves.ended) if s.solution.success]
    ahead = [s for s in solves.ended if not s.solution.success]
    ahead = [s for s in ahead if s.cost < min(ended, default=np.inf) - DECISIVE]
    if ahead and not job.deadline.passed("an unfinished solve of the page"):
        best = min(ahead, key=lambda s: s.cost)
        end = solved_from(job, best.hypothesis, best.built, [level], best.solution)
        solves.exchange(best, replace(end, before_last_level=best.before_last_level))


def _solved_stages(job, h, built, stages, stage_ends):
    """Solve the stages one after another; return the last solve, and None.

    Where a stage ends at the same body as an earlier start did at that stage, the rest
    is skipped, and that start is returned as second: nearly all starts of soft
    fingertips come together at the first one (18 of 18, results/EXPERIMENTS.md).
    stage_ends: of each stage, (start, Hypothesis there) of converged solves; extended.
    """
    solved = None
    for levels, ends in zip(stages, stage_ends, strict=True):
        before = None if solved is None else solved.solution
        solved = solved_from(job, h, built, levels, before)
        if not solved.solution.success:
            continue
        for start, end in ends:
            if same_body(job.shape, solved.at, end):
                return solved, start
        ends.append((h, solved.at))
    return solved, None
