"""Problems of a page that says ALIKE share term functions."""

import gc
import pickle
import time
import weakref
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import RECORDINGS

from formulations import (
    friction,
    polytope_quasi_static,
    polytope_violation_implicit,
    quasi_static,
    shooting,
    violation_implicit,
)
from formulations.polytope import polytope
from formulations.shape import CUBOID
from tactilenlp import Measurements, Options, Scene
from tactilenlp.interface.request import make_job
from tactilenlp.interface.session import Session
from tactilenlp.local.local_solve import built_page
from tactilenlp.problem.hypothesis import Hypothesis

pytestmark = pytest.mark.usefixtures("not_compiled")  # nothing is evaluated

CASES = [
    (quasi_static, CUBOID, "cuboid"),
    (violation_implicit, CUBOID, "cuboid"),
    (polytope_quasi_static, polytope(8), "polytope"),
    pytest.param(
        polytope_violation_implicit, polytope(8), "polytope", marks=pytest.mark.slow
    ),
]
CUBE = 0.02 * (2.0 * np.indices((2, 2, 2)).reshape(3, 8).T - 1) + [0, 0, 0.02]


def job_of(page, shape, name, actions, **scene):
    path = RECORDINGS / f"{name}.npz"
    data, known = Measurements.load(path), replace(Scene.load(path), **scene)
    data = data.select(np.unique(data.action)[:actions])
    return make_job(data, known, shape, Options(), time.monotonic(), page)


def problem_of(job):
    """Return the problem of the job's page at a body that lies still."""
    theta = CUBE.ravel() if job.shape.name == "polytope" else np.full(3, 0.04)
    x = np.zeros((3 if job.reductions.planar else 6, job.data.samples))
    return built_page(job, Hypothesis(theta, x, np.inf, ())).problem


@pytest.mark.slow
@pytest.mark.parametrize(("page", "shape", "name"), CASES)
@pytest.mark.parametrize("free", [False, True], ids=["planar", "free"])
def test_a_term_is_the_same_function_whatever_else_its_window_holds(
    page, shape, name, free
):
    if free and getattr(page, "REDUCTIONS", {}).get("planar"):
        pytest.skip("the page knows planar motion only")
    few, more = (job_of(page, shape, name, actions) for actions in (1, 3))
    made = replace(few.reductions, planar=not free)
    few = replace(few, reductions=replace(made, still=False, far=False, absent=False))
    more = replace(more, reductions=made)
    one, other = (problem_of(job).functions_by_name for job in (few, more))
    common = one.keys() & other.keys()
    assert len(common) >= 4
    for key in common:
        both = (functions[key].part("first") for functions in (one, other))
        assert len({function.serialize() for function in both}) == 1, key


def test_problems_of_one_job_share_term_functions_but_not_those_of_another_motion():
    job = job_of(violation_implicit, CUBOID, "cuboid", 1)
    first, again = (problem_of(job) for _ in range(2))
    assert first.functions_by_name
    assert first.functions_by_name is again.functions_by_name
    free = replace(job, reductions=replace(job.reductions, planar=False))
    assert problem_of(free).functions_by_name is not first.functions_by_name
    other = problem_of(replace(job, page=quasi_static))
    assert other.functions_by_name is not first.functions_by_name


def test_a_page_that_does_not_say_so_shares_nothing():
    job = job_of(shooting, CUBOID, "cuboid", 1)
    first, again = (problem_of(job) for _ in range(2))
    assert first.functions_by_name is not again.functions_by_name
    assert not job.functions


def test_an_estimate_leaves_its_term_functions_to_who_goes_on_from_it():
    session = Session()
    job = job_of(quasi_static, CUBOID, "cuboid", 1)
    functions = problem_of(job).functions_by_name
    origin = Hypothesis(np.full(3, 0.04), np.zeros((3, 1)), 0.0, ())
    start = SimpleNamespace(origin=origin)
    session.keep(start, job)

    def known(start, scene):
        return session.functions_for(start, scene, CUBOID, quasi_static)

    more = replace(job, functions=known(start, job.scene))
    assert problem_of(more).functions_by_name is functions
    assert not known(start, replace(job.scene, mass=7.0))
    assert not known(SimpleNamespace(origin=replace(origin)), job.scene)
    assert not known(None, job.scene)
    assert not Session().functions_for(start, job.scene, CUBOID, quasi_static)


def test_a_session_forgets_an_estimate_that_is_gone():
    session = Session()
    job = job_of(quasi_static, CUBOID, "cuboid", 1)
    start = SimpleNamespace(
        origin=Hypothesis(np.full(3, 0.04), np.zeros((3, 1)), 0.0, ())
    )
    session.keep(start, job)
    job.functions["any"] = set()  # can be weakly referenced, unlike a dict
    functions = weakref.ref(job.functions["any"])
    del start, job
    gc.collect()
    assert functions() is None


def test_term_functions_stay_in_their_process():
    job = job_of(quasi_static, CUBOID, "cuboid", 1)
    problem_of(job)
    assert job.functions
    again = pickle.loads(pickle.dumps(job))
    assert again.functions == {}
    assert isinstance(again, type(job))


def test_an_edited_constant_of_a_page_is_another_page(monkeypatch):
    job, session = job_of(violation_implicit, CUBOID, "cuboid", 1), Session()
    estimate = SimpleNamespace(origin=job)  # anything that can be weakly referenced
    session.keep(estimate, job)
    known = estimate, job.scene, CUBOID, violation_implicit
    assert session.functions_for(*known) is job.functions
    monkeypatch.setattr(friction, "LEAST", 2 * friction.LEAST)
    assert session.functions_for(*known) is not job.functions
