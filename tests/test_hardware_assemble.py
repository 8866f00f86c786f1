"""Streams onto one grid: nothing bent, nothing invented."""

from dataclasses import replace

import numpy as np
import pytest
from bench_wires import NOON, straight, streams

from hardware.assemble import LARGEST_GAP, _interpolated, assemble, examine
from hardware.errors import ClockError, CompletenessError, FrameError
from hardware.motor_board import MotorBoard
from hardware.simulated_robot import simulated_rig
from hardware.streams import (
    CONTACT,
    DECIDED,
    NORMAL,
    VALID,
    FingerStreams,
    Stream,
    touch_stream,
)
from hardware.touch import Touch

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


def test_of_the_positions_of_one_reading_the_last_is_of_its_time():
    """An adapter with a clock of its own: frames have the time of their reading."""
    rows = [(NOON + 0.016 * (k // 16), float(k), 0.0) for k in range(64)]
    boards = [MotorBoard({}, name=f"board {k}") for k in range(2)]
    touches = [Touch(NOON + k, False, np.zeros(3), 0.0) for k in range(3)]
    rig = simulated_rig("optoforce_can").fingers[0]
    for stream in FingerStreams.of(rig, boards, [rows, rows], touches).boards:
        assert stream.values[:, 0].tolist() == [15.0, 31.0, 47.0, 63.0]
        assert stream.report.doubles == 60


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


def test_a_position_at_the_end_of_a_hole_is_known_at_its_own_time():
    one = straight()
    wires = streams(one, 0)
    times, values = wires.boards[0].time, wires.boards[0].values
    hole = slice(np.searchsorted(times, NOON + 0.4), np.searchsorted(times, NOON + 0.5))
    known = times[[hole.start - 1, hole.stop]]
    holed = Stream.sorted(
        "holed", np.delete(times, hole), np.delete(values, hole, axis=0)
    )
    felt = np.r_[known, np.add(known, [1e-3, -1e-3])]
    at, valid = _interpolated(holed, felt)
    assert valid.tolist() == [True, True, False, False]
    assert at[1].tolist() == values[hole.stop].tolist()


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
    assert rows[:, 6].tolist() == [1, 1, 1, 0]


def test_touches_without_a_normal_are_not_missing_samples():
    one = straight()
    wires = streams(one, 0)
    values = wires.touch.values.copy()
    felt = values[:, 0] > 0
    values[felt, CONTACT] = values[felt, VALID] = 0.0  # as touch_stream has them
    values[felt, NORMAL] = 0.0
    blind = replace(wires, touch=Stream.sorted("blind", wires.touch.time, values))
    data = assemble([blind, streams(one, 1)], origin=NOON)
    assert np.array_equal(data.valid[:, 0], ~one.contact[: data.samples, 0])
    assert not data.contact[:, 0].any()
    values = values.copy()
    values[felt, DECIDED] = 0.0
    undecided = replace(wires, touch=Stream.sorted("mute", wires.touch.time, values))
    with pytest.raises(CompletenessError, match=r"finger 0.*valid"):
        assemble([undecided, streams(one, 1)], origin=NOON)


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
