"""The stress suite: its fast core passes, and its judge is not easily pleased."""

import json
import os
import signal
import subprocess
import sys
from argparse import Namespace
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from conftest import BENCHMARKS, benchmark

LONGEST = 60.0  # [s] until a suite of few cells must have ended


suite = benchmark("stability")


@pytest.fixture
def judge(suite):
    import stability_judge

    return stability_judge


def asked(folder, **changes):
    given = {"folder": folder, "axes": None, "ways": None, "core": True,
             "report": False, "executor": "none", "workers": 1,
             "address": None}  # fmt: skip
    return Namespace(**given | changes)


@pytest.mark.slow
def test_the_fast_core_passes_every_rule(suite, tmp_path):
    rows = suite.suite(asked(tmp_path))
    assert [suite.said(r) for r in rows if not r["passed"]] == []
    assert {r["axis"] for r in rows} == {cell[0] for cell in suite.CORE}
    assert {suite.RIGHT, suite.ERROR} <= {r["verdict"] for r in rows}
    assert suite.summary(rows).endswith("0 refused.")


def test_a_suite_that_was_interrupted_runs_only_what_is_missing(
    suite, tmp_path, monkeypatch
):
    ran = []

    def fake(*cell):
        ran.append(cell)
        return [suite.finished(cell, suite.row("estimate", suite.RIGHT, 1e-4, 1e-4), 1)]

    monkeypatch.setattr(suite, "run", fake)
    rows = suite.suite(asked(tmp_path))
    assert len(ran) == len(rows) == len(suite.CORE)
    kept = (tmp_path / "stability.jsonl").read_text().splitlines()
    (tmp_path / "stability.jsonl").write_text("\n".join(kept[:6]) + "\n")
    assert len(suite.suite(asked(tmp_path))) == len(rows)
    assert ran[len(rows) :] == list(suite.CORE)[5:]
    suite.draw(rows, tmp_path / "stability.png")
    assert (tmp_path / "stability.png").stat().st_size > 5_000


def dies_at_the_second(name, value, way):
    if value == "1e-4":
        os.kill(os.getpid(), signal.SIGKILL)
    return [{"value": value}]


def test_a_cell_that_takes_its_process_along_is_a_hang_and_the_others_go_on(suite):
    cells = suite.AXES["information prior"].cells()[:3]
    dies = partial(suite.limited, task=dies_at_the_second)
    with suite.watched(asked(None, executor="processes")) as (pool, task):
        assert task is suite.limited
        found = [rows[0] for rows in pool.map(dies, *zip(*cells, strict=True))]
    by_value = {r["value"]: r.get("verdict") for r in found}
    assert by_value == {"1e-6": None, "1e-4": suite.HANG, "1e-2": None}


@pytest.mark.slow
def test_the_suite_on_processes_ends_and_leaves_none_behind(tmp_path):
    words = ["--axes", "internal units", "--ways", "quasi-static", "--workers", "2"]
    suite = [sys.executable, BENCHMARKS / "stability.py", tmp_path, *words]
    # A child that is left behind holds the pipe open, and we would wait for it.
    done = subprocess.run(suite, capture_output=True, text=True, timeout=LONGEST)
    assert done.returncode == 0, done.stderr
    assert "cells pass (100.0%)" in done.stdout


def test_the_judge_tells_wrong_from_honest(judge, estimate, recorded):
    truth = recorded[2]
    T = estimate.measurements.samples
    true = judge.Truth(
        truth["side_lengths"], truth["object_position"][:T],
        truth["object_quaternion"][:T],
    )  # fmt: skip
    assert judge.against_truth(estimate, true)["verdict"] in judge.GOOD
    # Five millimetres to either side, far beyond what any sigma admits there.
    best = np.argmin(estimate.information.sigma("side_lengths"))
    off = np.zeros(3)
    off[best] = 5e-3
    swollen = replace(estimate, theta=estimate.theta + off)
    told = judge.against_truth(swollen, true)
    assert told["verdict"] == judge.WRONG
    assert told["error_mm"] == pytest.approx(5, abs=1)
    wider = estimate.information.covariance_matrix
    wider = wider + 1e-2 * np.eye(len(wider))
    vague = replace(estimate.information, covariance_matrix=wider)
    vague = replace(swollen, information=vague)
    assert judge.against_truth(vague, true)["verdict"] == judge.HONEST
    lost = replace(estimate, position=np.full_like(estimate.position, np.nan))
    assert judge.against_truth(lost, true)["verdict"] == judge.NAN


def test_an_error_of_ours_is_told_from_a_crash(suite, monkeypatch):
    def check(value, way):
        raise {"ours": suite.TactileError, "theirs": ValueError}[value]("oh")

    axis = replace(suite.AXES["mass"], values=("ours", "theirs"), check=check)
    monkeypatch.setitem(suite.AXES, "mass", axis)
    cells = [("mass", value, "cuboid") for value in axis.values]
    verdicts = [suite.run(*cell)[0]["verdict"] for cell in cells]
    assert verdicts == [suite.ERROR, suite.CRASH]
    assert not any(suite.run(*cell)[0]["passed"] for cell in cells)


def test_every_axis_states_its_rule_and_refuses_only_cells_that_it_has(suite, judge):
    for axis in suite.AXES.values():
        assert axis.rule
        assert len(set(axis.values)) == len(axis.values)
        for value, way in axis.may_refuse:
            assert value in ("*", *axis.values), axis.name
            assert way in ("*", *judge.WAYS), axis.name
        cells = axis.cells()
        assert {way for *_, way in cells} <= set(judge.WAYS)
        assert {value for _, value, _ in cells} <= set(axis.values), axis.name
    assert json.dumps(suite.CORE)
    firm = [c for a in suite.AXES.values() for c in a.cells() if not a.allows(*c[1:])]
    assert len(firm) > 100
