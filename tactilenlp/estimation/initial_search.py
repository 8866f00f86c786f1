"""Initial search: hypotheses from which the page starts, by the class of the shape.

In the frame of the first touch, boxes and other shapes with sizes are tracked
(search/multi_hypothesis.py), polytopes by supporting planes (search/polytope_init.py).
"""

from __future__ import annotations

from dataclasses import replace

from ..data.ground import frame_of
from ..interface.request import Request, first_guess
from ..interface.session import Guess
from ..local.local_solve import built_page
from ..nlp.term_functions import default_cache
from ..problem.hypothesis import Hypothesis
from ..problem.job import Job
from ..problem.reductions import Reductions
from ..search.contact_frame import ContactFrame
from ..search.multi_hypothesis import TrackingSearch
from ..search.polytope_init import search_polytope
from ..search.proposals_floating import (
    in_free_motion,
    in_plane,
    in_search_plane,
    search_plane,
    with_faces_tracked,
    with_tilted_normals,
)
from .interrupted import Incumbents

SEARCH_END, REFINEMENT_END = 0.5, 0.85  # [-] of the time until the readout
AMPLE = 60.0  # [s] with less time the search comes before what the page compiles


def initial_hypotheses(
    request: Request, incumbents: Incumbents, search: TrackingSearch | None = None
) -> tuple[list[Hypothesis], list[Hypothesis]]:
    """Return hypotheses for the next action, and the same as the page starts from them.

    incumbents: hypotheses to continue, then of the actions done so far; search: one
    that was begun.  A floating object is searched in the plane of its touches.
    """
    start, plane = request.start, None
    if (hypothesis := request.job.search.hypothesis) is not None:
        return [hypothesis], [hypothesis]
    if search is not None:
        hypotheses = search.starts()
        return hypotheses, hypotheses
    reduced = reduced_job(request)
    if reduced.scene.ground is None:
        plane = search_plane(reduced, start if isinstance(start, Guess) else None)
        reduced = in_search_plane(reduced, plane)
    if not reduced.shape.of_vertices:
        hypotheses = search_in_contact_frame(request, reduced, incumbents).starts()
    elif plane is None:
        hypotheses = _search_polytope_in_contact_frame(reduced, incumbents)
    else:
        hypotheses = _search_floating_polytope(reduced, plane, incumbents)
    if plane is None:
        return hypotheses, hypotheses
    starts = [in_free_motion(h, plane, reduced.shape) for h in hypotheses]
    if reduced.shape.of_vertices:
        starts += [with_faces_tracked(h, request.job.data) for h in starts]
    return hypotheses, starts


def reduced_job(request: Request) -> Job:
    """Return the job of a search: reduced, whatever the last solve does.

    Of a polytope it may be of soft fingertips.
    """
    job = request.job_until(SEARCH_END, strict=False)
    rigid = job.reductions.rigid or not job.shape.of_vertices
    return replace(job, reductions=Reductions(rigid=rigid))


def _search_floating_polytope(job, plane, incumbents) -> list[Hypothesis]:
    """Return hypotheses of a polytope in a plane, and one that may tilt out of it."""
    kept = [in_plane(h, plane) for h in incumbents.kept]
    hypotheses = search_polytope(job, kept, incumbents.keep)
    other, *_ = search_polytope(with_tilted_normals(job), kept, incumbents.keep)
    # Its objective is of wider normals and not comparable: it takes that of the first.
    return [*hypotheses, replace(other, objective=hypotheses[0].objective)]


def search_in_contact_frame(request: Request, job: Job, incumbents) -> TrackingSearch:
    """Return the search for a shape with sizes, in the frame of the first touch.

    job: with reductions of its own; incumbents: as of `initial_hypotheses`.
    """
    guess = first_guess(request.start, job.shape, frame_of(job.scene.ground))
    job = job.with_search(guess=guess)
    if not default_cache().functions_by_key and job.deadline.left > AMPLE:
        built_page(request.job)  # its compilers run beside the search
    frame = ContactFrame.of(job)
    job, in_frame = frame.job(job), tuple(frame.into(h) for h in incumbents.kept)
    return TrackingSearch(
        job, in_frame, request.widths[1], request.executor, keep=incumbents.keep,
        out_of=frame.out_of,
    )  # fmt: skip


def _search_polytope_in_contact_frame(job: Job, incumbents) -> list[Hypothesis]:
    """Return hypotheses of a polytope, searched in the frame of the first touch.

    Its axes are those of the ground at the last sample, whose pose the page holds.
    """
    frame = ContactFrame.of(job)
    found = search_polytope(
        frame.job(job), [frame.into(h) for h in incumbents.kept],
        lambda kept: incumbents.keep([frame.out_of(h) for h in kept]),
    )  # fmt: skip
    return [frame.out_of(h).with_axes_of_ground()[0] for h in found]
