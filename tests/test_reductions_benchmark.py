"""The benchmarks of reductions and of building: what they compare is comparable."""

import numpy as np
import pytest
from conftest import benchmark

from formulations.polytope import polytope

benchmarks = benchmark("build_time", "reductions")


def test_denser_data_keep_their_samples_and_the_gaps_between_actions(
    benchmarks, recorded
):
    build_time, _ = benchmarks
    data, _, _ = recorded
    data = data.select(range(2))
    x = np.random.default_rng(0).normal(size=(3, data.samples))
    made, along = build_time.denser(data, x, 3)
    first = np.r_[True, data.action[1:] != data.action[:-1]]
    assert made.samples == 3 * data.samples - 2 * first.sum()
    old = np.isin(made.time, data.time)
    assert old.sum() == data.samples
    np.testing.assert_array_equal(made.finger_position[old], data.finger_position)
    np.testing.assert_array_equal(made.contact[old], data.contact)
    np.testing.assert_array_equal(along[:, old], x)
    assert made.dt == pytest.approx(data.dt / 3)
    gap = np.diff(made.time)[np.diff(made.action) > 0]
    assert gap == pytest.approx(np.diff(data.time)[first[1:]])


@pytest.mark.slow
def test_what_a_hull_left_out_as_far_or_absent_is_put_back_at_no_gain(
    benchmarks, recorded
):
    _, reductions = benchmarks
    data, scene, _ = recorded
    way = reductions.Way(data.select(range(2)), scene, shape=polytope())
    ways = reductions.problems(way)
    assert sum("planar" in one.off for one in ways.values()) == 2
    lean = ways[reductions.BASE]
    back = reductions.put_back(ways, reductions.searched(lean))
    best = back[reductions.BASE]
    for name in ("far", "absent"):
        assert back[f"without {name}"] == pytest.approx(best, rel=1e-5, abs=1e-5)
