"""What a sensor feels becomes a touch: thresholds, zero, normal."""

from dataclasses import replace

import numpy as np
import pytest

from hardware.__main__ import main
from hardware.bench import Bench
from hardware.errors import FrameError, SensorError
from hardware.serial_tactile import (
    FieldFrame,
    ForceFrame,
)
from hardware.simulated_robot import simulated_rig
from hardware.streams import touch_stream
from hardware.touch import FieldTouch, ForceTouch, Hysteresis, NoTouch, Tare, Touch


def test_contact_begins_and_ends_at_two_thresholds():
    decide = Hysteresis(on=2.0, off=1.0)
    strengths = [0.5, 1.5, 2.5, 1.5, 0.9, 1.5]
    assert [decide(s) for s in strengths] == [False, False, True, True, False, False]
    for on, off in ((1.0, 2.0), (1.0, 0.0), (np.nan, 1.0)):
        with pytest.raises(FrameError, match="off <= on"):
            Hysteresis(on, off)


def test_thresholds_are_above_everything_felt_without_contact():
    quiet = np.random.default_rng(0).normal(5.0, 0.5, 1000)
    learnt = Hysteresis.learn(quiet, least=1.0)
    assert quiet.max() < learnt.on < 9.0
    assert not any(map(learnt, quiet))
    assert Hysteresis.learn(np.zeros(10), least=1.0).on == 1.0
    with pytest.raises(FrameError, match="without contact"):
        Hysteresis.learn([], least=1.0)


def test_the_zero_is_the_mean_at_rest():
    tare = Tare(10)
    assert [tare(np.array([k])) for k in range(10)] == [None] * 10
    assert tare(np.array([4.5])).tolist() == [0.0]


def test_a_pressed_dome_gives_the_normal_of_what_presses_it():
    touch = ForceTouch(scale=(100, 100, 100), rest=5, mount=np.eye(3))
    x, y, z = 7, -3, 11
    for k in range(5):
        assert touch(k, ForceFrame(k, 0, (x, y, z))) is None
    light = touch(5, ForceFrame(5, 0, (x, y, z - 10)))
    assert (light.contact, light.normal.tolist()) == (False, [0, 0, 0])
    pressed = touch(6, ForceFrame(6, 0, (x + 30, y, z - 40)))
    assert pressed.contact
    assert pressed.strength == pytest.approx(0.5)  # [N]
    # from the object to the finger: into the dome
    assert pressed.normal == pytest.approx([0.6, 0, -0.8])
    assert not touch(7, ForceFrame(7, 1 << 10, (0, 0, 0))).valid


def test_a_skin_reports_whether_it_is_touched_not_where():
    touch = FieldTouch(on=10, off=5, rest=1)
    quiet = FieldFrame(np.full(5, 21.0), np.zeros((5, 3)))
    assert touch(0.0, quiet) is None
    felt = touch(1.0, replace(quiet, field=np.full((5, 3), 4.0)))
    assert felt.contact
    assert not felt.normal.any()


def test_of_the_samples_of_one_chunk_the_last_is_of_its_time():
    touches = [
        Touch(10.0 + 0.016 * (k // 16), True, np.array([0.0, 0.0, 1.0]), float(k))
        for k in range(64)
    ]
    stream = touch_stream("sensor", touches)
    assert stream.values[:, 2].tolist() == [15.0, 31.0, 47.0, 63.0]
    assert stream.report.doubles == 60


def test_a_bench_that_only_records_evaluates_nothing_and_keeps_failures():
    """Frames on the buses do not wait while pictures are evaluated."""

    class Sensor:
        name, waits = "sensor", []

        def __init__(self, *given):
            pass

        __enter__ = __exit__ = lambda self, *exception: None

        def take(self):
            waits, self.waits = self.waits, []
            return waits

        def check(self, stale):
            pass

    rig = simulated_rig("optoforce_can", "only records")
    with Bench(rig, reader=Sensor, touches=False) as bench:
        for one in bench.fingers:
            one.skin.reader.waits = [(0.0, "no frame: a toucher would refuse it")]
        bench.poll()
        assert not any(one.skin.touches for one in bench.fingers)
        bench.check_sensors()
        bench.fingers[1].skin.reader.waits = [(0.0, ForceFrame(0, 2 << 10, (0, 0, 0)))]
        bench.poll()
        with pytest.raises(SensorError, match="0x0800"):
            bench.check_sensors()


def test_the_recorder_evaluates_nothing(tmp_path, monkeypatch):
    rig = simulated_rig("optoforce_can", "recorder")
    rig.save(tmp_path / "rig.json")
    made, enter = [], Bench.__enter__
    monkeypatch.setattr(Bench, "__enter__", lambda b: made.append(b) or enter(b))
    words = ["record", str(tmp_path / "rig.json"), str(tmp_path / "tape")]
    assert main([*words, "--seconds", "0.01"]) == 0
    assert all(isinstance(one.skin.toucher, NoTouch) for one in made[0].fingers)
