"""The tilt of the ground from the turns of sensors, by what touches tell of each."""

from types import SimpleNamespace

import numpy as np
import pytest

from formulations.finger_turn import TURN_SIGMA
from formulations.names import FINGER_TURN
from tactilenlp.refinement.ground_tilt import _common_turn

TILT = np.array([0.02, -0.01])  # [rad]
KNOWN, UNKNOWN = 1e4, 1e-9  # [1/rad^2] information of touches about a turn


def turned(turns, information):
    """Return a solve with turns (F, 3) [rad], each known to an information (F,)."""
    told = np.repeat(information, 3) + 1 / TURN_SIGMA**2
    return SimpleNamespace(
        solution=SimpleNamespace(values={FINGER_TURN: np.transpose(turns)}),
        kkt=SimpleNamespace(marginal=lambda name: np.diag(1 / told)),
    )


def test_a_turn_that_all_sensors_share_is_the_tilt_of_the_ground():
    alike = turned(np.tile([*TILT, 0.0], (2, 1)), [KNOWN, KNOWN])
    assert _common_turn(alike) == pytest.approx(TILT)


def test_a_turn_that_no_touch_determines_does_not_count_in_the_tilt():
    odd = turned([[*TILT, 0.0], [0.5, 0.5, 0.0]], [KNOWN, UNKNOWN])
    assert _common_turn(odd) == pytest.approx(TILT, abs=1e-6)
