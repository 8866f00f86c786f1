"""A recording with a common mistake is refused before it is solved, and named."""

import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import RECORDED

from tactilenlp import (
    Estimate,
    Ground,
    Measurements,
    Options,
    Scene,
    Workspace,
    World,
    solve_estimate,
)
from tactilenlp.common.deadline import Deadline
from tactilenlp.data import mistakes
from tactilenlp.data.mistakes import (
    check_mistakes,
    most_likely,
    record_of,
    suspicion,
)
from tactilenlp.data.plausibility import jumps_of, of_one_rate
from tactilenlp.data.sensor_noise import Precision
from tactilenlp.errors import MeasurementError, MistakeError, OptionError
from tactilenlp.interface.readout import with_suspicion
from tactilenlp.interface.request import CHECK_FOR_MISTAKES


@pytest.fixture(scope="module")
def data():
    return Measurements.load(RECORDED)


def later(array, f, shift):
    """Return an array whose column f is so many samples later in the whole record."""
    moved = array.copy()
    moved[:, f] = np.roll(array[:, f], shift, axis=0)
    return moved


def inverted(data):
    """Return measurements with contact inverted, all normals up."""
    contact = ~data.contact & data.valid
    return replace(
        data, contact=contact, normal=np.where(contact[..., None], [0, 0, 1.0], 0)
    )


MISTAKES = {  # measurements -> measurements, and what the message says
    "point into the object": lambda d: replace(d, normal=-d.normal),
    "normals (y, x, z)": lambda d: replace(d, normal=d.normal[..., [1, 0, 2]]),
    "normals (-x, y, z)": lambda d: replace(d, normal=d.normal * [-1, 1, 1]),
    "normals (z, x, y)": lambda d: replace(d, normal=d.normal[..., [1, 2, 0]]),
    "positions (y, x, z)": lambda d: replace(
        d, finger_position=d.finger_position[..., [1, 0, 2]]
    ),
    "give positions (x, y, -z)": lambda d: replace(
        d, finger_position=d.finger_position * [1, 1, -1]
    ),
    "multiply it by 0.1": lambda d: replace(d, finger_radius=10 * d.finger_radius),
    "multiply it by 100": lambda d: replace(d, finger_radius=d.finger_radius / 100),
    "fingers 0 and 1 are swapped": lambda d: replace(
        d, finger_position=d.finger_position[:, ::-1]
    ),
    "contact is inverted": inverted,
    "finger 0 feels is 5 samples too late": lambda d: replace(
        d, contact=later(d.contact, 0, 5), normal=later(d.normal, 0, 5)
    ),
    "finger 1 jumps": lambda d: replace(
        d, **{k: later(getattr(d, k), 1, 5) for k in ("contact", "normal")},
        finger_position=later(d.finger_position, 1, 5),
    ),
}  # fmt: skip


@pytest.mark.parametrize("words", MISTAKES)
def test_a_mistake_is_named_before_the_solve(data, words):
    with pytest.raises(MistakeError) as caught:
        solve_estimate(MISTAKES[words](data))
    assert words in str(caught.value)
    assert caught.value.nats > 0
    assert "check_mistakes=False" in str(caught.value)
    assert isinstance(pickle.loads(pickle.dumps(caught.value)), MeasurementError)


def test_a_correct_recording_is_not_refused_clean_or_noisy(data, scenes):
    check_mistakes(data, Scene())
    for name in ("cuboid_02", "stress_single_finger", "stress_tumble_tall"):
        for kind in ("", "_noisy"):
            found = Measurements.load(scenes / f"{name}{kind}.npz")
            _, gain, limit = most_likely(record_of(found, Scene()))
            assert gain < 0.6 * limit


def test_swapped_fingers_are_found_in_what_they_feel(data):
    touch = {"contact": data.contact[:, ::-1], "normal": data.normal[:, ::-1]}
    with pytest.raises(MistakeError, match="fingers 0 and 1 are swapped"):
        check_mistakes(replace(data, **touch), Scene())


def test_an_inexact_clock_is_no_jump(data):
    """Samples that are stamped too close together: a finger went as far as usual."""
    rng = np.random.default_rng(0)
    interval = float(np.median(np.diff(data.time)))
    off = rng.uniform(-0.45, 0.45, data.samples) * interval
    seen = replace(data, time=data.time + off)
    assert not jumps_of(record_of(seen, Scene())).any()
    check_mistakes(seen, Scene())


def test_a_wholly_mirrored_recording_cannot_be_detected(data):
    # Mirrored positions and normals are those of a mirrored world.
    flip = [-1.0, 1, 1]
    both = replace(
        data, finger_position=data.finger_position * flip, normal=data.normal * flip
    )
    given, mirrored = (most_likely(record_of(d, Scene())) for d in (data, both))
    assert mirrored[1] == pytest.approx(given[1])


def test_a_tilted_ground_changes_nothing(data):
    angle = 0.3
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    ground = Ground(height=0.0, normal=tuple(turn @ [0, 0, 1]))
    _, gain, limit = most_likely(
        record_of(data.transformed(turn, np.zeros(3)), Scene(ground=ground))
    )
    assert gain < limit


def test_the_check_for_mistakes_can_be_switched_off(data):
    wrong = MISTAKES["point into the object"](data)
    high = Scene(ground=Ground(height=1.0))  # so that the next check refuses
    with pytest.raises(MeasurementError, match="below"):
        solve_estimate(wrong, high, options=Options(check_mistakes=False))
    with pytest.raises(OptionError, match="check_mistakes"):
        Options(check_mistakes="no")


def test_normals_where_nothing_touches_say_that_contact_is_inverted(data):
    with pytest.raises(MeasurementError, match="give ~contact"):
        replace(data, contact=~data.contact)


def test_a_long_recording_is_checked_with_a_bounded_number_of_samples(
    data, monkeypatch
):
    # 47 changes of axes, twice; six units; two swaps; two fingers by 18 shifts; no
    # contact inverted: 139 likelihoods of at most MOST_SAMPLES samples.
    work = []

    def counted(record, terms=None):
        work.append(len(record.action))
        return likelihood(record, terms)

    likelihood = mistakes.log_likelihood
    monkeypatch.setattr(mistakes, "log_likelihood", counted)
    monkeypatch.setattr(mistakes, "MOST_SAMPLES", 300)
    long = data
    while long.samples <= 2 * mistakes.MOST_SAMPLES:
        again = replace(data, time=data.time + long.time[-1] + 1.0)
        long = long.append(again)
    check_mistakes(long, Scene())
    assert len(work) <= 1 + 2 * 47 + 6 + 2 + 2 * 18 + 1 + 2
    assert max(work) <= mistakes.MOST_SAMPLES


def test_a_body_without_a_ground_is_not_checked(data):
    wrong = MISTAKES["point into the object"](data)
    check_mistakes(wrong, Scene(ground=None))


def test_three_fingers_in_another_order_are_named():
    space, rng = Workspace(fingers=3), np.random.default_rng(2)
    world = World((0.05, 0.035, 0.04), finger_radius=[0.01] * 3)
    data = world.execute(space.random(rng).trajectory([0.0, 0.0, 0.02]))
    for _ in range(2):
        path = space.random(rng).trajectory(world.pose[:3])
        data = data.append(world.execute(path))
    check_mistakes(data, Scene())
    p = data.finger_position
    for words, wrong in (
        ("in another order", p[:, [1, 2, 0]]),
        ("in another order", p[:, [2, 0, 1]]),
        ("coordinates are swapped", p.transpose(0, 2, 1)),
    ):
        with pytest.raises(MistakeError, match=words):
            check_mistakes(replace(data, finger_position=wrong), Scene())


def poked(pokes: int, rest: int, press: float = 8e-3):
    """Return data of one finger that pokes the sides of a body that stands still.

    It is felt from the surface on, is held for `rest` samples where it is deepest, and
    no touch slows it: all of its path is commanded.
    """
    speed, far = 0.05 / 30, 0.03  # [m] in a sample, before a touch
    way = np.r_[np.arange(far, -press, -speed), np.full(rest, -press)]
    way = np.r_[way, way[-rest - 1 :: -1]]
    turns = np.arange(pokes) * np.pi / 2
    out = np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=1)
    depth = np.tile(way, pokes)
    normal = np.repeat(out, len(way), axis=0)
    position = (0.03 + depth[:, None]) * normal + [0, 0, 0.02]
    felt = depth[:, None] <= 0
    return Measurements(
        time=np.arange(len(depth)) / 30, finger_position=position[:, None],
        finger_radius=[0.01], contact=felt,
        normal=np.where(felt, normal, 0.0)[:, None],
        action=np.repeat(np.arange(pokes), len(way)),
    )  # fmt: skip


@pytest.mark.parametrize("rest", [0, 3, 8])
@pytest.mark.parametrize("pokes", [4, 12])
def test_a_finger_that_turns_round_or_stops_after_each_touch_is_no_mistake(pokes, rest):
    data = poked(pokes, rest)
    check_mistakes(data, Scene())
    _, gain, limit = most_likely(record_of(data, Scene()))
    assert gain < limit


def test_touches_that_end_while_a_finger_presses_on_are_one_departure():
    ends_well, gets_away = np.ones(10), np.full(10, 1e-6)
    once = of_one_rate(np.r_[np.ones(9), 1e-6], 0.1)
    often = of_one_rate(gets_away, 0.1)
    assert of_one_rate(ends_well, 0.1) == pytest.approx(0.0, abs=1e-9)
    assert -1.5 < once < -1.0
    assert -3.5 < often < once  # ten for the reason of one, not ten times as unlikely


def touched_later(data, f, shift):
    """Return data in which a finger feels all so many samples later in each action."""
    first = np.searchsorted(data.action, data.action)
    last = np.searchsorted(data.action, data.action, side="right") - 1
    source, moved = np.clip(np.arange(data.samples) - shift, first, last), {}
    for name in ("contact", "normal", "valid"):
        moved[name] = getattr(data, name).copy()
        moved[name][:, f] = moved[name][source, f]
    return replace(data, **moved)


def test_a_mistake_that_is_not_sure_enough_to_refuse_is_suspected(scenes):
    data = Measurements.load(scenes / "cuboid_09.npz")
    assert suspicion(data, Scene()) == ""
    late = touched_later(data, 1, 3)
    check_mistakes(late, Scene())
    assert "finger 1 feels is 3 samples too late" in suspicion(late, Scene())
    assert suspicion(late, Scene(ground=None, gravity=0.0)) == ""


@pytest.mark.parametrize(("left", "named"), [(60.0, True), (1.0, False)])
def test_a_mistake_is_suspected_only_where_there_is_time_to_look(
    data, estimate, left, named
):
    """The check took two seconds before the solve."""
    deadline = Deadline.within(left)
    deadline.spent[CHECK_FOR_MISTAKES] = 2.0
    job = SimpleNamespace(
        deadline=deadline, precision=Precision(0.0, 0.0), scene=Scene()
    )
    poor = estimate.fit.doubted("a doubt")
    found = with_suspicion(poor, job, touched_later(data, 0, 5))
    assert ("finger 0 feels is 5 samples too late" in found.text) == named
    assert with_suspicion(estimate.fit, job, data) is estimate.fit
    assert deadline.omitted == ([] if named else ["a check for mistakes"])


@pytest.mark.slow
def test_a_fit_that_is_not_good_names_the_mistake_that_is_suspected(scenes, tmp_path):
    data = touched_later(Measurements.load(scenes / "cuboid_09.npz"), 1, 3)
    estimate = solve_estimate(data, throw=False)
    assert estimate.fit.verdict != "good"
    words = (
        "A mistake in the data may be why: what finger 1 feels is 3 samples too late"
    )
    assert words in estimate.summary()
    estimate.save(tmp_path / "estimate.npz")
    assert Estimate.load(tmp_path / "estimate.npz").fit == estimate.fit
