r"""Convex end-effectors: gap and normal between a finger and a body.

A finger is a point set swept by a ball of radius rho: a sphere is one point, a capsule
a segment.  The gap is the distance of the nearest point of the set, less rho.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass




def to_body(pose, p_w):
    """Return the world point p_w in the body frame."""
    p_wo, R_wo = pose
    return R_wo.T @ (p_w - p_wo)


def sphere_gap(shape, theta, pose, p_wf, rho):
    """Return the gap [m] between body and sphere of radius rho at p_wf."""
    return shape.distance(theta, to_body(pose, p_wf), rho / 10) - rho


def sphere_normal(shape, theta, pose, p_wf, rho):
    """Return the body's outward unit normal towards the sphere, world frame."""
    return pose[1] @ shape.normal(theta, to_body(pose, p_wf), rho / 10)


@dataclass(frozen=True)
class Finger:
    """What a page may ask of an end-effector."""

    name: str
    gap: Callable
    normal: Callable


SPHERE = Finger("sphere", sphere_gap, sphere_normal)
