"""Multistart with successive halving: a page solved from several hypotheses.

Hypotheses that differ by what least motion made of them often end in one optimum.  The
levels before the last one, solved from each, bring these together.  A start that comes
to the same body as an earlier one is not solved further, nor one that is far behind.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..common.interrupt import interruptible
from ..common.progress import progress
from ..local.comparison import same_body
from ..local.local_solve import (
    after_soft_fingertips,
    built_page,
    in_motion_of,
    level_groups,
    solved_from,
)
from ..local.margins import DECISIVE, FAILED_BEHIND, LEAST_MOTION_BEHIND
from ..local.solved import BuiltPage, Solved, Solves, best_first

log = logging.getLogger("tactilenlp")
RANKED_ITERATIONS = 400  # of a level from every start; the best one is finished


def multistart(job, hypotheses, levels, earlier=(), solves=None) -> list:
    """Return the page solved from hypotheses, the best first, each optimum once.

    levels: of the page, solved in two rounds, the last one by itself; earlier: solves
    that the new ones compete with; solves: where results are added, those before
    the last level as provisional ones.
    """
    solves, ranked = solves or Solves(), [ranking(level) for level in levels]
    provisional = solves.provisional()
    separate = len(levels) == 1 or "x" in levels[-2].fixed or levels[-1].rebuild
    with interruptible():
        # Held or free poses do not come together before the last level.
        if separate or not job.reductions.planar:
            _solve_separately(job, hypotheses, ranked, earlier, solves)
        else:
            _solve_until_alike(job, hypotheses, ranked[:-1], earlier, provisional)
        _solve_last_level(job, provisional.ended, ranked[-1:], earlier, solves)
        if ranked[-1] is not levels[-1]:
            _finish_best(job, levels[-1], earlier, solves)
    return best_first(solves.ended)


def ranking(level):
    """Return a level with few enough iterations to be solved from every start."""
    if level.ipopt.get("max_iter", 0) <= RANKED_ITERATIONS or level.rebuild:
        return level
    return level.with_ipopt(max_iter=RANKED_ITERATIONS)


def _in_time(job, hypotheses, earlier, solves) -> Iterator:
    """Yield hypotheses in turn, while time is left for another."""
    for h in progress(hypotheses, "solve"):
        if (earlier or solves.ended) and job.deadline.passed("all hypotheses"):
            break
        yield h


def _solve_separately(job, hypotheses, levels, earlier, solves) -> None:
    """Solve all levels from each hypothesis; of a polytope after soft fingertips."""
    page, soft_first = None, job.contract.extends and job.fixes("rigid")
    for h in _in_time(job, hypotheses, earlier, solves):
        if soft_first:
            solves.add(after_soft_fingertips(job, h, levels))
            continue
        page = _page_from(job, h, page)
        solves.add(solved_from(job, h, page, levels))


def _page_from(job, h, before) -> BuiltPage:
    """Return the page built for a hypothesis: of shapes with sizes that of any other.

    before: one that was built, or None.
    """
    if before is not None and not job.shape.of_vertices:
        return before
    return built_page(job, in_motion_of(job, h))


def _solve_until_alike(job, hypotheses, levels, earlier, provisional) -> None:
    """Add the solve from each hypothesis that comes to another body than those before.

    Once two of them lead to the best one, no others are solved.
    """
    # Each stage ends with a level that holds no poses.
    stages, starts = level_groups(levels, lambda before, _: "x" not in before.fixed), []
    page = None
    for h in _in_time(job, hypotheses, earlier, provisional):
        page = _page_from(job, h, page)
        solved, ends, alike = _solve_stages(job, h, page, stages, starts)
        starts.append((solved, ends))
        if alike is None:
            provisional.add(solved)
        elif alike is min(provisional.ended, key=lambda s: s.at.rank):
            log.info("two starts lead to the best optimum: no others are solved")
            break


def _solve_stages(job, h, built, stages, starts) -> tuple[Solved, list, Solved | None]:
    """Solve the stages one after another; return the last solve, and where each ended.

    The third result is the solve from an earlier start, if a stage ends at the same
    body as that start did at that stage: the rest is skipped. Nearly all starts of
    soft fingertips come together at the first one (18 of 18,
    results/EXPERIMENTS.md). starts: last solve and ends of each; an end of a failed
    solve is None.
    """
    solved, ends = None, []
    for levels in stages:
        solution = None if solved is None else solved.solution
        solved = solved_from(job, h, built, levels, solution)
        end = solved.at if solved.solution.success else None
        for earlier, others in starts if end else ():
            other = others[len(ends)] if len(ends) < len(others) else None
            if other and same_body(job.shape, end, other):
                return solved, ends, earlier
        ends.append(end)
    return solved, ends, None


def _solve_last_level(job, provisional, last, earlier, solves) -> None:
    """Solve the last level from provisional solves, from each body once, best first.

    Not from those that are too far behind the best to be solved to the end.
    """
    ends = [end for s in earlier for end in (s.at, s.before_last_level) if end]
    for s in sorted(provisional, key=lambda s: s.at.rank):
        done = [*earlier, *solves.ended]
        if done and job.deadline.passed("all hypotheses"):
            break
        best = min(
            (d.solution.objective for d in done if d.solution.success), default=np.inf
        )
        margin = LEAST_MOTION_BEHIND if s.solution.success else FAILED_BEHIND
        if s.solution.objective > best + margin:
            continue
        if any(same_body(job.shape, s.at, end) for end in ends):
            continue
        end = solved_from(job, s.hypothesis, s.built, last, s.solution)
        solves.add(replace(end, before_last_level=s.at))
        ends.append(s.at)


def _finish_best(job, level, earlier, solves) -> None:
    """Solve the best start to the end, if it is unfinished and ahead of the others."""
    ended = [s.cost for s in (*earlier, *solves.ended) if s.solution.success]
    ahead = [s for s in solves.ended if not s.solution.success]
    ahead = [s for s in ahead if s.cost < min(ended, default=np.inf) - DECISIVE]
    if ahead and not job.deadline.passed("an unfinished solve of the page"):
        best = min(ahead, key=lambda s: s.cost)
        end = solved_from(job, best.hypothesis, best.built, [level], best.solution)
        solves.exchange(best, replace(end, before_last_level=best.before_last_level))
