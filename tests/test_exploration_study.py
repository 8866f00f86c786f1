"""The study: paired, resumable, on any executor, and its statistics by hand."""

import json
import os
import sys
from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest
from conftest import BENCHMARKS, benchmark

from formulations.polytope import COUNTS
from tactilenlp.geometry.faces import polygons

modules = benchmark("exploration_study", "exploration_report")


def fake_run(trial, policy, start, actions, budget, objects):
    rng = np.random.default_rng([trial, len(policy)])
    worse = 2.0 if policy == "random" else 1.0
    corners = (np.indices((2, 2, 2)).reshape(3, 8).T - 0.5) * 40
    return [
        {
            "trial": trial, "policy": policy, "start": start, "action": k,
            "p2s_mm": worse * 10 / 4**k * rng.uniform(0.8, 1.2), "success": True,
            "bch_mm": worse * 20 / 3**k * rng.uniform(0.99, 1.01) + 2.5,
            "bch_floor_mm": 2.5, "logdet": 10.0 * k,
            "cpu_choose": 0.2, "cpu_estimate": 1.0, "contacts": 10 if k else 0,
            "vertices": corners.tolist(), "true_vertices": corners.tolist(),
        }
        for k in range(actions + 1)
    ]  # fmt: skip


def test_the_strip_shows_what_is_known_of_each_vertex_where_there_are_such(modules):
    _, report = modules
    (row, *_) = fake_run(0, "eig", "ours", 0, 10, "polytope")
    assert report.nats_of(row).tolist() == [0.0]  # log det of the whole
    assert len(report.nats_of(row | {"vertex_nats": [30.0] * 8})) == 8


def asked(folder, executor="none", **changes):
    given = {
        "folder": folder, "trials": 4, "first": 0, "actions": 2, "budget": 9,
        "workers": 2,
        "policies": ["eig", "random"], "starts": ["ours"], "address": None,
        "objects": "cuboid", "noise": False,
    }  # fmt: skip
    return Namespace(**given | {"executor": executor} | changes)


@pytest.mark.slow
def test_a_study_that_was_interrupted_runs_only_what_is_missing(
    modules, tmp_path, monkeypatch
):
    study, report = modules
    ran = []
    monkeypatch.setattr(study, "run", lambda *a: ran.append(a) or fake_run(*a))
    study.study(asked(tmp_path, trials=2))
    assert len(ran) == 4
    file = tmp_path / "exploration.jsonl"
    file.write_text(file.read_text()[:-99])  # the last trial was being written
    rows = study.study(asked(tmp_path))
    assert len(ran) == 4 + 1 + 4
    assert len(rows) == 4 * 2 * 3
    study.write_csv(tmp_path / "trials.csv", [*map(study.tabled, rows)])
    assert len((tmp_path / "trials.csv").read_text().splitlines()) == 25
    report.report(rows, tmp_path)
    for name in ("bch.png", "strip.png"):
        assert (tmp_path / name).stat().st_size > 10_000
    text = (tmp_path / "table.txt").read_text()
    assert "better in 4 of 4" in text
    assert "band below 10 mm after 1 + 1" in text


@pytest.mark.slow
def test_a_trial_is_the_same_object_and_first_touch_under_every_policy(modules):
    study, _ = modules
    a, b = (study.run(3, policy, "ours", 0, 10) for policy in ("eig", "random"))
    assert a[0]["p2s_mm"] == b[0]["p2s_mm"]
    assert a[0]["true_vertices"] == b[0]["true_vertices"]
    assert json.loads(json.dumps(a, default=float))[0]["success"]
    sizes = study.world_of(3).side_lengths
    assert (sizes >= 0.03).all()
    assert (sizes <= 0.06).all()


def test_platonic_solids_lie_on_a_face_and_fill_a_sphere_of_two_centimetres(modules):
    study, _ = modules
    for trial, (count, faces) in enumerate(
        [(4, 4), (8, 6), (6, 8), (20, 12), (12, 20)]
    ):
        world = study.world_of(trial, "polytope")
        points = world.vertices
        assert len(points) == count
        assert len(polygons(points)) == faces
        assert np.linalg.norm(points, axis=1) == pytest.approx(0.02)
        low = points[:, 2] < points[:, 2].min() + 1e-9
        assert low.sum() == {4: 3, 8: 4, 6: 3, 20: 5, 12: 3}[count]
        assert np.linalg.norm(world.pose[:2]) < 0.021


@pytest.mark.slow
def test_a_platonic_solid_is_explored_and_every_error_told(modules):
    study, _ = modules
    rows = study.run(3, "eig", "ours", 2, 10, "polytope")
    assert [r["did"] for r in rows] == ["first touch", "eig", "eig"]
    assert rows[1]["gain"] > 1
    assert len(rows[-1]["vertices"]) == len(rows[-1]["vertex_nats"])
    assert len(rows[-1]["vertices"]) in COUNTS
    assert len(rows[-1]["true_vertices"]) == 20
    for name in ("p2s_mm", "bch_mm", "position_mm", "logdet", "sigma_side_mm"):
        assert np.isfinite(rows[-1][name])
    # Its faces are 15.9 mm from the centre, its vertices 20 mm: a ball is 4.1 mm off.
    # After the first touch two bodies, 2.5 and 10.6 mm off, are as likely (0.4 nats).
    assert rows[-1]["p2s_mm"] < min(rows[0]["p2s_mm"], 4.1)


def test_a_trial_that_breaks_is_a_row_and_counts_as_infinitely_wrong(
    modules, tmp_path, monkeypatch
):
    study, report = modules

    def broken(*arguments, **more):
        raise RuntimeError("no simulator")

    monkeypatch.setattr(study, "explore", broken)
    rows = study.run(0, "eig", "ours", 2, 10)
    assert "no simulator" in rows[0]["error"]
    rows += fake_run(1, "eig", "ours", 2, 10, "cuboid")
    table = report.table_of(rows, "p2s_mm", "eig", "ours")
    assert np.isinf(table[0]).all()
    assert report.outliers(table[:, 2]).tolist() == [True, False]


def test_other_metrics_are_told_of_every_action_by_their_medians(modules):
    _, report = modules
    rows = [r for k in range(3) for r in fake_run(k, "eig", "ours", 2, 10, "cuboid")]
    head, *lines = report.rest_lines(rows)
    assert head.split()[-1] == "2"
    # what no row has is left out, as are sides of a solid
    assert len(lines) == 1
    assert lines[0].startswith("log det I")
    assert [float(word) for word in lines[0].split()[-3:]] == [0.0, 10.0, 20.0]


def test_outliers_lie_beyond_three_interquartile_ranges(modules):
    _, report = modules
    values = np.array([1.0, 2, 3, 4, 5, 9.9, 10.1])
    # quartiles 2.5 and 7.45 with 10.1 among them: the fence is at 22.3
    assert not report.outliers(values).any()
    assert report.outliers(np.append(values, 40)).sum() == 1
    mean, half = report.mean_and_band(np.array([1.0, 2.0, 3.0]))
    # t of two degrees of freedom is 4.303, the deviation 1
    assert (mean, half) == pytest.approx((2.0, 4.3027 / np.sqrt(3)), rel=1e-4)


def test_a_study_runs_on_a_dask_cluster(modules, tmp_path):
    pytest.importorskip("distributed", reason="Dask is an extra: pip install .[dask]")
    study, _ = modules
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "run", fake_run)
        known = os.pathsep.join(
            [str(BENCHMARKS), str(Path(__file__).parent), *sys.path]
        )
        patch.setenv("PYTHONPATH", known)
        sys.modules.setdefault("test_exploration_study", sys.modules[__name__])
        rows = study.study(asked(tmp_path, "dask", trials=2))
    assert len(rows) == 2 * 2 * 3
