"""Every page that `formulation=` names is solved on one action of a recording.

The page `violation_implicit` is solved by the fixtures, `paper` is evaluated term by
term in test_paper.py, the pages of polytopes in test_polytope_estimate.py.
"""

import pytest

from tactilenlp import Options, solve_estimate

PAGES = ("quasi_static", "shooting", "multiple_shooting", "complementarity")
LEAN = Options(hypotheses=1, starts=1, rivals=False)

pytestmark = pytest.mark.usefixtures("not_compiled")  # compiling takes longer


@pytest.mark.parametrize("page", PAGES)
def test_a_page_finds_the_height_of_a_box_that_is_touched_on_top(recorded, page):
    data, scene, truth = recorded
    estimate = solve_estimate(data.select([0]), scene, formulation=page, options=LEAN)
    assert estimate.formulation == page
    assert estimate.success
    # Sensors of 0.05 mm and better; a relaxed complementarity lets it sink in by that.
    assert estimate.side_lengths[2] == pytest.approx(
        truth["side_lengths"][2], abs=0.1e-3
    )
