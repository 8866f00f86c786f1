"""A time limit is one object: what it ends keeps the best so far, and says so."""

import json
import math
import os
import pickle
import subprocess
import sys
import time

import casadi as ca
import numpy as np
import pytest

from formulations.shape import CUBOID
from tactilenlp import Estimate, Measurements, Options, Scene, solve_estimate
from tactilenlp.common.deadline import NEVER, Deadline, OutOfTime
from tactilenlp.data.examples import example_recording
from tactilenlp.errors import NotConverged
from tactilenlp.nlp import codegen, compilation

MANY = 97  # actions, of 3007 samples
AT_ONCE = Options(time_limit=1e-3)


def test_a_part_never_ends_after_the_whole_and_shares_what_is_recorded():
    whole = Deadline.within(60.0)
    assert whole.until(math.inf).at == whole.at
    part = whole.until(0.0)
    assert part.passed("a certificate")
    assert part.passed("a certificate")
    assert whole.omitted == ["a certificate"]
    with part.spending("compile"):
        time.sleep(0.01)
    assert 40.0 < whole.share_left("compile", 0.8) < 48.0 - 0.01
    assert not NEVER.passed("anything")
    assert not NEVER.omitted


def test_an_infinite_time_limit_ends_nothing():
    never = Deadline.within(math.inf)
    for share in (0.0, 0.1, 1.0):
        at = never.before_end(math.inf - share * math.inf)
        assert never.until(at).left == math.inf
    limited = Deadline.within(60.0)
    assert limited.before_end(6.0) == limited.at - 6.0
    file = example_recording()
    data = Measurements.load(file).select([0, 1])
    found = solve_estimate(data, Scene.load(file), options=Options(time_limit=math.inf))
    assert "time limit" not in found.status


def test_only_a_strict_deadline_ends_a_computation_and_records_which():
    whole = Deadline.within(60.0)
    whole.until(0.0).check()
    with pytest.raises(OutOfTime):
        whole.until(0.0, strict=True).check()
    with whole.ending("the profile"):
        whole.until(0.0, strict=True).check()
    assert whole.omitted == ["the profile"]


def test_no_compiler_is_started_after_a_deadline(monkeypatch):
    monkeypatch.setattr(
        compilation, "_started", lambda *_: pytest.fail("it was started")
    )
    x = ca.SX.sym("x")
    value = ca.Function("value", [x], [x * time.time()])
    assert codegen.start_compilation([value], deadline=Deadline.within(0.0))() == [
        value
    ]


@pytest.fixture(scope="module", params=["cuboid", "polytope"])
def late(request):
    """A recording, and what is known of it at once."""
    shape, file = request.param, example_recording(request.param)
    data, scene = Measurements.load(file).select(range(3)), Scene.load(file)
    given = {"shape": shape, "options": AT_ONCE}
    return data, scene, given, solve_estimate(data, scene, throw=False, **given)


def test_what_is_known_at_once_is_a_whole_estimate_with_the_sigma_of_the_prior(
    late, tmp_path
):
    data, scene, given, estimate = late
    assert not estimate.success
    assert "time limit reached: without" in estimate.status
    assert "a search from action 2 on" in estimate.status
    assert estimate.position.shape == (data.samples, 3)
    assert np.isfinite(estimate.vertices).all()
    known = estimate.information.sigma("position")
    assert known[:2].min() > 0.0999  # [m] around the touch
    if given["shape"] == "cuboid":  # each at least as its prior at the mean of others
        sizes = estimate.information.sigma("side_lengths")
        least = np.sqrt(2) * CUBOID.size_prior[1]
        assert (sizes > 0.999 * least).all()
    assert "no time to compute sigma" in estimate.summary()
    assert estimate.fit.verdict == "bad"  # what is the prior's is not multiplied
    assert estimate.fit.widening == 1.0
    assert "multiplied" not in estimate.summary()
    estimate.save(tmp_path / "late.npz")
    again = Estimate.load(tmp_path / "late.npz")
    assert again.status == estimate.status
    assert np.array_equal(again.position, estimate.position)
    with pytest.raises(NotConverged, match="raise time_limit") as caught:
        solve_estimate(data, scene, **given)
    assert "no derivatives: it was evaluated" in caught.value.problem
    best = caught.value.estimate  # where the limit falls is not the same twice
    assert not best.success
    assert best.position.shape == estimate.position.shape


def test_a_body_that_rolls_has_free_poses_when_the_limit_ends_its_solve():
    file = example_recording()
    data, scene = Measurements.load(file).select([0]), Scene.load(file)
    given = {"shape": "ellipsoid", "options": AT_ONCE, "throw": False}
    estimate = solve_estimate(data, scene, **given)
    assert not estimate.success
    assert estimate.position.shape == (data.samples, 3)
    assert (estimate.position[:, 2] > 0).all()


def test_a_solve_that_starts_from_it_searches_from_scratch(late):
    data, scene, given, _ = late
    one = data.select([0])
    first = solve_estimate(one, scene, throw=False, **given)
    asked = {"shape": given["shape"], "formulation": "quasi_static"}
    scratch = solve_estimate(one, scene, **asked)
    again = solve_estimate(one, scene, start=first, **asked)
    assert again.objective == scratch.objective


SOLVE = """
import json, sys
from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage
import numpy as np
from dataclasses import replace
from tactilenlp import Measurements, Options, Scene, solve_estimate
from tactilenlp.data.examples import example_recording

def spent():
    # CPU time [s] of this process and of the compilers that it waited for.
    here, there = map(getrusage, (RUSAGE_SELF, RUSAGE_CHILDREN))
    return sum(one.ru_utime + one.ru_stime for one in (here, there))

shape, actions, limit = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])
file = example_recording(shape)
data, scene = Measurements.load(file), Scene.load(file)
many = data
while many.actions < actions:
    many = many.append(replace(data, time=data.time + many.time[-1] + 1.0))
many = many.select(np.unique(many.action)[:actions])
began = spent()
options = Options(time_limit=limit)
late = solve_estimate(many, scene, shape=shape, options=options, throw=False)
took = spent() - began
print(json.dumps([took, late.success, late.status, late.position.shape]))
"""


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["cuboid", "polytope"])
def test_a_time_limit_holds_for_3000_samples_with_an_empty_cache(shape, tmp_path):
    """In CPU time, which other programs do not lengthen."""
    limit, path = 2.0, os.pathsep.join(sys.path)
    environment = {"PYTHONPATH": path, "XDG_CACHE_HOME": str(tmp_path)}
    environment |= {"OMP_NUM_THREADS": "1"}
    tmp_path.chmod(0o700)
    said = subprocess.run(
        [sys.executable, "-c", SOLVE, shape, str(MANY), str(limit)], check=True,
        env=os.environ | environment, stdout=subprocess.PIPE, text=True,
    ).stdout  # fmt: skip
    took, success, status, positions = json.loads(said.splitlines()[-1])
    assert not success
    assert "time limit reached: without" in status
    assert positions == [3007, 3]
    assert took < limit + 1.0, f"{took:.2f} s"


def test_a_deadline_means_the_same_on_a_host_with_another_clock(monkeypatch):
    whole = pickle.dumps(Deadline.within(60.0))
    clock = time.monotonic
    monkeypatch.setattr(time, "monotonic", lambda: clock() + 86400.0)
    assert pickle.loads(whole).left == pytest.approx(60.0, abs=1.0)
    assert pickle.loads(pickle.dumps(NEVER)).left == math.inf
