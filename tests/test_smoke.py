"""Every page estimates one action: the shortest run through each of them."""

import numpy as np
import pytest

from tactilenlp import Options, solve_estimate
from tactilenlp.problem.pages import FORMULATIONS

LEAN = Options(hypotheses=1, starts=1, profile_likelihood=False)
APEX = 4e-3  # [weights] pages round the apex of the friction cone by 3e-3
# [m] how far touches lie from the surface: model errors of the pages are 0.15 and
# 0.3 mm; the paper's logistic is as happy with a finger inside.
OFF = dict.fromkeys(FORMULATIONS, 1e-3) | {"paper": 5e-3}

pytestmark = pytest.mark.usefixtures("not_compiled")  # compiling takes longer


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_every_page_puts_the_surface_where_an_action_touched(recorded, formulation):
    data, scene, _ = recorded
    data = data.select([2])
    estimate = solve_estimate(
        data, scene, formulation=formulation, options=LEAN, throw=False
    )
    assert estimate.success, estimate.status
    assert estimate.formulation == formulation
    assert max(estimate.violations.values(), default=0.0) < APEX
    t, f = np.nonzero(data.contact & data.valid)
    p_w = data.finger_position[t, f] - data.finger_radius[f, None] * data.normal[t, f]
    away = [
        estimate.rotation(int(k)).T @ (p - estimate.position[k])
        for k, p in zip(t, p_w, strict=True)
    ]
    outside = np.abs(away) - estimate.side_lengths / 2
    assert np.abs(outside.max(axis=1)).max() < OFF[formulation]
