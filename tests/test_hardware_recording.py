"""Recordings: what was heard comes back, on wires or as measurements."""

import json
import shutil

import numpy as np
import pytest
from bench_tape import recorded, taped

from hardware.assemble import assemble
from hardware.bench import Bench
from hardware.bus_files import BusFile
from hardware.errors import HardwareError, RecordingError
from hardware.motor_can import Pair, Quantity, Reference, decode, encode
from hardware.recording import Recording
from hardware.rig import Rig
from hardware.serial_tactile import (
    ForceFrame,
    encode_force,
)
from hardware.simulated_robot import simulated_rig
from hardware.tape import MANIFEST, Tape

__all__ = ["taped"]  # a fixture


# What comes back


def test_a_recording_gives_the_measurements_that_were_made_live(taped):
    folder, data, origin = taped
    recording = Recording(folder)
    assert recording.complete
    begin, end = origin + data.time[0] - 0.003, origin + data.time[-1]
    again = assemble(recording.fingers(), origin=origin, start=begin, end=end)
    assert again.samples >= data.samples - 1
    # counters give other stamps than arrivals did, by as much as these jitter
    for k in range(2):
        for live, back in zip(
            data.finger_position[:, k].T, again.finger_position[:, k].T, strict=True
        ):
            assert np.interp(again.time, data.time, live) == pytest.approx(
                back, abs=1e-4
            )
    assert not again.contact.any()
    assert again.valid.all()


@pytest.mark.slow
def test_pictures_and_buses_come_back_to_the_last_bit(tmp_path):
    data, origin = recorded("densetact", tmp_path / "tape")
    fingers = Recording(tmp_path / "tape").fingers()
    begin = origin + data.time[0]
    again = assemble(fingers, origin=origin, start=begin, end=begin + 0.401)
    n = min(again.samples, data.samples)
    off = np.abs(again.finger_position[:n] - data.finger_position[:n]).max()
    assert off < 1e-12
    assert n >= data.samples - 1


@pytest.mark.parametrize("bus", ["blf", "log"])
def test_frames_come_back_from_both_formats(tmp_path, bus):
    with Tape(tmp_path / "tape", simulated_rig(), bus=bus) as tape:
        sink = tape.can("bus")
        for k in range(100):
            message = encode(Pair(Quantity.POSITION, (k / 8, -k / 8)), 1.7e9 + k / 1000)
            message.channel = "a name with blanks"
            message.is_rx = k % 2 == 0
            sink(message)
    back = list(Recording(tmp_path / "tape").messages("bus"))
    stamps = [message.timestamp - 1.7e9 for message in back]
    assert stamps == pytest.approx(np.arange(100) / 1000, abs=2e-6)
    assert [message.is_rx for message in back] == [k % 2 == 0 for k in range(100)]
    assert decode(back[99]) == Pair(Quantity.POSITION, (99 / 8, -99 / 8))


def test_the_manifest_says_what_was_recorded_with_what(taped):
    folder, _, _ = taped
    content = json.loads((folder / MANIFEST).read_text())
    assert content["complete"]
    assert content["versions"]["python-can"]
    assert content["counts"]["finger_0_board_1"] > 100
    assert Rig.from_dict(content["rig"]) == Recording(folder).rig


def test_a_recording_is_never_overwritten(taped):
    folder, _, _ = taped
    tape = Tape(folder, simulated_rig("optoforce_can"))
    with pytest.raises(RecordingError, match="holds a recording already"):
        tape.__enter__()


@pytest.mark.parametrize("kind", ["optoforce_can", "optoforce", "densetact"])
def test_a_second_bench_does_not_overwrite_the_recording_of_the_first(tmp_path, kind):
    rig = simulated_rig(kind, f"twice {kind}")
    with Tape(tmp_path / "tape", rig) as tape:
        for one in rig.fingers:
            tape.sink(one.tactile.wire, f"{one.name} tactile")
        with Bench(rig, tape=tape):
            before = {f: f.read_bytes() for f in tape.folder.glob("*.*")}
        with pytest.raises(RecordingError, match=r"finger_0_board_0.*already"):
            Bench(rig, tape=tape).__enter__()
        for one in rig.fingers:
            with pytest.raises(RecordingError, match="already"):
                tape.sink(one.tactile.wire, f"{one.name} tactile")
        assert before == {f: f.read_bytes() for f in tape.folder.glob("*.*")}


def test_a_tape_that_cannot_be_written_says_so(tmp_path):
    (tmp_path / "file").write_text("in the way")
    rig = simulated_rig("optoforce_can")
    with pytest.raises(RecordingError, match="cannot be written"):
        Tape(tmp_path / "file" / "tape", rig).__enter__()
    with pytest.raises(RecordingError, match="no such format"):
        Tape(tmp_path / "tape", rig, bus="asc")


def filled(tape, kind, sent):
    """Record frames or chunks of 24 bytes until no file may grow any more."""
    import resource

    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    rng = np.random.default_rng(0)
    try:
        with tape:
            sink = tape.bytes("bus") if kind == "bytes" else tape.can("bus")
            resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, limits[1]))
            while len(sent) < 100_000:
                pair = Pair(Quantity.POSITION, tuple(rng.normal(size=2)))
                frame = encode(pair, 1.7e9 + len(sent) / 1000)
                sink(*((bytes(24), 1.7e9) if kind == "bytes" else (frame,)))
                sent.append(frame)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.parametrize("kind", ["blf", "log", "bytes"])
def test_a_full_disk_ends_a_tape_and_keeps_what_was_written(tmp_path, kind):
    pytest.importorskip("resource", reason="limits of files, of POSIX")
    bus, sent = "log" if kind == "bytes" else kind, []
    tape = Tape(tmp_path / "tape", simulated_rig("optoforce"), bus=bus)
    with pytest.raises(RecordingError, match="cannot be written") as caught:
        filled(tape, kind, sent)
    assert "free space" in caught.value.next
    recording = Recording(tmp_path / "tape")
    assert not recording.complete
    if kind == "bytes":
        assert [len(chunk) for _, chunk in recording.chunks("bus")] == [24] * len(sent)
        return
    kept = list(recording.messages("bus"))
    assert len(sent) - 1000 < len(kept) <= len(sent) + 1
    known = [bytes(frame.data) for frame in sent[: len(kept)]]
    assert [bytes(frame.data) for frame in kept[: len(sent)]] == known


def test_no_wire_is_recorded_after_the_failure_of_one(tmp_path, monkeypatch):
    def full(file, content):
        raise OSError(28, "No space left on device")

    with Tape(tmp_path / "tape", simulated_rig()) as tape:
        serial, bus = tape.bytes("serial"), tape.can("bus")
        monkeypatch.setattr("hardware.tape._append", full)
        with pytest.raises(RecordingError, match="No space"):
            serial(b"1", 0.0)
        monkeypatch.undo()  # there is space again
        for sink in (lambda: serial(b"2", 1.0), lambda: bus(encode(Reference((0, 0))))):
            with pytest.raises(RecordingError, match="No space"):
                sink()
    assert not Recording(tmp_path / "tape").complete
    assert list(Recording(tmp_path / "tape").chunks("serial")) == []


def test_serial_bytes_and_their_times_come_back(tmp_path):
    rig = simulated_rig("optoforce")
    packets = [encode_force(ForceFrame(k, 0, (k, 0, -k))) for k in range(100)]
    with Tape(tmp_path / "tape", rig) as tape:
        sink = tape.bytes("finger_0_tactile")
        for k, packet in enumerate(packets):
            sink(packet, 10.0 + k / 100)
    chunks = list(Recording(tmp_path / "tape").chunks("finger_0_tactile"))
    assert [chunk for _, chunk in chunks] == packets
    assert chunks[7][0] == pytest.approx(10.07, abs=1e-9)


# Clocks of devices


def retold(folder, **parts):
    """Change parts of the manifest of a recording."""
    content = json.loads((folder / MANIFEST).read_text())
    (folder / MANIFEST).write_text(json.dumps(content | parts))


def test_samples_that_a_bus_lost_are_counted_by_the_speed_of_the_sensor(copy):
    """Every second sample is missing: by the median interval none would be."""
    before = Recording(copy).fingers()[0].touch.report
    path = copy / "finger_0_tactile.blf"
    messages = list(Recording(copy).messages("finger_0_tactile"))
    path.unlink()
    file = BusFile(path)
    for k, message in enumerate(messages):
        if k // 2 % 2 == 0:  # a sample is two frames
            file.write(message)
    file.close()
    retold(copy, counts={})  # they were not written
    after = Recording(copy).fingers()[0].touch.report
    assert before.lost == 0
    assert after.lost == after.samples - 1
    assert after.rate == pytest.approx(50, rel=1e-3)  # fitted to arrivals of a second


# Damage


@pytest.fixture
def copy(taped, tmp_path):
    folder, _, _ = taped
    return shutil.copytree(folder, tmp_path / "copy")


COUNTS = '{"format": 1, "complete": true, "counts": {"bus": Infinity}, "rig": {}}'


@pytest.mark.parametrize(
    "content", ["", "{}", "[1]", '{"format": 7, "rig": {}}', COUNTS]
)
def test_what_is_no_manifest_is_refused(copy, content):
    (copy / MANIFEST).write_text(content)
    with pytest.raises(RecordingError, match=r"manifest\.json"):
        Recording(copy)


def test_a_missing_stream_is_named(copy):
    next(copy.glob("finger_1_board_0.*")).unlink()
    with pytest.raises(RecordingError, match="finger_1_board_0"):
        Recording(copy).fingers()


def test_a_complete_recording_of_which_a_part_is_missing_is_refused(tmp_path):
    """A copy that was interrupted: what remains can be read without an error."""
    frames = [encode(Pair(Quantity.POSITION, (k, 0.0)), 1.7e9 + k) for k in range(9)]
    with Tape(tmp_path / "tape", simulated_rig("optoforce"), bus="log") as tape:
        bus, serial = tape.can("bus"), tape.bytes("serial")
        for frame in frames:
            bus(frame)
            serial(bytes(24), frame.timestamp)
    assert len(list(Recording(tmp_path / "tape").chunks("serial"))) == 9
    log, raw = tmp_path / "tape" / "bus.log", tmp_path / "tape" / "serial.bin"
    log.write_text("".join(log.read_text().splitlines(True)[:6]))
    raw.write_bytes(raw.read_bytes()[: 7 * 24])
    whole = Recording(tmp_path / "tape")
    for read, got in ((whole.messages("bus"), 6), (whole.chunks("serial"), 7)):
        with pytest.raises(RecordingError, match=f"expected 9, .*got {got} frames"):
            list(read)
    retold(tmp_path / "tape", complete=False)
    assert len(list(Recording(tmp_path / "tape").messages("bus"))) == 6


def test_damaged_buses_raise_nothing_but_our_errors(copy):
    path = copy / "finger_0_board_0.blf"
    whole, rng = path.read_bytes(), np.random.default_rng(0)
    for k in range(40):
        data = bytearray(whole)
        if k % 2:
            del data[rng.integers(1, len(data)) :]
        for place in rng.integers(0, len(data), 3):
            data[place] ^= 1 << rng.integers(0, 8)
        path.write_bytes(bytes(data))
        try:
            for _ in Recording(copy).messages("finger_0_board_0"):
                pass
        except HardwareError:
            continue


def test_a_table_whose_end_is_missing_gives_what_is_whole(tmp_path):
    with Tape(tmp_path / "tape", simulated_rig("optoforce")) as tape:
        sink = tape.bytes("s")
        for k in range(10):
            sink(bytes([k] * 5), float(k))
    retold(tmp_path / "tape", complete=False)
    table = tmp_path / "tape" / "s.csv"
    table.write_text(table.read_text()[:-6])
    assert len(list(Recording(tmp_path / "tape").chunks("s"))) == 9
    raw = tmp_path / "tape" / "s.bin"
    raw.write_bytes(raw.read_bytes()[:22])
    assert len(list(Recording(tmp_path / "tape").chunks("s"))) == 4
    table.write_text("time,bytes\nnoon,5\n")
    with pytest.raises(RecordingError, match=r"s\.csv"):
        list(Recording(tmp_path / "tape").chunks("s"))
