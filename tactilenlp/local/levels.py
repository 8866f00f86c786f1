"""Levels: by which solves of a continuation a page is solved from a hypothesis."""

from __future__ import annotations

from dataclasses import replace

from formulations.names import COMPLIANCE

HELD_ITERATIONS = 20  # of a level that holds poses
FREED_ITERATIONS = 20  # of the same level with nothing held
FREED_MU = 0.01  # IPOPT's mu_init of that level
RANKING_TOLERANCE = 1e-3  # of a page's solves that only rank hypotheses


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
    free motion, and those for soft fingertips or turned normals, which a search knows
    roughly or not at all.  Where the compliance is unknown, all levels hold it at its
    guess; then the last one is solved again with nothing held.
    """
    contract, levels = job.contract, job.page.LEVELS
    unknown = not job.reductions.rigid and job.scene.compliance is None
    if unknown and "rigid" in contract.freed:
        *held, last = contract.from_guesses
        held = [k.with_ipopt(tol=RANKING_TOLERANCE) for k in held]
        held = [replace(k, fixed=(*k.fixed, COMPLIANCE)) for k in (*held, last)]
        return [*held, last]
    turned = not job.reductions.aligned and "aligned" in contract.freed
    if turned or job.scene.ground is None or job.shape.rolls:  # guesses in a plane
        return contract.from_guesses
    return freed_levels(levels) if job.reductions.planar else levels
