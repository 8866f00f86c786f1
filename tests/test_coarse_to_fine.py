"""Recordings of a high rate: solved at the search's rate first, then at all samples."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tactilenlp import Measurements, Options, solve_estimate
from tactilenlp.errors import Interrupted
from tactilenlp.estimation import coarse_to_fine, initial_search
from tactilenlp.estimation.coarse_to_fine import (
    at_coarse_rows,
    coarse_rows,
    interpolate,
)
from tactilenlp.problem.hypothesis import Hypothesis
from tactilenlp.search.multi_hypothesis import TrackingSearch

RATIO = 3  # samples of the dense recording in each interval of the recorded one


def denser(data, times: int) -> Measurements:
    """Return data with so many samples in each interval, felt if both ends are."""
    later = np.r_[0, np.repeat(np.arange(1, data.samples), times)]
    part = np.r_[1.0, np.tile(np.arange(1, times + 1) / times, data.samples - 1)]
    inside = (data.action[later] == data.action[later - 1]) | (part == 1)
    later, part = later[inside], part[inside]
    arrays = data.arrays(later)
    for name in ("time", "finger_position"):
        share, old = part.reshape(-1, *[1] * (arrays[name].ndim - 1)), data.arrays()
        arrays[name] = share * arrays[name] + (1 - share) * old[name][later - 1]
    felt = data.contact[later - 1] | (part == 1)[:, None]
    arrays["contact"] = arrays["contact"] & felt
    arrays["normal"] = np.where(arrays["contact"][..., None], arrays["normal"], 0.0)
    return Measurements(**arrays)


@pytest.fixture(scope="module")
def dense(recorded):
    """Two actions of the recording at three times its rate."""
    data, scene, _ = recorded
    return denser(data.select(range(2)), RATIO), scene


def request_of(data, path=None):
    return SimpleNamespace(
        job=SimpleNamespace(data=data, search=SimpleNamespace(hypothesis=path))
    )


def test_only_a_rate_above_that_of_the_search_is_solved_at_a_lower_rate_first(
    recorded, dense
):
    data, _ = dense
    assert coarse_rows(request_of(recorded[0])) is None
    assert coarse_rows(request_of(data, path="poses of another class")) is None
    rows = coarse_rows(request_of(data))
    assert len(rows) == pytest.approx(data.samples / RATIO, abs=data.actions)
    for action in range(2):  # the last sample of an action is among them
        assert np.flatnonzero(data.action == action)[-1] in rows


def test_touches_too_short_for_the_lower_rate_are_solved_at_the_full_one(dense):
    data, _ = dense
    felt = np.flatnonzero(data.contact.any(axis=1))
    contact = np.zeros_like(data.contact)
    contact[felt[:2]] = data.contact[felt[:2]]  # two samples: one at the lower rate
    normal = np.where(contact[..., None], data.normal, 0.0)
    arrays = data.arrays() | {"contact": contact, "normal": normal}
    assert coarse_rows(request_of(Measurements(**arrays))) is None


def test_poses_between_tracked_samples_are_on_the_way(dense):
    data, _ = dense
    rows = coarse_rows(request_of(data))
    rng = np.random.default_rng(5)
    h = Hypothesis(np.ones(3), rng.normal(size=(3, len(rows))), 0.0, ())
    x = interpolate(h, data, rows).x
    assert x.shape == (3, data.samples)
    np.testing.assert_allclose(x[:, rows], h.x)
    np.testing.assert_allclose(at_coarse_rows(interpolate(h, data, rows), rows).x, h.x)
    for action in range(2):
        mine = rows[data.action[rows] == action]
        first = np.flatnonzero(data.action == action)[0]
        assert (x[:, first : mine[0] + 1] == x[:, [mine[0]]]).all()  # at rest
        inside = np.arange(mine[0], mine[1] + 1)
        share = (data.time[inside] - data.time[mine[0]]) / np.ptp(data.time[mine[:2]])
        way = x[:, inside] - x[:, [mine[0]]]
        np.testing.assert_allclose(way, share * way[:, [-1]], atol=1e-12)


@pytest.mark.slow
def test_a_dense_recording_is_estimated_as_well_for_few_more_iterations(
    touched, dense, monkeypatch
):
    data, scene = dense
    sizes, solve = [], coarse_to_fine.multistart

    def counted(job, *given, **options):
        found = solve(job, *given, **options)
        sizes.append((job.data.samples, sum(s.solution.iterations for s in found)))
        return found

    monkeypatch.setattr(coarse_to_fine, "multistart", counted)
    found, few = solve_estimate(data, scene), touched
    assert found.success
    assert found.fit.verdict == "good"
    assert found.position.shape == (data.samples, 3)
    sigma = few.information.sigma("side_lengths")
    assert (np.abs(found.side_lengths - few.side_lengths) < sigma).all()
    # One multistart at the full rate, each start within tens of iterations.
    ((samples, iterations),) = sizes
    assert samples == data.samples
    assert iterations < 100 * Options().widths(precise=True)[1]


def test_ctrl_c_at_the_lower_rate_leaves_poses_of_all_samples_so_far(
    dense, monkeypatch
):
    data, scene = dense

    class StoppedSearch(TrackingSearch):
        def starts(self):
            first = replace(self.job, data=self.job.data.select([0]))
            found = TrackingSearch(first, [], 1).starts()
            self.keep([self.out_of(h) for h in found])
            raise KeyboardInterrupt

    monkeypatch.setattr(initial_search, "TrackingSearch", StoppedSearch)
    with pytest.raises(Interrupted) as stop:
        solve_estimate(data, scene)
    found = stop.value.estimate
    done = int(np.sum(data.action == 0))
    assert found.position.shape == (done, 3)
    assert "1 of 2 actions" in found.status
