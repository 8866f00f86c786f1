"""Proposals for a floating object: the planar search in the plane of its touches.

Fingers that push a floating object touch it around a plane, and it moves mostly in that
plane.  So the planar search runs there as if the object slid: a box without friction on
a ground half a typical size below the touches; a polytope, of which nothing else is
known, across a plane through them.  The results start a solve in free motion.  The
plane is that of the first action with touches: more actions do not move it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from ..data.scene import Ground
from ..geometry.tipping import planar_to_free
from ..geometry.transforms import matrices, rotvecs, rotvecs_back

PLANE_ARM = 0.02  # [m] of scatter across the plane that counts as a normal across
PLANE_TILT = 0.2  # [rad] of a body out of the plane, and of a normal with it
FREE_WEIGHT = 0.03  # [-] of the search's motion, where no face determines the motion
VERTICAL_BIAS = 1e-3  # [-] towards the world's z where touches leave it open


def search_plane(job, guess=None) -> Ground:
    """Return the plane to search in: half a typical size below the first touches.

    It is along them and their normals; with a user's guess (a Guess) it is level.
    """
    data, felt = job.data, job.data.contact
    # polytopes may reach below it
    size = 0.0 if job.shape.of_vertices else job.shape.typical_size
    first = data.action[felt.any(axis=1)][0]
    t, f = np.nonzero(felt & (data.action == first)[:, None])
    n = data.normal[t, f]
    p = data.finger_position[t, f] - data.finger_radius[f, None] * n
    if guess is not None:
        position = guess.position
        height = position[2] if len(position) == 3 else p[:, 2].mean()
        return Ground(height=height - float(job.shape.rest_height(guess.side_lengths)))
    apart = (p - p.mean(axis=0)) / PLANE_ARM
    across = (n.T @ n + apart.T @ apart) / len(n)
    across[2, 2] -= VERTICAL_BIAS
    up = np.linalg.eigh(across)[1][:, 0]
    up *= np.copysign(1.0, up[np.argmax(np.abs(up))])
    return Ground(height=float(p.mean(axis=0) @ up) - size / 2, normal=tuple(up))


def in_search_plane(job, ground: Ground):
    """Return the job for the planar search: in the plane, without friction."""
    data = job.data.transformed(ground.rotation, ground.translation)
    if job.shape.of_vertices:
        return replace(job, data=data, functions={})
    scene = replace(job.scene, ground=ground, friction_ground=0.0)
    return replace(job, data=data, scene=scene, functions={})


def with_tilted_normals(job):
    """Return the job of a body that may tilt out of the plane: less certain normals."""
    normal = float(np.hypot(job.precision.normal, PLANE_TILT))
    return replace(job, precision=replace(job.precision, normal=normal))


def in_free_motion(h, ground: Ground, shape):
    """Return the planar hypothesis as free poses in the world.

    The axes of a polytope are the world's at the last sample.
    """
    x = planar_to_free(h.theta, h.x, shape)
    p = ground.from_ground(x[:3].T)
    R = ground.rotation.T @ matrices(x)
    if shape.of_vertices:
        theta = (h.theta.reshape(-1, 3) @ R[-1].T).ravel()
        return replace(h, theta=theta, x=np.vstack([p.T, rotvecs_back(R @ R[-1].T).T]))
    offset = None if h.offset is None else ground.rotation.T @ h.offset
    return replace(h, x=np.vstack([p.T, rotvecs(R).T]), offset=offset)


def in_plane(h, ground: Ground):
    """Return the free motion of a polytope as planar poses along the plane."""
    p = ground.to_ground(h.x[:3].T)
    vertices = h.theta.reshape(-1, 3) @ ground.rotation.T + [0.0, 0.0, p[-1, 2]]
    yaw = rotvecs_back(ground.rotation @ matrices(h.x) @ ground.rotation.T)[:, 2]
    return replace(h, theta=vertices.ravel(), x=np.vstack([p[:, :2].T, yaw]))


def with_faces_tracked(h, data):
    """Return the free motion in which every finger keeps the face that it is on.

    From the last sample backward: a face turns as its normal does, and stays where its
    finger is; what the touches leave open moves as in the hypothesis.
    """
    R, p = matrices(h.x), h.x[:3].T
    R_new, p_new = R.copy(), p.copy()
    felt = data.contact
    n, c = data.normal, data.finger_position
    faces = {}  # by finger: normal and offset in the body frame
    for t in reversed(range(data.samples)):
        if t + 1 < data.samples:
            R_new[t] = R[t] @ R[t + 1].T @ R_new[t + 1]
            p_new[t] = p_new[t + 1] + p[t] - p[t + 1]
        on = [f for f in faces if felt[t, f]]
        if on:
            m = np.vstack([*(faces[f][0] for f in on), np.eye(3)])
            to = np.vstack([n[t, on], R_new[t].T])
            weight = np.r_[np.ones(len(on)), np.full(3, FREE_WEIGHT)]
            R_new[t] = Rotation.align_vectors(to, m, weight)[0].as_matrix()
            offset = [faces[f][1] for f in on]
            A = np.vstack([n[t, on], FREE_WEIGHT * np.eye(3)])
            away = (n[t, on] * (c[t, on] - p_new[t])).sum(axis=1) - offset
            p_new[t] += np.linalg.lstsq(A, np.r_[away, np.zeros(3)], rcond=None)[0]
        for f in range(data.fingers):
            if not felt[t, f]:
                faces.pop(f, None)
            elif f not in faces:
                faces[f] = R_new[t].T @ n[t, f], n[t, f] @ (c[t, f] - p_new[t])
    return replace(h, x=np.vstack([p_new.T, rotvecs_back(R_new).T]))
