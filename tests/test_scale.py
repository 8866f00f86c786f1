"""Cost against samples: an estimate that is not done is a row, and counts as far."""

import numpy as np
import pytest
from conftest import benchmark

scale = benchmark("scale")


def test_what_is_not_done_is_infinitely_far_and_its_seconds_count(scale):
    about = {"cell": "box", "samples": 186, "cpu_ms_a_sample": 1.0, "iterations": 9}
    done = about | {"success": True, "verdict": "good", "p2s_mm": 0.5, "cpu_s": 1.0}
    stopped = done | {"success": False, "verdict": "bad", "p2s_mm": 3.6, "cpu_s": 5.0}
    (row,) = scale.medians([done, done, stopped])
    assert (row["p2s_mm"], row["worst_mm"]) == (0.5, np.inf)
    assert (row["success"], row["good"], row["n"]) == (2, 2, 3)
    (row,) = scale.medians([done, stopped])
    assert (row["p2s_mm"], row["cpu_s"]) == (np.inf, 3.0)


@pytest.mark.slow
def test_an_estimate_at_the_time_limit_does_not_end_the_study(scale):
    row = scale.run("box, 6 actions", 0, 0.3)
    assert not row["success"]
    assert "time limit" in row["status"]
    assert np.isfinite(row["p2s_mm"])
