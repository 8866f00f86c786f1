"""A box that fingers tip falls over its edge, or back onto the face it stood on."""

import time
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from formulations import violation_implicit as page
from formulations.shape import CUBOID
from tactilenlp import Options
from tactilenlp.geometry.tipping import QUARTER_TURN, Tip, planar_to_free
from tactilenlp.geometry.transforms import rotvecs
from tactilenlp.interface.request import make_job
from tactilenlp.search import proposals_tumble as tumble
from tactilenlp.search.proposals_tumble import tips_to_try

SIZES, STOOD = np.array([0.05, 0.04, 0.03]), np.array([0.1, -0.2, 0.4])
ANGLE = np.radians([0.0, 4.0, 9.0])


def test_a_box_that_falls_back_lies_as_it_stood():
    tip = Tip(1, 1.0, ANGLE, end=0.0)
    p, R = tip.poses(SIZES, STOOD)
    assert p[-1] == pytest.approx([*STOOD[:2], SIZES[2] / 2], abs=1e-12)
    assert R[-1] == pytest.approx(R[0], abs=1e-12)
    assert tip.renamed == pytest.approx(np.eye(3))


def test_a_box_that_falls_over_lies_on_the_side_behind_the_push():
    p, R = Tip(1, 1.0, ANGLE).poses(SIZES, STOOD)
    assert p[-1, 2] == pytest.approx(SIZES[1] / 2, abs=1e-12)
    assert np.abs(R[-1][2]) == pytest.approx([0, 1, 0], abs=1e-12)


@pytest.mark.parametrize(
    ("last", "ends"), [(9.0, {0.0, QUARTER_TURN}), (60.0, {QUARTER_TURN})]
)
def test_a_box_tipped_less_than_halfway_may_fall_back(last, ends):
    tip = Tip(0, -1.0, np.radians([0.0, last]))
    assert {way.end for _, way in tips_to_try(tip)} == ends


def test_of_many_falls_the_likeliest_are_continued(recorded, monkeypatch):
    data, scene, truth = recorded
    data = data.select([0, 1])
    job = make_job(data, scene, CUBOID, Options(), time.monotonic(), page)
    sides, T = truth["side_lengths"], data.samples
    R = Rotation.from_quat(np.roll(truth["object_quaternion"][:T], -1, axis=1))
    flat = np.vstack([truth["object_position"][:T, :2].T, R.as_euler("xyz").T[2]])
    x = planar_to_free(sides, flat)
    fall = tumble.Tumble(sides, x, "true", None, 0, Tip(0, 1.0, ANGLE))
    away = [replace(fall, x=x + np.eye(6)[:, :1] * d * 1e-3, name=d) for d in (9, 3, 6)]
    assert tumble.likeliest_tumbles(job, [*away, fall]) == [*away, fall]
    monkeypatch.setattr(tumble, "MAX_TUMBLES", 2)
    assert [t.name for t in tumble.likeliest_tumbles(job, [*away, fall])] == ["true", 3]


def test_rotation_vectors_go_on_beyond_half_a_turn():
    angle = np.linspace(0, 1.9 * np.pi, 40)
    turned = np.outer(angle, [0.6, 0.0, 0.8])
    R = Rotation.from_rotvec(turned).as_matrix()
    np.testing.assert_allclose(rotvecs(R), turned, atol=1e-9)
    np.testing.assert_allclose(rotvecs(R[:10]), turned[:10], atol=1e-9)


def test_a_push_that_tips_at_the_last_sample_leaves_no_time_to_fall(recorded):
    data, scene, _ = recorded
    data = data.select([1])
    contact, normal = data.contact.copy(), data.normal.copy()
    pusher = int(np.argmin(contact.sum(axis=0)))
    contact[:-1, pusher], contact[-1, pusher] = False, True
    tilt = np.radians(30.0)
    normal[:-1, pusher], normal[-1, pusher] = 0.0, (np.cos(tilt), 0.0, np.sin(tilt))
    data = replace(data, contact=contact, normal=normal)
    job = make_job(data, scene, CUBOID, Options(), time.monotonic(), page)
    falls = tumble.last_tumbles(job, ())
    assert falls
    assert {fall.x.shape for fall in falls} == {(6, data.samples)}


def test_rotation_vectors_are_continuous_over_several_turns():
    angle = np.linspace(0, 5 * np.pi, 60)
    w = np.outer(angle, [0.0, 0.6, 0.8])
    found = rotvecs(Rotation.from_rotvec(w).as_matrix())
    np.testing.assert_allclose(found, w, atol=1e-9)
