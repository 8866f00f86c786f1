"""Certificates of a solved page, and the further solves that they ask for.

What the reductions dropped is checked at the solution; what was needed is restored and
the page solved again.  Where the data contradict sliding on the ground, the object
tumbled and is solved in free motion.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from ..certificates.certify import LEFT_OUT, certify
from ..certificates.outliers import unexplained_by_action
from ..geometry.transforms import rotation_matrix
from ..local.comparison import same_body
from ..local.local_solve import (
    built_page,
    freed_to_tilt,
    in_motion_of,
    solved_from,
    warm_started,
)
from ..local.margins import DECISIVE, RESTORED
from ..local.solved import Solved, comparable
from ..problem.reductions import states_planar_motion
from ..search.multistart import ranking
from ..search.proposals_tumble import tumbling_motions
from .axis_names import in_canonical_axes, solve_in_canonical_axes
from .ground_tilt import estimate_ground_tilt
from .model_selection import most_probable
from .profile_deviation import VAGUE_SHARE
from .profile_likelihood import (
    PROFILE_MU,
    profile_deviations,
    untouched_height_sigma,
)
from .rocking_body import explains_touches, solve_tilted

log = logging.getLogger("tactilenlp")
MAX_RESTORED = 2  # solves with reductions restored
MAX_TUMBLE_SOLVES = 6  # proposals of a tumble that are solved: some diverge


def solve_other_motions(job, flat: Solved, executor=None) -> Solved:
    """Return a certified solve, or one in free motion if the body did not only slide.

    Tilted where that explains touches, or as it tumbled where a tilt does not.  job: as
    it was before reductions were restored.
    """
    tilted = solve_tilted(flat)
    if tilted is not flat:
        tilted = estimate_ground_tilt([tilted])[0]
    fell = "planar" in flat.certificates.broken and not states_planar_motion(job.page)
    fell = fell and (tilted is flat or not explains_touches(tilted))
    if fell and job.shape.faced and not job.deadline.passed("a tumble"):
        tumbled = _solve_tumbles(job, flat, tilted.solution.objective, executor)
        if tumbled is not None and tumbled.rank < tilted.rank:
            return tumbled
    return flat if tilted is flat else restore_reductions(tilted)


def solve_profiles(best) -> Solved:
    """Return a solve with profile likelihoods, if Options asks for them.

    Where one of its solves meets a better optimum, that one, if it stays better with
    nothing held; in free motion, where flat poses alone tell the height.
    """
    slid = best.solution.success and "planar" not in best.certificates.broken
    job = best.job
    if not (slid and job.options.profile_likelihood):
        return best
    if job.deadline.passed("profile likelihoods"):
        return best
    profile, better = profile_deviations(best)
    if better is not None:
        again = restore_reductions(warm_started(job, better, PROFILE_MU))
        best = again if again.rank < best.rank else best
        profile, _ = profile_deviations(best, seeks=False)
    return solve_with_height_open(replace(best, profile=profile))


def solve_with_height_open(flat) -> Solved:
    """Return a solve with profiles: in free motion where this opens a height, or flat.

    Felt normals lean where fingers meet the rim of the top, which tells the height of a
    flat body, and where the body tilts, which leaves it open.  The evidence of free
    motion is larger by what the objective falls, and by the log of how much wider the
    height is: as any larger model, it must be decisively likelier.
    """
    told = untouched_height_sigma(flat)
    if told is None or told >= VAGUE_SHARE * flat.job.shape.typical_deviation:
        return flat
    if not flat.job.fixes("planar") or flat.job.deadline.passed("a height left open"):
        return flat
    free = flat.job.with_reductions(planar=False)
    tilted = restore_reductions(freed_to_tilt(free, flat))
    if not tilted.solution.success:
        return flat
    profile, _ = profile_deviations(tilted, seeks=False)
    tilted = replace(tilted, profile=profile)
    if (wider := untouched_height_sigma(tilted)) is None:
        return flat
    gain = flat.solution.objective - tilted.solution.objective + np.log(wider / told)
    log.info("a tilt that leaves the height open is likelier by %.1f nats", gain)
    return tilted if gain > DECISIVE else flat


def restore_reductions(solved) -> Solved:
    """Certify what was dropped; restore what was needed, and solve again.

    Rest intervals are first cut where the body would move, and dropped if that was not
    enough.
    """
    job = solved.job
    if job.deadline.passed("certificates"):
        return solved
    certificates = certify(job, solved)
    for _ in range(MAX_RESTORED):
        back = [name for name in certificates.broken if name != "planar"]
        if not back or job.deadline.passed("restored reductions"):
            break
        log.info("restoring reductions that do not hold: %s", ", ".join(back))
        more = {*certificates.cuts, *job.cuts}
        if certificates.cuts and (not job.cuts or job.shape.of_vertices):
            job = replace(job, cuts=tuple(sorted(more)))
            back.remove("still")
        job = job.with_reductions(**dict.fromkeys(back, False))
        again = warm_started(job, solved)
        if not again.solution.success:
            again = replace(solved_from(job, solved.at), declined=solved.declined)
        worse = again.solution.objective > solved.solution.objective + RESTORED
        if worse or again.solution.success < solved.solution.success:
            break  # the certificates state what does not hold
        solved, certificates = again, certify(job, again)
    return replace(solved, certificates=certificates)


def certified(best: Solved, solved, like, certify) -> tuple[Solved, list[Solved]]:
    """Return the most probable solve, certified, its axes named; and all that compete.

    best: the most probable one; like: see `canonical_relabelling`; certify(solved): a
    solve with certificates, or a better one.  What is restored for it is restored for
    all; if another one is the most probable then, that one is certified.
    """
    likeliest, best = best, None
    while likeliest is not best:
        others = [s for s in solved if s is not likeliest]
        flat = solve_in_canonical_axes(likeliest, like)
        best = certify(flat)
        if best.window.motion is not flat.window.motion:
            return best, [flat, *others]
        solved, likeliest = [best, *others], best
        with best.job.deadline.ending("evidence of other optima"):
            solved = [best, *restored_as(best, others)]
            likeliest = most_probable(solved)
    return best, solved


def restored_as(best: Solved, others) -> list[Solved]:
    """Return other solves, those of some weight with what was restored for the best.

    Objectives are compared with the same left out.  The same body is no other one.
    """
    shape, made, cuts = best.job.shape, best.job.reductions, best.job.cuts
    left_out = {name: getattr(made, name) for name in LEFT_OUT}
    several, solves = comparable(best, others), []
    for s in others:
        if s in several and same_body(shape, s.at, best.at):
            continue
        job = replace(s.job.with_reductions(**left_out), cuts=cuts)
        alike = job.reductions == s.job.reductions and cuts == s.job.cuts
        kept = s not in several or alike
        late = not kept and job.deadline.passed("restored reductions of other optima")
        solves.append(s if kept or late else warm_started(job, s))
    return solves


def _solve_tumbles(job, flat, limit: float, executor) -> Solved | None:
    """Return the best proposal of a tumble, solved in free motion; None if none is.

    limit: the objective to beat [nats].  The first level that moves poses has softer
    weights: what costs more there is not solved further.
    """
    evidence = unexplained_by_action(job, flat)
    motions = tumbling_motions(
        job, evidence, *job.options.widths(precise=False), executor
    )
    free, best = job.with_reductions(planar=False), None
    levels = [ranking(level) for level in job.contract.from_guesses]
    first = 1 + next(k for k, level in enumerate(levels) if "x" not in level.fixed)
    like = flat.at.theta, rotation_matrix(flat.at.x[:, 0])
    for h in motions[:MAX_TUMBLE_SOLVES]:
        h = in_canonical_axes(job.shape, h, like)
        built = built_page(free, in_motion_of(free, h))
        tumbled = solved_from(free, h, built, levels[:first])
        if levels[first:] and tumbled.solution.objective < limit:
            before = tumbled.solution
            tumbled = solved_from(free, h, built, levels[first:], before)
        if tumbled.solution.success and tumbled.solution.objective < limit:
            best, limit = tumbled, tumbled.solution.objective
    return best and replace(best, certificates=certify(free, best))
