"""Sensors that are late: found, told, kept; and where poses are moved on to."""

import time
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tactilenlp import Estimate, Options, Scene, Workspace, World, solve_estimate
from tactilenlp.data.sensor_noise import (
    LATENCY,
    Precision,
    latency_cost,
    precision_of,
    reported_late,
    shift_in_time,
    shift_rotations,
    with_fingers_earlier,
)
from tactilenlp.errors import MistakeError, SceneError
from tactilenlp.estimation.observed_information import programme_at
from tactilenlp.geometry.transforms import quaternion_of
from tactilenlp.interface.readout import hull_poses
from tactilenlp.interface.request import make_job, read_request
from tactilenlp.interface.session import Session
from tactilenlp.problem.pages import page_of, shape_of
from tactilenlp.refinement.model_selection import evidence_of

SAMPLE = 1 / 30  # [s]


@pytest.fixture
def request_of(recorded):
    """Return function(page, **scene) -> Job of the first action."""
    data, scene, _ = recorded

    def made(page="violation_implicit", **told):
        shape = shape_of("cuboid")
        given = (
            data.select([0]),
            replace(scene, **told),
            shape,
            Options(),
            time.monotonic(),
        )
        return make_job(*given, page_of(page, shape))

    return made


def reported_later(data, samples: int):
    """Return data whose contacts and normals come so many samples later."""
    arrays = {k: np.zeros_like(getattr(data, k)) for k in ("contact", "normal")}
    valid = data.valid.copy()
    for action in np.unique(data.action):
        rows = np.flatnonzero(data.action == action)
        for name, array in arrays.items():
            array[rows[samples:]] = getattr(data, name)[rows[:-samples]]
        valid[rows[samples:]] = data.valid[rows[:-samples]]
    return replace(data, valid=valid, **arrays)


def test_values_are_linear_between_samples_and_beyond_those_of_an_action(recorded):
    data, *_ = recorded
    slope = np.where(data.action < 3, 2.0, -1.0)[:, None]
    values = np.hstack([slope * data.time[:, None], 0 * slope + 7.0])
    for by in (-0.4 * SAMPLE, 1.7 * SAMPLE):
        moved = shift_in_time(data, values, by)
        assert moved == pytest.approx(values + by * np.hstack([slope, 0 * slope]))
    assert (shift_in_time(data, values, 0.0) == values).all()


def test_a_sample_that_comes_twice_tells_no_velocity(recorded):
    data, *_ = recorded
    data = data.select([0])
    time = data.time.copy()
    time[-1] = time[-2] + 1e-6
    values = np.linspace(0, 1, data.samples)
    values[-1] += 1e-3  # a velocity of 1000 / s, if it told one
    moved = shift_in_time(replace(data, time=time), values, SAMPLE)
    assert np.abs(moved - values).max() < 0.05


def test_quaternions_turn_on_at_their_speed(recorded):
    data, *_ = recorded
    data = data.select([0])
    turn = Rotation.from_rotvec(np.outer(data.time - data.time[0], [0.0, 2.0, 0.0]))
    wxyz = quaternion_of(turn)
    wxyz[3] *= -1  # the same rotation
    moved = shift_rotations(data, wxyz, 0.05)
    off = Rotation.from_quat(np.roll(moved, -1, axis=1)) * turn.inv()
    assert off.as_rotvec() == pytest.approx(np.tile([0.0, 0.1, 0.0], (len(wxyz), 1)))


def test_fingers_are_where_they_were_and_the_rest_stays(recorded):
    data, *_ = recorded
    assert with_fingers_earlier(data, 0.0) is data
    wxyz = np.tile([1.0, 0.0, 0.0, 0.0], (data.samples, data.fingers, 1))
    capsules = replace(data, finger_orientation=wxyz)
    earlier = with_fingers_earlier(capsules, SAMPLE)
    same = data.action[1:] == data.action[:-1]
    was, now = data.finger_position[:-1][same], earlier.finger_position[1:][same]
    assert now == pytest.approx(was, abs=1e-5)  # times are not exactly SAMPLE apart
    assert earlier.finger_orientation == pytest.approx(wxyz)
    assert (earlier.contact == data.contact).all()


def test_what_late_sensors_tell_later_are_the_last_samples_of_actions(recorded):
    data, *_ = recorded
    assert not len(reported_late(data, 0.0))
    ends = np.flatnonzero(np.diff(data.action, append=data.actions))
    assert reported_late(data, 0.5 * SAMPLE).tolist() == ends.tolist()
    two = np.sort(np.r_[ends - 1, ends])
    assert reported_late(data, 1.5 * SAMPLE).tolist() == two.tolist()


def test_a_latency_costs_its_prior_unless_it_was_told(recorded):
    data, scene, _ = recorded
    late = Precision(0.0, 0.0, latency=LATENCY)
    assert latency_cost(scene, late) == pytest.approx(0.5)
    told = replace(scene, latency=LATENCY)
    assert latency_cost(told, late) == 0.0
    assert precision_of(data, told).latency == LATENCY
    assert precision_of(data, scene).latency == 0.0


def test_a_latency_is_sought_where_it_is_not_told_and_a_page_can(request_of):
    assert request_of().fixes("prompt")
    assert not request_of(latency=0.0).fixes("prompt")
    assert not request_of(page="shooting").fixes("prompt")


def test_a_job_of_late_sensors_keeps_what_was_recorded(request_of):
    job = request_of()
    assert job.recorded is None
    late = job.as_late_as(replace(job.precision, latency=0.5 * SAMPLE))
    assert late.recorded is job.data
    later = late.as_late_as(replace(job.precision, latency=SAMPLE))
    once = job.as_late_as(later.precision)
    assert later.data == once.data  # no interpolation of what was interpolated
    assert job.as_found(later).data == once.data
    assert later.as_late_as(job.precision).data is job.data
    assert later.prior_cost == pytest.approx((SAMPLE / LATENCY) ** 2 / 2)
    moved = late.of_data(lambda data: data.transformed(np.eye(3), (1.0, 0.0, 0.0)))
    away = moved.recorded.finger_position - job.data.finger_position
    assert away == pytest.approx(np.broadcast_to((1.0, 0.0, 0.0), away.shape))
    told = request_of(latency=SAMPLE)
    assert told.data == once.data
    assert told.prior_cost == 0.0


@pytest.mark.parametrize("wrong", [-0.01, 0.2, np.nan, "soon"])
def test_a_latency_that_cannot_be_is_refused(wrong):
    with pytest.raises(SceneError, match="latency"):
        Scene(latency=wrong)


def test_prompt_sensors_stay_prompt(estimate):
    assert estimate.latency == 0.0
    assert "later than" not in estimate.summary()


@pytest.fixture(scope="module")
def late(recorded):
    """The recording reported a sample later, and its estimate."""
    data, scene, _ = recorded
    data = reported_later(data.select(range(4)), 1)
    return data, scene, solve_estimate(data, scene)


@pytest.mark.slow
def test_a_latency_is_found_with_the_size_and_path_of_prompt_sensors(recorded, late):
    data, scene, _ = recorded
    _, _, found = late
    prompt = solve_estimate(data.select(range(4)), scene)
    error = found.precision["latency_error"]
    assert found.latency == pytest.approx(SAMPLE, abs=3 * error)
    assert error < 6e-3
    assert found.fit.verdict == "good"
    assert f"{1e3 * found.latency:.0f} ± " in found.summary()
    off = found.side_lengths - prompt.side_lengths
    assert np.abs(off).max() < 0.2e-3
    away = np.linalg.norm(found.position - prompt.position, axis=1)
    sigma = np.linalg.norm(found.sigma_position, axis=1)
    assert np.median(away) < 0.3e-3
    assert (away < 3 * sigma).mean() > 0.95
    assert found.objective < prompt.objective + 3.0


@pytest.mark.slow
def test_a_latency_that_is_told_is_taken(recorded, late):
    data, scene, found = late
    told = solve_estimate(data, replace(scene, latency=SAMPLE))
    assert told.latency == SAMPLE
    assert told.objective < found.objective + 1.0
    assert "later than" not in told.summary()
    prompt = solve_estimate(data, replace(scene, latency=0.0), throw=False)
    assert prompt.latency == 0.0
    assert prompt.objective > told.objective + 5.0
    shape = shape_of("cuboid")
    assert evidence_of(told, shape) > evidence_of(prompt, shape) + 5.0


def test_sensors_that_are_known_to_be_late_are_no_mistake(recorded):
    """Three samples are refused as a mistake, unless the scene tells of them."""
    data, scene, _ = recorded
    late = reported_later(data, 3)

    def asked(scene):
        given = shape_of("cuboid"), "violation_implicit", None, None, None
        return read_request(late, scene, *given, Session())[0].job

    with pytest.raises(MistakeError, match="samples too late"):
        asked(scene)
    told = asked(replace(scene, latency=3 * SAMPLE))
    assert told.precision.latency == 3 * SAMPLE


@pytest.mark.slow
def test_a_latency_is_saved_and_continued(recorded, late, tmp_path):
    _, scene, found = late
    found.save(tmp_path / "late.npz")
    again = Estimate.load(tmp_path / "late.npz")
    assert again.latency == found.latency
    programme = programme_at(again)  # of fingers as early as in the estimate
    problem, solution = programme.problem, programme.solution
    x, given = solution.at(problem)
    costs = {name: problem.value(name, x, given).sum() for name in problem.costs}
    assert sum(costs.values()) == pytest.approx(found.objective, rel=1e-9)
    more = reported_later(recorded[0].select(range(5)), 1)
    longer = solve_estimate(more, scene, start=again)
    assert longer.latency == pytest.approx(SAMPLE, abs=4e-3)
    assert longer.fit.verdict == "good"
    off = longer.side_lengths - found.side_lengths
    assert np.abs(off).max() < 0.3e-3


@pytest.mark.parametrize("lag", [0.0, SAMPLE, 0.05])
def test_a_hull_is_where_its_poses_are_moved_on_to(lag):
    """The pose that is held at zero is the last one that sensors told of."""
    yaw = np.linspace(-0.9, 0.0, 10)
    x = np.vstack([np.linspace(0.0, 0.09, 10), 0.02 * np.ones(10), yaw])
    x += lag / SAMPLE * (x[:, 1:2] - x[:, :1])
    vertices = np.random.default_rng(0).uniform(-0.03, 0.03, (8, 3))
    middle = vertices.mean(axis=0)
    position, turn = hull_poses(Scene(), x, middle)
    for t, (px, py, angle) in enumerate(x.T):
        true = Rotation.from_euler("z", angle).apply(vertices)
        true += np.array([px, py, 0])
        found = turn[t].apply(vertices - middle) + position[t]
        np.testing.assert_allclose(found, true, atol=1e-12)


def test_impulses_are_kept_at_the_ends_of_an_action(recorded):
    data, _, _ = recorded
    rows = np.flatnonzero(data.action == 1)
    pulse = np.zeros((data.samples, 3))
    pulse[rows[5]], pulse[rows[-1]] = 1.0, 2.0
    later = shift_in_time(data, pulse, 2 * SAMPLE, beyond=False)
    assert later[rows[3]] == pytest.approx(np.ones(3), abs=1e-3)
    assert later[rows[-3:]] == pytest.approx(2 * np.ones((3, 3)), abs=1e-3)
    assert np.array_equal(shift_in_time(data, pulse, 0.0, beyond=False), pulse)


@pytest.mark.slow
def test_contacts_lie_on_the_surface_of_late_and_of_prompt_bodies(estimate, late):
    for found in (estimate, late[2]):
        points, normals = found.contacts()
        felt = found.measurements.contact
        assert np.array_equal(np.isfinite(points).all(axis=2), felt)
        assert np.linalg.norm(normals[felt], axis=1) == pytest.approx(1)
        inside = np.abs(points[felt]) - found.side_lengths / 2
        assert np.abs(inside.max(axis=1)).max() < 0.2e-3


@pytest.mark.slow
def test_a_latency_is_found_at_a_high_rate():
    """The lower rate, at which models are selected, has too few samples for it."""
    space, rng = Workspace(), np.random.default_rng(5)
    world = World((0.05, 0.035, 0.04), rate=120.0)
    data = world.execute(space.random(rng).trajectory([0.0, 0.0, 0.02]))
    for _ in range(3):
        path = space.random(rng).trajectory(world.pose[:3])
        data = data.append(world.execute(path))
    unchecked = Options(check_mistakes=False)  # some are refused
    found = solve_estimate(reported_later(data, 4), options=unchecked)
    assert found.latency == pytest.approx(4 / 120, abs=0.01)
    assert found.fit.verdict == "good"
