"""Bodies outside the class: a refusal is infinitely far from the body."""

import numpy as np
from conftest import benchmark

mismatch = benchmark("mismatch")


def test_a_refused_body_is_infinitely_far_and_its_best_is_known(mismatch):
    about = {"body": "cylinder", "class": "cuboid", "said": ""}
    about |= {"best_mm": 1.0, "best_touched_mm": 0.5}
    kept = about | {"error_mm": 4.0, "touched_mm": 2.0, "ratio": 1.0, "nats": 0.5}
    kept |= {"wrong": 0, "faces": 6}
    (row,) = mismatch.summary([kept, about | {"said": "MotionError"}])
    assert (row["n"], row["refused"], row["best_mm"]) == (2, 1, 1.0)
    assert row["error_mm"] == np.inf
