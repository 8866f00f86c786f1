"""Initial search: hypotheses from which the page starts, by the class of the shape.

In the frame of the first touch, boxes and other shapes with sizes are tracked
(search/multi_hypothesis.py), polytopes by supporting planes (search/polytope_init.py).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..data.contact_segments import first_contact, first_onset
from ..data.ground import frame_of
from ..data.joint_offsets import JointZeros
from ..geometry.transforms import move_poses, planar_matrix
from ..interface.request import Request, first_guess
from ..interface.session import Guess
from ..local.local_solve import built_page
from ..nlp.term_functions import default_cache
from ..problem.hypothesis import Hypothesis
from ..problem.job import Job
from ..problem.reductions import Reductions
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
from ..tracking.initial_states import TOP_TILT
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


@dataclass(frozen=True, eq=False)
class ContactFrame:
    """The frame of the first touch: its pose (3,) on the ground, x, y [m], yaw [rad].

    Its origin is the touched point, its x axis the normal that was felt there, or the
    way of a finger that touched the top: what a search draws, rounds and compares does
    not depend on where the world's axes are.
    """

    pose: np.ndarray

    @classmethod
    def of(cls, job: Job) -> ContactFrame:
        """Return the frame of a job's first touch; for errors of joints the world's."""
        if isinstance(job.scene.sigma_offset, JointZeros):
            return cls(np.zeros(3))
        p, ahead = first_contact(job.data)
        if np.hypot(ahead[0], ahead[1]) <= TOP_TILT:
            t, f = first_onset(job.data)
            places = job.data.finger_position[job.data.action == job.data.action[t], f]
            ahead = places[-1] - places[0]
        return cls(np.r_[p[:2], np.arctan2(ahead[1], ahead[0])])

    def job(self, job: Job) -> Job:
        """Return the job with its measurements and its guess in this frame."""
        R = planar_matrix(-self.pose[2])
        t = -R @ np.array([*self.pose[:2], 0.0])
        guess = job.search.guess
        job = job.with_search(guess=None if guess is None else self.into(guess))
        return replace(job, data=job.data.transformed(R, t))

    def into(self, h: Hypothesis) -> Hypothesis:
        """Return a hypothesis of the ground's frame in this one."""
        return _moved(h, self.pose, np.zeros(3))

    def out_of(self, h: Hypothesis) -> Hypothesis:
        """Return a hypothesis of this frame in the ground's."""
        return _moved(h, np.zeros(3), self.pose)


def _moved(h: Hypothesis, old, new) -> Hypothesis:
    """Return a hypothesis moved by the planar motion that maps `old` to `new`."""
    R = planar_matrix(new[2] - old[2])
    offset = None if h.offset is None else R @ h.offset
    return replace(h, x=move_poses(h.x, old, new), offset=offset)


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
