"""How many hypotheses a search keeps, and starts it solves."""

import pytest

from tactilenlp import Options
from tactilenlp.estimation import optima
from tactilenlp.interface.request import read_request
from tactilenlp.problem.options import DOUBTFUL_WIDTHS, NOISY_WIDTHS, PRECISE_WIDTHS


def test_a_doubtful_trajectory_of_noisy_sensors_is_searched_more_widely():
    assert Options().widths(precise=False) == NOISY_WIDTHS
    assert Options().widths(precise=False, doubtful=True) == DOUBTFUL_WIDTHS
    assert Options().widths(precise=True, doubtful=True) == PRECISE_WIDTHS
    told = Options(hypotheses=3, starts=1)
    assert told.widths(precise=False, doubtful=True) == (3, 1)


@pytest.mark.parametrize("shape", ["cuboid", "polytope"])
def test_only_the_search_action_by_action_of_sizes_is_a_wider_one(
    recorded, shape, monkeypatch
):
    data, scene, _ = recorded
    request, _ = read_request(data, scene, shape)
    searched = []

    def search(request, incumbents):
        searched.append(request.doubtful)
        return optima.Optima(None, [], [], [])

    monkeypatch.setattr(optima, "_search_once", search)
    assert not request.doubtful
    assert optima._search_by_action(request, request.job) is None
    assert searched == [shape == "cuboid"]
