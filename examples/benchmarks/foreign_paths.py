"""Paths of fingertips within an action: straight pushes, and others.

A path is a function (t, speed) -> how long the reference of a fingertip has gone ahead,
and across, at its speed [m/s], a time t after the begin of the action.  Times are in
steps of STEP.
"""

import numpy as np

STEP = 1 / 3000  # [s]
RADIUS = 0.04  # [m] of an arc
STOPPED = 0.4, 0.7  # [s] from, to
RETREAT = 0.45, 0.6  # [s] from, to
ASIDE = 0.6  # [s] from when on it moves across


def straight(t, speed):
    return t, 0.0


def arc(t, speed):
    turned = RADIUS / (speed * STEP)
    return turned * np.sin(t / turned), turned * (1 - np.cos(t / turned))


def stopped(t, speed):
    first, last = STOPPED
    return t - np.clip(t - first / STEP, 0, (last - first) / STEP), 0.0


def twice(t, speed):
    """Go back for a while, then ahead again."""
    first, last = RETREAT
    return t - 2 * np.clip(t - first / STEP, 0, (last - first) / STEP), 0.0


def aside(t, speed):
    """Slide along the face that was reached."""
    return min(t, ASIDE / STEP), max(0.0, t - ASIDE / STEP)


PATHS = {
    function.__name__: function for function in (straight, arc, stopped, twice, aside)
}


def reference(path: str, start, aim, t: int, speed: float) -> np.ndarray:
    """Return where the fingertips' references are after t steps, (F, 3) [m]."""
    ahead = aim - start
    ahead *= speed / np.maximum(np.linalg.norm(ahead, axis=1), 1e-9)[:, None]
    along, beside = PATHS[path](t, speed)
    across = np.cross([0.0, 0.0, 1.0], ahead)
    return start + ahead * along * STEP + across * beside * STEP
