"""Soft fingertips in a search of polytopes: how deep they sit, what is tried."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from programmes import octahedron

from formulations import polytope_violation_implicit
from formulations.indentation import COMPLIANCE_SIGMA
from formulations.polytope import polytope
from tactilenlp import Options
from tactilenlp.common.deadline import NEVER
from tactilenlp.interface.request import make_job
from tactilenlp.problem.reductions import Reductions
from tactilenlp.refinement.nested_models import lost_by_compliance
from tactilenlp.search.polytope_init import Searched
from tactilenlp.search.soft_fingertips import (
    as_of_rigid_fingertips,
    compliances_of,
    indentations,
)

G = 9.81  # [m/s^2]


def pressed(way, contact, action=None, missing=()):
    """Return data of one finger at way (T,) [m] along -x, normals along x."""
    samples, seen = len(way), np.ones(len(way), bool)
    seen[list(missing)] = False
    normal = np.zeros((samples, 1, 3))
    normal[np.array(contact, bool), 0, 0] = 1.0
    position = np.zeros((samples, 1, 3))
    position[:, 0, 0] = -np.array(way)
    return SimpleNamespace(
        finger_position=position, normal=normal,
        contact=np.array(contact, bool)[:, None],
        valid=seen[:, None],
        action=np.zeros(samples, int) if action is None else np.array(action),
    )  # fmt: skip


def depths(*arguments, **others):
    """Return the indentation (T,) [mm] of sliding fingertips of one millimetre."""
    return 1e3 * indentations(pressed(*arguments, **others), 1e-3)[:, 0]


def test_a_fingertip_sinks_in_to_its_depth_and_comes_out_as_it_retreats():
    way = 1e-3 * np.array([0, 0.4, 1.0, 2.0, 3.0, 2.7, 1.9, 1.0])
    felt = [0, 1, 1, 1, 1, 1, 1, 0]
    # Half of the way to the first touch is in contact; then all of it, up to the depth.
    np.testing.assert_allclose(depths(way, felt), [0, 0.2, 0.8, 1, 1, 0.7, 0, 0])


def test_an_action_that_begins_in_contact_begins_as_deep_as_when_sliding():
    way, action = 1e-3 * np.array([0, 0.1, 0.2, 0.2]), [0, 0, 1, 1]
    np.testing.assert_allclose(depths(way, [1, 1, 1, 1], action), [1, 1, 1, 1])
    np.testing.assert_allclose(depths(way, [0, 1, 0, 1], action), [0, 0.05, 0, 0])


def test_a_missing_sample_of_a_touch_does_not_let_the_fingertip_out():
    way = 1e-3 * np.array([0, 0.4, 0.6, 0.8])
    found = depths(way, [0, 1, 0, 1], missing=[2])
    np.testing.assert_allclose(found, [0, 0.2, 0.4, 0.6])


def job_of(data, scene, rigid=True):
    """Return a job without a time limit."""
    page = polytope_violation_implicit
    job = make_job(data, scene, polytope(8), Options(), 0.0, page)
    return replace(job, deadline=NEVER).with_reductions(rigid=rigid)


def pushed(rigid=True, **known):
    """Return a job of a pushed octahedron, of a scene where more is known."""
    data, scene, _ = octahedron(2)
    return job_of(data, replace(scene, **known), rigid)


def test_what_is_tried_is_what_the_scene_and_earlier_solves_leave_open():
    soft = pushed(rigid=False)
    assert compliances_of(pushed()) == {0.0: 0.0}
    assert compliances_of(pushed(rigid=False, ground=None)) == {0.0: 0.0}
    tried = compliances_of(soft)
    assert len(tried) > 1
    for c, cost in tried.items():
        assert cost == pytest.approx((c / COMPLIANCE_SIGMA) ** 2 / 2)
    assert compliances_of(soft, known=2e-3) == {2e-3: 0.0}
    known = pushed(compliance=1e-3)  # [m/N]
    assert compliances_of(known) == {1e-3 * known.scene.mass * G: 0.0}


def test_fingers_are_moved_outward_by_as_much_as_sliding_ones_sit_in():
    job = pushed(rigid=False)
    assert as_of_rigid_fingertips(job, None).data is job.data
    assert as_of_rigid_fingertips(job, 0.0).reductions == Reductions()
    moved = as_of_rigid_fingertips(job, 2e-3)
    way = moved.data.finger_position - job.data.finger_position
    felt = job.data.contact
    assert not way[~felt].any()
    inward = -(way * job.data.normal).sum(axis=2)[felt]
    assert inward.min() == pytest.approx(-2e-3 * job.scene.friction_ground)
    assert inward.max() <= 1e-12


def test_a_polytope_that_a_solve_found_soft_is_searched_again_once():
    rigid, soft = pushed(), pushed(rigid=False)
    found = SimpleNamespace(job=soft)
    assert lost_by_compliance(rigid, found)
    assert not lost_by_compliance(rigid.as_found(soft), found)
    assert not lost_by_compliance(rigid, SimpleNamespace(job=rigid))


@pytest.mark.slow
def test_planes_tell_the_compliance_of_fingertips(foreign):
    from foreign_bodies import Hull

    data, scene, _ = foreign.measured("contact", "default", 9901, 3, body=Hull)
    job = job_of(data, scene)
    ends = np.searchsorted(data.action, np.unique(data.action), side="right")
    cost = {}
    for c in (0.0, COMPLIANCE_SIGMA):
        way = Searched(as_of_rigid_fingertips(job, c), [], 0.0)
        for last in ends.tolist():
            way = way.extended(last)
        cost[c] = way.rank
    assert cost[COMPLIANCE_SIGMA] < cost[0.0] - 10.0  # [nats] 12.8 and 30.0
