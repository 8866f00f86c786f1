"""Run time against error: what failed is infinitely far, and its seconds count."""

import numpy as np
import pytest
from conftest import benchmark

timed = benchmark("time_against_error")


@pytest.fixture
def cells(timed):
    about = {"world": "clean", "formulation": "shooting", "refused": ""}
    done = about | {"success": True, "cpu_s": 1.0, "surface_mm": 0.5, "path_mm": 0.6}
    stopped = done | {"success": False, "cpu_s": 9.0, "surface_mm": 30.0}
    refused = {k: v for k, v in stopped.items() if not k.endswith("mm")}
    refused |= {"refused": "NoContactError", "cpu_s": 0.1}
    rows = [done | {"actions": 1}] * 3 + [stopped | {"actions": 1}]
    rows += [done | {"actions": 2}, refused | {"actions": 2}, stopped | {"actions": 2}]
    return timed.summary(rows)


def test_failures_are_infinitely_far_and_their_seconds_count(cells):
    one, two = cells
    assert (one["surface_mm_50"], one["surface_mm_90"]) == (0.5, np.inf)
    assert one["cpu_s_90"] == pytest.approx(1 + 0.7 * 8)
    assert (two["n"], two["refused"], two["failed"]) == (3, 1, 1)
    assert (two["surface_mm_50"], two["cpu_s_50"]) == (np.inf, 1.0)


def test_cells_in_which_half_failed_leave_the_picture_drawable(timed, cells, tmp_path):
    timed.draw(cells, tmp_path / "made.png")
    assert (tmp_path / "made.png").stat().st_size > 10_000
