"""Which touches lie on one plane of a body, and which are none: flips and noise."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from programmes import OCTAHEDRON, octahedron

from tactilenlp import Measurements, solve_estimate, surface_distance
from tactilenlp.data.contact_segments import contact_segments, without_outliers
from tactilenlp.data.noise_model import Noise, add_noise
from tactilenlp.errors import NoContactError

NOISE = Noise(position=1e-3, normal=np.radians(5), flips=0.01)


@pytest.fixture(scope="module")
def slid():
    return Measurements.load(OCTAHEDRON)


def touches(angles, samples=None, finger=0):
    """Return touches of a finger whose normals lie at these azimuths [rad]."""
    angles = np.asarray(angles, float)
    n = np.stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))], axis=1)
    samples = np.arange(len(angles)) if samples is None else np.asarray(samples)
    return SimpleNamespace(
        sample=samples, finger=np.full(len(angles), finger), normal=n
    )


def lone_silence(data):
    """Return (sample, finger) amid a touch of one finger."""
    c = data.contact & data.valid
    amid = c[2:] & c[1:-1] & c[:-2] & (data.action[2:] == data.action[:-2])[:, None]
    t, f = np.argwhere(amid)[0]
    return t + 1, f


def test_a_touch_of_one_sample_is_not_used(slid):
    free = ~slid.contact & slid.valid
    contact, normal = slid.contact.copy(), slid.normal.copy()
    t = int(np.argmax(free[:, 0]))  # the hand is still on its way: all silent
    contact[t, 0], normal[t, 0] = True, [0.0, 0.6, 0.8]
    flipped = replace(slid, contact=contact, normal=normal)
    assert not without_outliers(flipped, 0.0).valid[t, 0]
    assert without_outliers(flipped, 0.0).valid[t + 1, 0]


def test_one_missing_sample_within_a_touch_is_not_used_as_free(slid):
    t, f = lone_silence(slid)
    contact, normal = slid.contact.copy(), slid.normal.copy()
    contact[t, f], normal[t, f] = False, 0.0
    found = without_outliers(replace(slid, contact=contact, normal=normal), 0.0)
    assert not found.valid[t, f]
    assert found.valid[t - 1, f]
    assert found.valid[t + 1, f]


def test_normals_that_turn_between_samples_are_refused_by_name(recorded):
    data, scene, _ = recorded
    data = data.select([0])
    turn = 2 * np.pi / 3 * np.arange(data.samples)  # no two of three samples agree
    way = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)[:, None]
    spun = replace(data, normal=np.where(data.contact[..., None], way, 0.0))
    with pytest.raises(
        NoContactError, match=r"normal: no touch is confirmed"
    ) as caught:
        solve_estimate(spun, scene, shape="polytope")
    assert "touches, none like another" in caught.value.got
    assert caught.value.next


def test_outlier_rejection_keeps_lasting_touches(slid):
    found = without_outliers(slid, np.radians(5))
    assert (found.contact == slid.contact).all()
    felt = slid.contact & slid.valid
    assert (found.valid & felt).sum() >= felt.sum() - 1


def test_a_noisy_face_is_one_run_and_two_faces_are_two():
    rng, sigma = np.random.default_rng(0), np.radians(5)
    one = touches(sigma * rng.normal(size=14))
    assert contact_segments(one, sigma).tolist() == [0] * 14
    two = touches(np.repeat([0.0, 0.7], 7) + sigma * rng.normal(size=14))
    assert contact_segments(two, sigma).tolist() == [0] * 7 + [1] * 7


def test_exact_normals_that_differ_are_different_runs():
    rolling = touches([0, 0, 0, 0.1, 0.2, 0.2])
    assert contact_segments(rolling, 0.0).tolist() == [0, 0, 0, 1, 2, 2]


def test_a_finger_that_let_go_begins_a_run():
    parted = touches(np.zeros(6), samples=[0, 1, 3, 7, 8, 9])
    assert contact_segments(parted, 0.0).tolist() == [0, 0, 0, 1, 1, 1]
    assert contact_segments(touches([]), 0.0).tolist() == []


def test_a_body_is_found_from_noisy_sensors():
    data, scene, truth = octahedron(6)
    given = {"shape": "polytope", "formulation": "quasi_static"}
    found = solve_estimate(add_noise(data, NOISE), scene, **given)
    distance = surface_distance(truth, found.mesh(), samples=500)
    assert distance.a_to_b < 2.5e-3  # 1 mm in every position; two thirds of the touches
    assert distance.b_to_a < 4e-3  # what was not touched is a ball about the corners
