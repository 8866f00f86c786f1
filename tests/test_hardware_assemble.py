"""From encoder counts and touches to measurements: nothing bent, nothing invented."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from hardware.assemble import LARGEST_GAP, assemble, examine
from hardware.errors import ClockError, CompletenessError, FrameError
from hardware.kinematics import finger
from hardware.motor_board import MotorBoard
from hardware.motor_can import RESOLUTION, Pair, Quantity, encode
from hardware.motor_joints import JointMap
from hardware.streams import FingerStreams, Stream, touch_stream
from hardware.touch import Touch
from tactilenlp.measurements import Measurements

NOON = 1.7e9  # [s], a time of day
JOINTS = JointMap(zero=(0.02, -0.4, 1.1))
NAMES = "finger 0", "finger 1"


def on_the_wire(stamps, angles, keep=None):
    """Send joint angles (n, 3) [rad] as frames of two boards, and read them back."""
    boards = [MotorBoard({}, name=f"board {k}") for k in range(2)]
    turns = JOINTS.revolutions(angles)
    for k, board in enumerate(boards):
        for n, stamp in enumerate(stamps):
            if keep is None or keep[n, k]:
                pair = Pair(Quantity.POSITION, tuple(turns[n, k].tolist()))
                board.on_message_received(encode(pair, float(stamp)))
    return tuple(
        Stream.sorted(board.name, *board.series(Quantity.POSITION)) for board in boards
    )


def streams(data, k, rng=None, dropped=0.0, jitter=0.0, latency=0.0):
    """Return what the wires of finger k give while one action is measured.

    Encoders at 1 kHz, touches at the samples of the data; `dropped` [1] of all frames,
    stamps late by up to `jitter` [s].
    """
    geometry = replace(finger("edu_dair", (180, 0)[k]), tip_radius=0.01)
    path = PchipInterpolator(data.time, data.finger_position[:, k])
    # encoders start before the first touch and end after the last
    dense = np.arange(-5, 1000 * (data.time[-1] - data.time[0]) + 6) / 1000
    inside = np.clip(dense, 0, data.time[-1] - data.time[0]) + data.time[0]
    angles = geometry.inverse(path(inside))
    keep, late = None, 0.0
    if rng is not None:
        keep = rng.random((len(dense), 2)) >= dropped
        late = rng.uniform(0, jitter, len(data.time))
    touches, R_wt = [], geometry.rotation(geometry.inverse(data.finger_position[:, k]))
    stamps = NOON + data.time + latency + late
    for n, stamp in enumerate(stamps.tolist()):
        if rng is None or rng.random() >= dropped:
            normal = R_wt[n].T @ data.normal[n, k]
            felt = bool(data.contact[n, k]), normal, 1.0, bool(data.valid[n, k])
            touches.append(Touch(stamp, *felt))
    boards = on_the_wire(NOON + data.time[0] + dense, angles, keep)
    touch = touch_stream(f"{NAMES[k]}, tactile", touches)
    return FingerStreams(NAMES[k], geometry, JOINTS, boards, touch, latency)


def again(data):
    """Send whole data over the wires, action by action, and assemble them."""
    parts = []
    for action in np.unique(data.action):
        one = data.select([action])
        fingers = [streams(one, k) for k in range(2)]
        parked = [NAMES[k] for k in range(2) if not one.valid[:, k].any()]
        options = {"action": int(action), "parked": parked}
        parts.append(assemble(fingers, origin=NOON, **options))
    whole = parts[0]
    for part in parts[1:]:
        whole = whole.append(part)
    return whole


def straight(T=31, touching=slice(10, 20)):
    """One action of two fingers that meet in the middle and touch for a while."""
    s = np.linspace(0, 1, T)[:, None]
    p = np.stack([[0.1, 0.01, 0.06] - s * [0.07, 0, 0.01]] * 2, axis=1)
    p[:, 1, 0] *= -1
    contact = np.zeros((T, 2), bool)
    contact[touching] = True
    normal = np.zeros((T, 2, 3))
    normal[touching] = [[0.8, 0.0, 0.6], [-1.0, 0.0, 0.0]]
    return Measurements(
        time=np.arange(T) / 30,
        finger_position=p,
        finger_radius=0.01,
        contact=contact,
        normal=normal,
        action=np.zeros(T, int),
    )


# The whole chain


def test_positions_come_back_within_the_quantisation_of_the_encoders(recorded):
    data, _, _ = recorded
    back = again(data)
    off = np.abs(back.finger_position - data.finger_position).max()
    # A count of Q24 is 0.02 um at the tip.  Stamps of 1.7e9 s have digits of 0.24 us:
    # 0.15 um at 0.3 m/s.  Straight lines between 1 kHz samples: 0.5 um at 4 m/s^2.
    assert RESOLUTION / 2 * 2 * np.pi / 9 * 0.35 < 2e-8
    assert off < 0.7e-6
    assert np.array_equal(back.contact, data.contact)
    assert np.abs(back.normal - data.normal).max() < 5e-6
    assert np.array_equal(back.valid, data.valid)
    assert np.abs(back.time - data.time).max() < 1e-6


def test_the_estimate_from_the_wires_is_that_from_the_simulator(recorded, estimate):
    from tactilenlp import solve_estimate

    data, scene, _ = recorded
    wired = solve_estimate(again(data.select(range(3))), scene)
    # All six faces within 0.1 mm, touched or not.  Corners are compared as a set: a
    # cuboid whose sides x and y are exchanged, and which is turned by 90 degrees, is
    # the same cuboid.
    there, here = (e.mesh().vertices for e in (wired, estimate))
    apart = np.linalg.norm(there[:, None] - here[None], axis=2)
    assert len(there) == len(here) == 8
    assert apart.min(axis=0).max() < 1e-4
    assert apart.min(axis=1).max() < 1e-4


def test_dropped_and_late_frames_lose_samples_but_invent_no_contact(recorded):
    data, _, _ = recorded
    for seed in range(3):
        rng = np.random.default_rng(seed)
        for action in range(6):
            one = data.select([action])
            fingers = [streams(one, k, rng, 0.05, 0.01) for k in range(2)]
            back = assemble(fingers, origin=NOON, complete=0.0)
            for k, wires in enumerate(fingers):
                check_that_contacts_were_felt(back, k, wires)
            assert not back.contact[~back.valid].any()
            assert back.valid[:, one.valid.any(axis=0)].mean() > 0.8


def check_that_contacts_were_felt(back, k, wires):
    """Every contact is a touch of the last 50 ms, with its normal."""
    stamps = wires.touch.time - NOON
    for n in np.flatnonzero(back.contact[:, k]):
        since = back.time[n] - stamps
        fresh = (since > -2e-6) & (since < 0.05 + 2e-6)
        newest = np.flatnonzero(fresh)[-1]
        assert wires.touch.values[newest, 0] == 1
        assert np.linalg.norm(back.normal[n, k]) == pytest.approx(1)


def test_positions_survive_dropped_frames_within_microns(recorded):
    data, _, _ = recorded
    one, rng = data.select([1]), np.random.default_rng(0)
    fingers = [streams(one, k, rng, 0.05) for k in range(2)]
    back = assemble(fingers, origin=NOON, complete=0.5)
    truth = PchipInterpolator(one.time, one.finger_position)(back.time)
    off = np.abs(back.finger_position - truth)[back.valid]
    assert off.max() < 5e-6


# The grid


def test_the_grid_is_uniform_and_inside_all_streams():
    one = straight()
    first, second = streams(one, 0), streams(one, 1)
    late = replace(second, touch=shifted(second.touch, 0.011, slice(2, -3)))
    data = assemble([first, late])
    assert np.diff(data.time) == pytest.approx(1 / 30, abs=1e-6)
    begin = max(first.touch.time[0], late.touch.time[0])
    end = min(first.touch.time[-1], late.touch.time[-1])
    assert data.samples == int((end - begin) * 30 + 1e-6) + 1
    assert data.time[0] == 0.0


def shifted(stream, by, rows=slice(None)):
    time, values = stream.time[rows] + by, stream.values[rows]
    return Stream.sorted(stream.report.name, time, values)


def test_an_action_is_cut_out_at_its_start_and_end():
    one = straight(61, slice(30, 40))
    fingers = [streams(one, k) for k in range(2)]
    data = assemble(fingers, start=NOON + 0.5, end=NOON + 1.5, origin=NOON)
    assert data.time[0] == pytest.approx(0.5, abs=1e-5)
    assert data.time[-1] == pytest.approx(1.5, abs=1e-5)


def test_streams_that_never_meet_are_refused():
    one = straight()
    first, second = streams(one, 0), streams(one, 1)
    apart = replace(second, touch=shifted(second.touch, 60.0))
    with pytest.raises(ClockError, match="do not overlap"):
        assemble([first, apart])


# Contact


def test_the_latency_of_a_sensor_is_taken_off():
    one = straight()
    data = assemble([streams(one, k, latency=0.033) for k in range(2)], origin=NOON)
    assert np.array_equal(data.contact, one.contact[: data.samples])
    ignored = [replace(streams(one, k, latency=0.033), latency=0.0) for k in range(2)]
    late = assemble(ignored, origin=NOON)
    begin = np.flatnonzero(late.contact[:, 0])[0]
    moved = late.finger_position[begin, 0] - one.finger_position[10, 0]
    assert np.linalg.norm(moved) > 1.5e-3  # the price, at 0.07 m/s


def test_contact_is_never_known_before_it_was_felt():
    one = straight()
    fingers = [streams(one, k) for k in range(2)]
    late = replace(fingers[1], touch=shifted(fingers[1].touch, 0.011))
    since = {"origin": NOON, "start": NOON + 0.03}  # the grid is that of finger 0
    data = assemble([fingers[0], late], **since)
    begin = data.time[np.flatnonzero(data.contact[:, 1])[0]]
    assert begin >= one.time[10] + 0.011 - 1e-6
    nearest = assemble([fingers[0], late], **since, nearest=True)
    assert nearest.time[np.flatnonzero(nearest.contact[:, 1])[0]] < begin


def test_an_old_touch_is_no_measurement_rather_than_no_contact():
    one = straight()
    wires = streams(one, 0)
    keep = np.ones(31, bool)
    keep[12:17] = False
    gap = Stream.sorted("gap", wires.touch.time[keep], wires.touch.values[keep])
    broken = replace(wires, touch=gap)
    data = assemble([broken, streams(one, 1)], origin=NOON, complete=0.8)
    assert np.flatnonzero(~data.valid[:, 0]).tolist() == [13, 14, 15, 16]
    assert data.contact[12, 0]  # 33 ms old
    assert not data.contact[13:17, 0].any()
    assert data.valid[:, 1].all()


def test_a_hole_in_the_encoders_is_no_measurement():
    one = straight()
    wires = streams(one, 0)
    stamps = wires.boards[0].time - NOON
    keep = (stamps < 0.4) | (stamps > 0.4 + LARGEST_GAP + 0.05)
    holed = Stream.sorted(
        "holed", wires.boards[0].time[keep], wires.boards[0].values[keep]
    )
    broken = replace(wires, boards=(holed, wires.boards[1]))
    data = assemble([broken, streams(one, 1)], origin=NOON, complete=0.8)
    bad = data.time[~data.valid[:, 0]]
    assert 0.39 < bad.min() <= bad.max() < 0.48
    assert np.isfinite(data.finger_position).all()


def test_a_normal_turns_with_the_finger_that_felt_it_and_is_not_blended():
    one = straight()
    data = assemble([streams(one, k) for k in range(2)], origin=NOON)
    assert np.allclose(data.normal[10:20, 0], [0.8, 0, 0.6], atol=1e-6)
    assert not data.normal[~data.contact].any()


def test_a_touch_without_a_normal_is_no_measurement_but_its_absence_is():
    touches = [
        Touch(0.0, False, np.zeros(3), 0.0),
        Touch(1.0, True, np.zeros(3), 1.0),  # a magnetic skin
        Touch(2.0, True, np.array([0, 0, 1.0]), 1.0),
        Touch(3.0, False, np.zeros(3), np.nan, valid=False),
    ]
    rows = touch_stream("skin", touches).values
    assert rows[:, 0].tolist() == [0, 0, 1, 0]
    assert rows[:, 1].tolist() == [1, 0, 1, 0]


def test_a_parked_finger_is_there_but_not_measured():
    one = straight()
    fingers = [streams(one, k) for k in range(2)]
    quiet = Stream.sorted(
        "quiet", fingers[1].touch.time[::4], fingers[1].touch.values[::4]
    )
    parked = replace(fingers[1], touch=quiet)
    data = assemble([fingers[0], parked], parked=["finger 1"], origin=NOON)
    assert not data.valid[:, 1].any()
    assert data.valid[:, 0].all()
    assert np.isfinite(data.finger_position).all()


# The judgement


def test_too_many_missing_samples_are_refused_with_a_report():
    one = straight()
    wires = streams(one, 0)
    holed = Stream.sorted("holed", wires.touch.time[::3], wires.touch.values[::3])
    broken = [replace(wires, touch=holed), streams(one, 1)]
    with pytest.raises(CompletenessError, match=r"finger 0.*valid") as caught:
        assemble(broken)
    report = caught.value.report
    assert report.valid["finger 0"] < 0.9 < report.valid["finger 1"]
    assert examine(broken) == report
    assert "holed: 11 samples at 10.0 Hz" in str(report)


def test_doubles_and_disorder_are_counted_and_mended():
    time = np.array([0.0, 0.1, 0.1, 0.3, 0.2, 0.4, 0.8])
    stream = Stream.sorted("mess", time, np.arange(7)[:, None])
    assert stream.time.tolist() == [0.0, 0.1, 0.2, 0.3, 0.4, 0.8]
    assert stream.values[:, 0].tolist() == [0, 1, 4, 3, 5, 6]
    report = stream.report
    assert (report.doubles, report.disordered, report.lost) == (1, 1, 3)
    assert report.rate == pytest.approx(10)
    assert report.largest_gap == pytest.approx(0.4)


def test_a_stream_of_nothing_is_refused_by_name():
    for time in ([], [1.0], [1.0, 1.0], [0.0, np.nan, 1.0]):
        with pytest.raises(FrameError, match="finger 3"):
            Stream.sorted("finger 3", time, np.zeros((len(time), 2)))
