"""Tosses: a group that is refused is a row, and a failure is infinitely far."""

import numpy as np
import pytest
from conftest import TOSSES, benchmark

from tactilenlp.errors import TactileError

cubes, boxes = benchmark("cube_tosses"), benchmark("tossed_boxes")


@pytest.mark.skipif(not TOSSES.exists(), reason="needs the shared recording of tosses")
def test_a_group_that_is_refused_does_not_end_the_study(cubes, monkeypatch):
    def refuses(*_, **given):
        raise TactileError("not at rest", where="tosses", next="-")

    monkeypatch.setattr(cubes, "identify_body", refuses)
    row = cubes.run(str(TOSSES), 0, 4, 0, "cuboid")
    assert "not at rest" in row["refused"]
    assert row["cpu_s"] >= 0


def test_a_refused_group_is_infinitely_far_and_not_drawn(cubes, tmp_path):
    about = {"shape": "cuboid", "tosses": 4, "refused": "", "cpu_s": 1.0}
    kept = about | {"vertex_mean_mm": 1.0, "sigma_mm": 0.5, "friction": 0.2}
    kept |= {"friction_sigma": 0.01}
    refused = about | {"refused": "TactileError", "cpu_s": 3.0}
    (row,) = cubes.summary([kept, kept, refused])
    assert (row["groups"], row["refused"], row["worst cpu_s"]) == (3, 1, 3.0)
    assert (row["vertex_mean_mm"], row["worst_mm"]) == (1.0, np.inf)
    assert row["sigma_mm"] == 0.5
    cubes.draw([kept, refused], 0.18, tmp_path / "made.png")


def test_boxes_that_failed_are_infinitely_far_in_the_quantiles(boxes, capsys):
    kept = {"cube": True, "failure": "", "off_mm": 1.0}
    boxes.tell([kept, kept, {"cube": True, "failure": "NotConverged"}])
    said = capsys.readouterr().out.splitlines()[0]
    assert said.startswith("cubes: n = 3")
    assert "[ 1. inf inf]" in said
    assert "1 failed" in said
