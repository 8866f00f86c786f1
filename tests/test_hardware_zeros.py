"""When a sensor finds its zero, of what; what a failing sensor does to an action."""

import can
import numpy as np
import pytest
from bench_robot import FREE, Setup, poised

from hardware.errors import SensorError, StaleStreamError
from hardware.serial_tactile import (
    DATA_ID,
    ForceFrame,
    OptoForceFramer,
    encode_force,
    to_can,
)
from hardware.touch import ForceTouch

FAILURE, OVERLOAD = 2 << 10, 1 << 4  # bits of the status


def press(setup, until):
    """A hand presses all domes until a time [s] of the robot."""
    for one in setup.robot.fingers:
        send = one.skin.send

        def pressed(force, press, now, stamp, send=send):
            send(force + np.array([0.0, 2.0, 0.0]) * (now < until), press, now, stamp)

        one.skin.send = pressed


def replace_packets(setup, status=0, moving=True):
    """Finger 0's sensor sends other packets from now on, at 100 Hz."""
    dome, due = setup.robot.fingers[0].skin, [0.0]

    def send(force, press, now, stamp):
        if now < due[0]:
            return
        due[0] = now + 0.01
        dome._counter = (dome._counter + moving) % 65536
        frame = ForceFrame(dome._counter, status, (5, 5, 5))
        for message in to_can(encode_force(frame), DATA_ID, stamp):
            dome._bus.send(message)

    dome.send = send


def test_samples_of_before_the_start_do_not_enter_the_zero():
    with Setup() as setup:
        press(setup, setup.robot.now() + 0.5)
        setup.robot.sleep(1.0)
        setup.world.start()
        setup.robot.sleep(0.1)
        setup.bench.poll()
        for finger in setup.bench.fingers:
            assert not finger.skin.touches[-1].contact
            assert finger.skin.touches[-1].strength == pytest.approx(0.0, abs=0.02)


def test_a_second_start_finds_the_zero_again():
    with Setup() as setup:
        press(setup, setup.robot.now() + 1.5)
        setup.world.start()  # with the hand on it
        setup.world.stop()
        setup.robot.sleep(2.0)
        setup.world.start()
        setup.robot.sleep(0.1)
        setup.bench.poll()
        for finger in setup.bench.fingers:
            assert finger.skin.touches[-1].strength == pytest.approx(0.0, abs=0.02)


def test_a_second_start_does_not_enable_motors_without_the_sensors(monkeypatch):
    monkeypatch.setattr("hardware.bench.LEARN", 2.0)
    with Setup() as setup:
        setup.world.start()
        setup.world.stop()
        setup.robot.fingers[1].skin.silent = True
        setup.robot.sleep(1.0)
        with pytest.raises(StaleStreamError, match="finger 1, tactile"):
            setup.world.start()
        assert not setup.motors_enabled()


def test_a_sensor_that_fails_while_others_find_their_zero_is_noticed():
    with Setup() as setup:
        begin = setup.robot.now()

        def look(now):
            first, second = (one.skin for one in setup.robot.fingers)
            first.silent, second.silent = now > begin + 0.5, now < begin + 0.6

        setup.robot.after = look
        with pytest.raises(StaleStreamError, match="finger 0, tactile"):
            setup.world.start()
        assert not setup.motors_enabled()


@pytest.mark.parametrize("status", [FAILURE, OVERLOAD])
def test_faulty_frames_do_not_enter_the_zero(status):
    touch = ForceTouch(scale=(1, 1, 1), rest=4)
    for k in range(6):
        assert touch(0.0, ForceFrame(k, status, (9999, 0, 0))) is None
    for k in range(4):
        assert touch(0.0, ForceFrame(6 + k, 0, (-1200, 300, -900))) is None
    at_rest = touch(0.0, ForceFrame(10, 0, (-1200, 300, -900)))
    assert at_rest.strength == 0.0
    faulty = touch(0.0, ForceFrame(11, status, (-1200, 300, 5000)))
    assert not faulty.valid
    assert not faulty.contact


def test_a_failure_that_a_sensor_reports_ends_an_action():
    with Setup(angles=poised()) as setup:
        setup.world.start()
        done = setup.after(0.15, lambda: replace_packets(setup, FAILURE))
        with pytest.raises(SensorError, match=r"finger 0, tactile.*0x0800"):
            setup.world.execute(FREE)
        assert setup.robot.now() - done[0] < 0.03
        assert setup.left_in_peace()


def test_a_sensor_that_repeats_one_sample_is_silent():
    with Setup(angles=poised()) as setup:
        setup.world.start()
        done = setup.after(0.15, lambda: replace_packets(setup, moving=False))
        with pytest.raises(StaleStreamError, match="finger 0, tactile"):
            setup.world.execute(FREE)
        assert setup.robot.now() - done[0] < 0.14


def test_a_repeated_packet_is_counted_and_not_returned():
    framer = OptoForceFramer()
    packet = encode_force(ForceFrame(7, 0, (1, 2, 3)))
    later = encode_force(ForceFrame(9, 0, (1, 2, 3)))
    frames = framer.feed(packet * 3 + later)
    assert [frame.counter for frame in frames] == [7, 9]
    assert (framer.good, framer.repeated, framer.lost) == (4, 2, 1)


def test_a_bus_error_beside_a_sensor_is_no_failure_of_it():
    with Setup() as setup:
        setup.world.start()
        skin = setup.bench.fingers[0].skin
        frame = can.Message(arbitration_id=DATA_ID, data=bytes(8), is_error_frame=True)
        skin.reader.on_message_received(frame)
        skin.poll()
        skin.check(1.0)


def test_broken_frames_of_an_action_are_counted_in_its_report():
    with Setup() as setup:
        setup.world.start()
        sensor = setup.bench.fingers[0].skin.reader
        bad = bytearray(encode_force(ForceFrame(1, 0, (5, 5, 5))))
        bad[7] ^= 1

        def send(count):
            for message in count * to_can(bytes(bad), DATA_ID, setup.robot.wall()):
                sensor.on_message_received(message)

        for _ in range(2):  # those of before an action do not count
            send(5)
            setup.bench.remember()
            send(3)
            setup.robot.sleep(0.1)
            setup.bench.poll()
            first, second = (made() for made in setup.bench.taken())
            assert (first.touch.report.broken, second.touch.report.broken) == (3, 0)
