"""What stands for an estimate that is believed, for tests of what actions tell."""

from types import SimpleNamespace

import numpy as np

from tactilenlp import Estimate, Scene, Workspace
from tactilenlp.information.mixture import one_mode

SPACE = Workspace()
NAMES = ("side x", "side y", "side z", "position x", "position y", "rotation z")
WHOLE = tuple(f"{what} {w}" for what in ("side", "position", "rotation") for w in "xyz")


def measured(dt):
    """Return what stands for measurements of two fingers, an interval [s] apart."""
    return SimpleNamespace(dt=dt, finger_radius=np.full(2, 0.01))


def known(**given):
    """Return an estimate of which only this is known."""
    estimate = object.__new__(Estimate)
    vars(estimate).update({"unknowns": {}} | given)
    return estimate


def believed(sides, x, deviations, hypotheses=()):
    """Return what stands for an estimate: sizes, pose (x, y, yaw), deviations (6,)."""
    return known(
        scene=Scene(), shape="cuboid", precision={"position": 0.0, "normal": 0.0},
        theta=np.array(sides), unknowns={"x": np.array(x)[:, None]}, objective=0.0,
        position=np.array([[x[0], x[1], sides[2] / 2]]), hypotheses=hypotheses,
        measurements=measured(1 / 30), finger_offset=None,
        information=informed(np.diag(1 / np.array(deviations) ** 2)),
    )  # fmt: skip


def informed(matrix, covariance=None):
    """Return what stands for the information of one mode; by itself sigma is exact."""
    C = np.linalg.inv(matrix) if covariance is None else covariance
    names = NAMES if len(matrix) == len(NAMES) else WHOLE
    modes = one_mode(0.0, C)
    return SimpleNamespace(
        names=names, matrix=matrix, covariance_matrix=C, modes=modes, maps={}
    )


VAGUELY = (5e-3, 4e-3, 3e-3, 2e-3, 2e-3, 0.1)
BOX = believed([0.05, 0.04, 0.03], [0.01, -0.02, 0.3], VAGUELY)


def actions(count, seed=0):
    rng = np.random.default_rng(seed)
    return [SPACE.random(rng) for _ in range(count)]
