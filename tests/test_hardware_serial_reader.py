"""Tactile sensors on ports and buses: unplugged, silent, read by one only."""

import itertools
import os
import re
import time
from contextlib import nullcontext
from types import SimpleNamespace

import can
import pytest
import serial
from bench import (
    ManualClock,
    Terminal,
    capture,
    complaint,
    forces,
    refused,
    terminal,
    wait_for,
)

from hardware.errors import BusError, HardwareError, StaleStreamError
from hardware.serial_reader import OptoForceCan, SerialTactile
from hardware.serial_tactile import (
    DATA_ID,
    OptoForceFramer,
    encode_configuration,
    encode_force,
    to_can,
)

__all__ = ["terminal"]  # a fixture
REAL = bytes.fromhex("AA07080A2D6A0000FFF7FFFB00070551")
channels = itertools.count()


# The port


def test_a_port_delivers_the_real_capture_exactly(terminal):
    data = capture("optoforce_omd_serial.bin").read_bytes()
    chunks = []
    sensor = SerialTactile(
        terminal.name, OptoForceFramer(), sink=lambda c, t: chunks.append(c)
    )
    with sensor:
        wait_for(lambda: sensor.opened)
        terminal.write(data)
        wait_for(lambda: sensor.framer.good == 34320)
    assert sensor.framer.broken == 54
    frames = sensor.take()
    assert len(frames) == 34320
    assert sensor.take() == []
    stamps = [stamp for stamp, _ in frames]
    assert stamps == sorted(stamps)
    assert b"".join(chunks)[: len(data)] == data


def test_the_sensor_is_configured_when_it_is_opened(terminal):
    packet = encode_configuration(333, 150)
    with SerialTactile(terminal.name, OptoForceFramer(), configure=packet):
        got = b""
        end = time.monotonic() + 5
        while len(got) < len(packet) and time.monotonic() < end:
            got += terminal.read()
    assert got == packet


def test_an_unplugged_sensor_is_missed_at_once_and_found_again(tmp_path):
    link = tmp_path / "ttyACM0"  # udev gives the same name again
    first = Terminal()
    link.symlink_to(first.name)
    with SerialTactile(str(link), OptoForceFramer(), name="finger 0") as sensor:
        wait_for(lambda: sensor.opened)
        first.write(REAL)
        wait_for(lambda: sensor.framer.good == 1)
        sensor.check(stale=10.0)
        first.unplug()
        link.unlink()
        error, passed = refused(sensor.check, since=time.monotonic())
        assert isinstance(error, StaleStreamError)
        assert "finger 0: no touch is sensed" in str(error)
        assert passed < 0.2
        second = Terminal()
        link.symlink_to(second.name)
        wait_for(lambda: sensor.opened == 2)
        second.write(REAL)
        wait_for(lambda: sensor.framer.good == 2)
        sensor.check(stale=10.0)
        second.unplug()


def test_a_silent_sensor_costs_no_time(terminal):
    with SerialTactile(terminal.name, OptoForceFramer()) as sensor:
        wait_for(lambda: sensor.opened)
        before = time.process_time()
        time.sleep(0.3)
        assert time.process_time() - before < 0.1
        with pytest.raises(StaleStreamError, match="silence"):
            sensor.check()


def test_a_port_that_is_not_there_is_said_with_the_reason():
    with SerialTactile("/dev/nowhere", OptoForceFramer()) as sensor:
        time.sleep(0.15)
        with pytest.raises(StaleStreamError, match="No such file"):
            sensor.check()


def waits(caplog):
    """How long [s] a lost device was left alone, by what was logged."""
    return [re.search(r"again in (.+) s", said)[1] for said in caplog.messages]


def test_a_port_is_tried_less_and_less_often_from_each_start(caplog):
    caplog.set_level("INFO", "hardware.reader")
    sensor = SerialTactile("/dev/nowhere", OptoForceFramer())
    for _ in range(2):
        caplog.clear()
        with sensor:
            wait_for(lambda: len(caplog.messages) > 2)
        assert waits(caplog)[:3] == ["0.05", "0.10", "0.20"]


def test_a_port_that_opens_but_refuses_is_tried_less_and_less_often(
    caplog, monkeypatch
):
    def refuse(data):
        raise serial.SerialException("it takes no bytes")

    port = nullcontext(SimpleNamespace(write=refuse))
    monkeypatch.setattr(serial, "serial_for_url", lambda url, **options: port)
    caplog.set_level("INFO", "hardware.reader")
    with SerialTactile("ttyACM0", OptoForceFramer(), configure=b"fast") as sensor:
        wait_for(lambda: len(caplog.messages) > 2)
    assert waits(caplog)[:3] == ["0.05", "0.10", "0.20"]
    assert sensor.opened > 2


def test_the_end_of_reading_is_no_fault(terminal, caplog):
    caplog.set_level("INFO", "hardware.reader")
    with SerialTactile(terminal.name, OptoForceFramer()) as sensor:
        wait_for(lambda: sensor.opened)
    assert caplog.messages == []
    assert "closed" not in str(refused(sensor.check, since=time.monotonic())[0])


@pytest.mark.parametrize("name", [None, "pci-0000:00:14.0-usb-0:1:1.0"])
def test_a_port_is_read_by_one_only(terminal, tmp_path, name):
    port = terminal.name
    if name is not None:  # udev makes such links in /dev/serial/by-path
        port = str(tmp_path / name)
        os.symlink(terminal.name, port)
    with SerialTactile(port, OptoForceFramer()) as sensor:
        wait_for(lambda: sensor.opened)
        with SerialTactile(port, OptoForceFramer()) as other:
            wait_for(lambda: other.age > 0.1)  # then `check` says the reason
            said = complaint(other)
            assert "lock" in said or "Resource" in said
        with pytest.raises(serial.SerialException):
            serial.Serial(terminal.name, exclusive=True)


def test_a_sink_that_fails_ends_in_its_own_error(terminal):
    def full(chunk, now):
        raise HardwareError("the disk is full")

    with SerialTactile(terminal.name, OptoForceFramer(), sink=full) as sensor:
        wait_for(lambda: sensor.opened)
        terminal.write(REAL)
        wait_for(lambda: "the disk is full" in complaint(sensor))
        with pytest.raises(HardwareError, match="the disk is full"):
            sensor.check()


def test_a_sensor_on_can_is_read_beside_the_boards():
    config = {"interface": "virtual", "channel": f"tactile {next(channels)}"}
    clock = ManualClock()
    with can.Bus(**config) as bus, OptoForceCan(config, clock=clock) as sensor:
        for frame in forces(30):
            for message in to_can(encode_force(frame), DATA_ID):
                bus.send(message)
            bus.send(can.Message(arbitration_id=0x30, data=bytes(8)))
        restarted = can.Message(arbitration_id=DATA_ID, data=bytes(8))
        restarted.is_error_frame = True
        bus.send(restarted)
        assert [frame for _, frame in sensor.take()] == forces(30)
        assert sensor.framer.skipped == 0
        sensor.check()
        clock.sleep(0.2)
        with pytest.raises(StaleStreamError):
            sensor.check()


def test_a_sensor_on_a_bus_that_is_not_there_says_so():
    with pytest.raises(BusError, match="cannot be opened"):
        OptoForceCan({"interface": "socketcan", "channel": "can97"}).__enter__()
    assert OptoForceCan().take() == []


def test_ports_are_closed_when_they_are_left(terminal):
    before = len(os.listdir("/proc/self/fd"))
    with SerialTactile(terminal.name, OptoForceFramer()) as sensor:
        wait_for(lambda: sensor.opened)
    assert len(os.listdir("/proc/self/fd")) == before
