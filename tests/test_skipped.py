"""What an estimate skips, switched off, put back: its optimum stays where it is."""

import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from formulations import violation_implicit as page
from formulations.shape import CUBOID
from tactilenlp import Options, extend, solve_estimate
from tactilenlp.certificates import static_friction
from tactilenlp.certificates.certify import frictionless
from tactilenlp.interface.request import make_job
from tactilenlp.local.local_solve import solved_from, warm_started
from tactilenlp.problem.skipped import Skipped
from tactilenlp.refinement.certification import restore_reductions

DECLINED = Skipped("rigid", "compliance", "rigid", "gains [nats]", 1.0, 5.0, True)


def test_every_reduction_can_be_switched_off_alone(touched):
    data, scene, h = touched.measurements, touched.scene, touched.hypotheses[0]

    def job(options):
        return make_job(data, scene, CUBOID, options, time.monotonic(), page)

    solved = replace(solved_from(job(Options()), h), declined=(DECLINED,))
    reduced = restore_reductions(solved).solution
    for name in ("still", "far", "absent"):
        fewer = job(Options(without=[name]))
        # From the same optimum: from afar, solves end a fifth of a nat apart.
        full = restore_reductions(warm_started(fewer, solved))
        assert DECLINED in full.skipped
        assert full.solution.success
        assert all(s.name != name for s in full.skipped)
        # an exact reduction keeps the optimum; a still span adds poses whose links
        # cost nothing at rest
        # Rounded friction lets poses of their own creep, which gains a little.
        less = 0.3 if name == "still" else 1e-4
        assert full.solution.objective == pytest.approx(reduced.objective, abs=less)


@pytest.mark.slow
def test_free_motion_ends_beside_the_optimum_of_a_box_that_slides(estimate, recorded):
    options = Options(without="planar")
    free = solve_estimate(estimate.measurements, recorded[1], options=options)
    assert len(free.unknowns["x"]) == 6
    assert free.objective == pytest.approx(estimate.objective, abs=0.1)
    off = free.side_lengths - estimate.side_lengths
    assert (np.abs(off) < 0.2 * estimate.information.sigma("side_lengths")).all()


def test_a_body_at_rest_does_not_creep(estimate):
    data = estimate.measurements
    still = next(s for s in estimate.skipped if s.name == "still")
    assert still.holds
    for action in range(data.actions):
        rows = np.flatnonzero(data.action == action)
        before = rows[: np.argmax(data.contact[rows].any(axis=1))]
        assert np.ptp(estimate.position[before], axis=0).max() < 1e-12


@pytest.mark.slow
def test_still_spans_that_are_doubted_get_poses_of_their_own_where_they_would_move(
    estimate, monkeypatch
):
    data, scene, merged = estimate.measurements, estimate.scene, estimate
    apart = solve_estimate(data, scene, options=Options(without="still"))
    still = next(s for s in merged.skipped if s.name == "still")
    assert 0 < still.value <= 1
    assert still.holds
    less = 0.8 * still.value * static_friction.MM_PER_M
    monkeypatch.setattr(static_friction, "MM_PER_M", less)
    cut = solve_estimate(data, scene)
    skipped = [{s.name for s in e.skipped} for e in (merged, cut)]
    assert skipped[0] - skipped[1] == {"still"}
    poses = [len(e.unknowns["x"][0]) for e in (merged, cut, apart)]
    assert poses[0] < poses[1] <= poses[2]
    assert all(s.holds for s in cut.skipped)
    sigma = apart.information.sigma("side_lengths")
    for e in (merged, cut):
        assert (np.abs(e.side_lengths - apart.side_lengths) < 0.1 * sigma).all()


# Impulses that the page has of a contact, and how many contacts.
@pytest.mark.parametrize(("rows", "contacts"), [(0, 0), (1, 0), (1, 5), (3, 5)])
@pytest.mark.parametrize("mu", [0.0, 0.2])
def test_only_a_page_without_tangential_impulses_has_dropped_them_where_none_act(
    rows, contacts, mu
):
    values = {"ground": np.full((rows, contacts), 0.3)} if rows else {}
    solved = SimpleNamespace(
        solution=SimpleNamespace(values=values, parameters={"ground friction": [mu]}),
        problem=SimpleNamespace(variables={"ground": SimpleNamespace(scale=[0.1])}),
        window=SimpleNamespace(frictionless=("ground",)),
    )  # fmt: skip
    skipped = frictionless(solved)
    assert (skipped is None) == ((rows, contacts) != (1, 5))
    if skipped is not None:
        assert skipped.dropped == "10 tangential impulses"
        assert skipped.value == pytest.approx(3.0 * mu)  # [weights]
        assert skipped.holds == (mu == 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["free", "touch"])
def test_a_page_without_a_term_of_what_was_felt_ends_with_an_estimate(recorded, name):
    data, scene, _ = recorded
    estimate = solve_estimate(
        data.select([0, 1]), scene, formulation=extend(page, without=(name,)),
        options=Options(profile_likelihood=False), throw=False,
    )  # fmt: skip
    assert np.isfinite(estimate.side_lengths).all()
    if name == "free":  # no term by which to certify what was dropped: it was restored
        assert estimate.success
        assert all(s.name != "far" for s in estimate.skipped)
