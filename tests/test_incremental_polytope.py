"""Incremental update of a polytope: an action is solved and joined to the past."""

import logging
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from programmes import octahedron

from formulations import polytope_violation_implicit
from formulations.polytope import polytope
from tactilenlp import solve_estimate
from tactilenlp.common.deadline import NEVER
from tactilenlp.interface.request import make_job
from tactilenlp.local.margins import DECISIVE
from tactilenlp.local.solved import Solved, best_first
from tactilenlp.problem.hypothesis import Hypothesis
from tactilenlp.problem.options import Options
from tactilenlp.refinement import incremental_polytope

PAGE = polytope_violation_implicit


@pytest.fixture(scope="module")
def early():
    data, scene, _ = octahedron(3)
    return solve_estimate(data, scene, shape=polytope(20))


def job_of(actions):
    data, scene, _ = octahedron(actions)
    job = make_job(data, scene, polytope(20), Options(), 0.0, PAGE)
    return replace(job, deadline=NEVER)


def rejected_an_update(caplog):
    return any("update rejected" in record.getMessage() for record in caplog.records)


@pytest.mark.slow
def test_an_action_more_ends_no_worse_than_all_from_scratch(early, caplog):
    data, scene, _ = octahedron(4)
    caplog.set_level(logging.INFO, "tactilenlp")
    later = solve_estimate(data, scene, shape=polytope(20), start=early)
    assert not rejected_an_update(caplog)
    assert later.position.shape == (data.samples, 3)
    assert later.quaternion[-1] == pytest.approx([1, 0, 0, 0], abs=1e-9)
    whole = solve_estimate(data, scene, shape=polytope(20))
    assert later.objective < whole.objective + 1.0  # [nats]
    assert later.seconds["search"] == 0 < whole.seconds["search"]


@pytest.mark.slow
def test_a_touch_that_no_hull_explains_sends_the_whole_way(early, caplog):
    data, scene, _ = octahedron(4)
    wrong = early.unknowns["theta"] * [[0.5], [0.5], [1.0]]  # far inside every touch
    doubtful = replace(early, unknowns=early.unknowns | {"theta": wrong})
    caplog.set_level(logging.INFO, "tactilenlp")
    solve_estimate(data, scene, shape=polytope(20), start=doubtful, throw=False)
    assert rejected_an_update(caplog)


@pytest.mark.slow
def test_only_an_estimate_of_all_actions_but_one_is_extended(early):
    assert incremental_polytope.is_one_action_more(early, job_of(4))
    assert not incremental_polytope.is_one_action_more(early, job_of(5))
    assert not incremental_polytope.is_one_action_more(early, job_of(3))
    assert not incremental_polytope.is_one_action_more(None, job_of(4))
    failed = replace(early, success=False)
    assert not incremental_polytope.is_one_action_more(failed, job_of(4))


@pytest.mark.slow
def test_the_past_is_posed_again_as_it_was_solved(early):
    past = incremental_polytope.past_solution(
        replace(job_of(4), cuts=early.cuts), early
    )
    x, data = past.problem.pack(early.unknowns), past.problem.data()
    for name in past.problem.costs:
        cost = past.problem.value(name, x, data).sum()
        # the sensors' noise is told from one action more
        assert cost == pytest.approx(early.costs[name], rel=1e-2, abs=1e-6), name
    assert not incremental_polytope.unexplained_touches(past)
    assert not incremental_polytope.implausible(past)
    x = past.solution.values["x"].copy()
    second = past.job.data.action[past.window.last] == early.measurements.action[-1]
    x[0, second] += 2 * incremental_polytope.LOST
    values = {**past.solution.values, "x": x}
    assert incremental_polytope.implausible(
        replace(past, solution=replace(past.solution, values=values))
    )


@pytest.mark.slow
def test_the_window_of_an_action_is_that_of_its_samples(early):
    job = job_of(4)
    past = incremental_polytope.past_solution(replace(job, cuts=early.cuts), early)
    samples = past.at.x.shape[1]
    more = job.data.samples - samples
    x = np.hstack([past.at.x, np.repeat(past.at.x[:, -1:], more, axis=1)])
    whole = job.window((past.at.theta, x))
    known = incremental_polytope.past_information(early)
    window = whole.of_action(past.at, known)
    for rows in (window.touch, window.free, window.step, window.push, window.gap):
        assert (rows.sample >= samples).all()
    assert (window.step.sample[window.push.step] == window.push.sample).all()
    assert sum(len(g.steps) for g in window.groups.values()) == len(window.step)
    for count, g in window.groups.items():
        assert (window.push.step[g.pushes] == g.steps[:, None]).all(), count
        assert (window.corner.step[g.corners] == g.steps[:, None]).all(), count
    held = window.lower == window.upper
    assert held[:, : whole.pose[samples]].all()
    assert not held[:, whole.pose[samples] :].any()


def test_the_world_sees_the_same_motion_in_other_axes():
    rng = np.random.default_rng(0)
    h = Hypothesis(rng.normal(size=12), rng.normal(size=(3, 5)), 0.0, ("any",))
    same, turn = h.with_axes_of_ground()
    assert same.x[2, -1] == 0
    assert turn @ h.theta[:3] == pytest.approx(same.theta[:3])
    for k in range(5):
        seen = []
        for one in (h, same):
            c, s = np.cos(one.x[2, k]), np.sin(one.x[2, k])
            turned = one.theta.reshape(-1, 3)[:, :2] @ [[c, s], [-s, c]]
            seen.append(turned + one.x[:2, k])
        assert seen[1] == pytest.approx(seen[0])


def test_other_legs_carry_the_same_force_and_moment():
    old = np.array([[0.03, 0, 0], [-0.02, 0.02, 0], [-0.02, -0.02, 0]])
    legs = np.array([[0.03, 0.01, 0], [0.02, -0.02, 0], [-0.03, 0, 0], [0, 0.03, 0]])
    yaw, rng = np.array([0.3, -1.0]), np.random.default_rng(1)
    impulses = rng.normal(size=(3, 2, 3))
    impulses[0] = [[1.0, 0.5, 0.7], [0.4, 0.3, 0.6]]
    found = incremental_polytope.redistributed(old, legs, yaw, impulses)
    for k, angle in enumerate(yaw):
        c, s = np.cos(angle), np.sin(angle)
        R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        wrenches = []
        for feet, lam in ((old, impulses[:, k]), (legs, found[:, k])):
            force = lam[[1, 2, 0]].T
            moment = np.cross(feet @ R.T, force).sum(axis=0)
            wrenches.append(np.r_[force.sum(axis=0), moment])
        assert wrenches[1] == pytest.approx(wrenches[0], abs=1e-9)
    assert (found[0] >= 0).all()


@pytest.mark.parametrize(
    ("gain", "closed"), [(DECISIVE - 1, True), (DECISIVE + 1, False)]
)
def test_a_face_that_nothing_felt_must_be_worth_its_price(gain, closed):
    job = SimpleNamespace(prior_cost=0.0, shape=polytope(20))

    def solved(objective, closed):
        theta, x = np.zeros(60), np.zeros((3, 2))
        hypothesis = Hypothesis(theta, x, 0.0, ("planes",), closed=closed)
        solution = SimpleNamespace(success=True, objective=objective)
        return Solved(hypothesis, None, solution, job)

    best, _ = best_first([solved(5.0 - gain, False), solved(5.0, True)])
    assert best.hypothesis.closed == closed


def test_a_file_without_the_field_says_closed_in_the_path():
    fields = {"theta": np.zeros(12), "x": np.zeros((3, 2)), "objective": 0.0}
    for path, closed in ((("planes", "closed"), True), (("planes",), False)):
        assert Hypothesis.from_file(path, **fields).closed == closed
    assert Hypothesis.from_file(("planes",), closed=True, **fields).closed
