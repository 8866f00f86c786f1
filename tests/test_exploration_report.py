"""The report of an exploration study: pairs are of one trial, and failures count."""

import subprocess
import sys

import numpy as np
import pytest
from conftest import BENCHMARKS, benchmark
from scipy import stats

report, tests = benchmark("exploration_report"), benchmark("paired_tests")
FLOOR = {"bch_mm": 5.0, "bch_floor_mm": 2.5}


def rows(chosen: dict, random: dict, actions=1) -> list[dict]:
    """Return rows of trials of both policies: trial -> distance [mm], None: failed."""
    return [
        {"trial": trial, "policy": policy, "start": "ours", "action": action}
        | ({} if far is None and action else FLOOR | {"p2s_mm": far or 1.0})
        for policy, found in (("eig", chosen), ("random", random))
        for trial, far in found.items()
        for action in range(actions + 1)
    ]


def test_pairs_are_of_the_same_trial_where_one_is_missing(report):
    """By position, trial 1 would be compared with trial 2, and so on: better in 3."""
    found = {k: float(k) for k in range(1, 7)}
    chosen = {k: far for k, far in found.items() if k != 1}
    lines = report.comparison_lines(
        rows(chosen, {k: far - 0.01 * k for k, far in found.items()}), "p2s_mm"
    )
    assert len(lines) == 2
    assert "better in 0 of 5" in lines[1]
    assert "difference +0.040" in lines[1]


def test_a_failure_is_the_worst_of_all_ranks_and_left_out_of_t_tests_only(report):
    chosen = {k: 0.5 + 0.01 * k for k in range(8)} | {8: None}
    random = {k: 1.0 + 0.001 * k**2 for k in range(9)}
    lines = report.comparison_lines(rows(chosen, random), "p2s_mm")
    p = stats.wilcoxon([*(chosen[k] - random[k] for k in range(8)), 9.0]).pvalue
    assert f"p = {p:.2g} by Wilcoxon's test, better in 8 of 9" in lines[1]
    assert "t-tests leave out 1 pairs" in lines[1]


def test_what_failed_in_both_policies_is_no_difference(tests):
    x, y = np.array([1.0, 2, 3, np.inf]), np.array([2.0, 4, 6, np.inf])
    assert tests.wilcoxon(x, y) == stats.wilcoxon(x[:3], y[:3]).pvalue
    assert tests.wilcoxon(x, x) == 1.0


def test_a_perfect_estimate_has_a_finite_score_where_a_trial_broke(report):
    broken = rows({0: 1.0, 1: None}, {0: 1.0, 1: 1.0})
    chosen, _ = report.paper_lines(broken)
    assert "bCH after the last action inf mm" in chosen
    assert "a perfect estimate scores 2.50" in chosen


def test_the_report_names_one_primary_test(report, tmp_path, capsys, monkeypatch):
    for drawn in ("draw_bands", "draw_strip", "cost_lines", "rest_lines"):
        monkeypatch.setattr(report, drawn, lambda *_: [])
    report.report(rows({0: 1.0, 1: None}, {0: 1.0, 1: 1.0}), tmp_path)
    assert capsys.readouterr().out.startswith("Primary test: Wilcoxon's")


@pytest.mark.slow
def test_the_script_explains_itself():
    script = [sys.executable, str(BENCHMARKS / "exploration_report.py"), "--help"]
    said = subprocess.run(script, capture_output=True, text=True, timeout=120)
    assert said.returncode == 0
    assert "exploration.jsonl" in said.stdout
