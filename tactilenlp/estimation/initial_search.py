"""Initial search: hypotheses from which the page starts, by the class of the shape.

Boxes and other shapes with sizes are tracked (search/multi_hypothesis.py), polytopes by
supporting planes (search/polytope_init.py).
"""

from __future__ import annotations

from dataclasses import replace

from ..interface.options import Guess
from ..interface.readout import name_of
from ..interface.request import Request, first_guess
from ..interface.result import Estimate
from ..nlp.term_functions import default_cache
from ..problem.reductions import Reductions
from ..search.hypothesis import Hypothesis
from ..search.local_solve import problem_at
from ..search.multi_hypothesis import search_boxes
from ..search.polytope_init import search_polytope
from ..search.proposals_floating import (
    in_free_motion,
    in_plane,
    in_search_plane,
    search_plane,
    with_faces_tracked,
    with_tilted_normals,
)
from .contact_frame import ContactFrame

SEARCH_END = 0.5  # [-] of the time until the readout, at which the search ends
AMPLE = 60.0  # [s] with less time the search comes before what the page compiles


def searched(request: Request, kept) -> tuple[list[Hypothesis], list[Hypothesis]]:
    """Return hypotheses for the next action, and the same as the page starts from them.

    kept: a list of those to begin with; holds those of the actions done so far.  A
    floating object is searched in the plane of its touches.
    """
    start, plane = request.start, None
    if (path := request.job.path) is not None:
        return [path], [path]
    job = request.job_until(SEARCH_END, strict=False)
    reduced = replace(job, reductions=Reductions())  # whatever the last solve does
    if job.scene.ground is None:
        plane = search_plane(job, start if isinstance(start, Guess) else None)
        reduced = in_search_plane(reduced, plane)
    search = {"sizes": _search_sizes, "vertices": _search_vertices}
    found = search[job.shape.parameters](request, reduced, plane, kept)
    if plane is None:
        return found, found
    starts = [in_free_motion(h, plane, job.shape) for h in found]
    if job.shape.last_pose_held:
        starts += [with_faces_tracked(h, job.data) for h in starts]
    return found, starts


def _search_sizes(request: Request, job, _, kept) -> list[Hypothesis]:
    """Return hypotheses of a shape with sizes: multi-hypothesis tracking.

    What another page found, or a search that was interrupted, is no posterior of this
    page: all actions are tracked again.
    """
    start, starts = request.start, request.widths[1]
    job = replace(job, first=first_guess(start, job.shape))
    if isinstance(start, Estimate) and start.formulation != name_of(request.job.page):
        kept[:] = []
    if not default_cache().functions and job.deadline.left > AMPLE:
        problem_at(request.job)  # its compilers run beside the search
    frame = ContactFrame.of(job, kept)
    found = [frame.into(h) for h in kept]
    given = frame.job(job), found, starts, request.executor
    try:
        found = search_boxes(*given, so_far=found)
    finally:  # also by Ctrl-C
        kept[:] = [frame.out_of(h) for h in found]
    return kept


def _search_vertices(_, job, plane, kept) -> list[Hypothesis]:
    """Return hypotheses of a polytope: poses and planes, then its vertices."""
    if plane is None:
        return search_polytope(job, kept, so_far=kept)
    kept[:] = [in_plane(h, plane) for h in kept]
    found = search_polytope(job, kept, so_far=kept)
    (other,) = search_polytope(with_tilted_normals(job), kept, so_far=kept)
    # Its objective is of wider normals and not comparable: it takes that of the first.
    return [*found, replace(other, objective=found[0].objective)]
