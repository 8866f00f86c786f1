"""The frame of the first touch, in which shapes with sizes are searched for.

Its origin is the touched point, its x axis the normal that was felt there, or the way
of a finger that touched the top: what a search draws, rounds and compares does not
depend on where the world's axes are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..data.joint_offsets import JointZeros
from ..geometry.transforms import is_planar, planar_matrix, rotate_planar
from ..search.hypothesis import Hypothesis, Job
from ..tracking.first_touch import TOP_TILT, first_contact, first_onset


@dataclass(frozen=True)
class ContactFrame:
    """origin (2,) [m] and yaw [rad] of the frame, on the ground."""

    origin: tuple[float, float]
    yaw: float

    @classmethod
    def of(cls, job: Job, kept) -> ContactFrame:
        """Return the frame of a job's first touch; the world's where that must stay.

        It must for errors of joints, whose axes it has, and for `kept` that tilt.
        """
        tilts = not all(is_planar(h.x) for h in kept)
        if tilts or isinstance(job.scene.sigma_offset, JointZeros):
            return cls((0.0, 0.0), 0.0)
        p, ahead = first_contact(job.data)
        if np.hypot(ahead[0], ahead[1]) <= TOP_TILT:
            t, f = first_onset(job.data)
            places = job.data.finger_position[job.data.action == job.data.action[t], f]
            ahead = places[-1] - places[0]
        return cls((p[0], p[1]), float(np.arctan2(ahead[1], ahead[0])))

    def job(self, job: Job) -> Job:
        """Return the job with its measurements and guesses in this frame."""
        R = planar_matrix(-self.yaw)
        t = -R @ np.array([*self.origin, 0.0])
        first = tuple((name, theta, self._into(x)) for name, theta, x in job.first)
        return replace(job, data=job.data.transformed(R, t), first=first)

    def into(self, h: Hypothesis) -> Hypothesis:
        """Return a hypothesis of the ground's frame in this one."""
        offset = None if h.offset is None else planar_matrix(-self.yaw) @ h.offset
        return replace(h, x=self._into(h.x), offset=offset)

    def out_of(self, h: Hypothesis) -> Hypothesis:
        """Return a hypothesis of this frame in the ground's."""
        place = rotate_planar(self.yaw, h.x[0], h.x[1], self.origin)
        offset = None if h.offset is None else planar_matrix(self.yaw) @ h.offset
        return replace(h, x=np.array([*place, h.x[2] + self.yaw]), offset=offset)

    def _into(self, x: np.ndarray) -> np.ndarray:
        apart = x[0] - self.origin[0], x[1] - self.origin[1]
        return np.array([*rotate_planar(-self.yaw, *apart), x[2] - self.yaw])
