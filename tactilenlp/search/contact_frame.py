"""The frame of the first touch: a search does not depend on where the world's axes are.

What a search draws, rounds and compares is relative to the touched point, and to the
normal that was felt there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..data.contact_segments import first_contact, first_onset
from ..data.joint_offsets import JointZeros
from ..geometry.transforms import move_poses, planar_matrix
from ..problem.hypothesis import Hypothesis
from ..problem.job import Job
from ..tracking.initial_states import TOP_TILT


@dataclass(frozen=True, eq=False)
class ContactFrame:
    """The frame of the first touch: its pose (3,) on the ground, x, y [m], yaw [rad].

    Its origin is the touched point, its x axis the normal that was felt there, or the
    way of a finger that touched the top.
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
