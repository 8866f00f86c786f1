"""Recordings: what was heard comes back, on wires or as measurements."""

import itertools
import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import can
import numpy as np
import pytest
from bench import terminal

from hardware.__main__ import main
from hardware.assemble import assemble, examine
from hardware.bench import Bench
from hardware.errors import HardwareError, RecordingError, RigError
from hardware.motor_can import Pair, Quantity, decode, encode
from hardware.recording import Recording, device_times
from hardware.replay import Replay
from hardware.rig import FingerRig, Rig, Tactile
from hardware.serial_tactile import (
    AnySkinFramer,
    ForceFrame,
    encode_field,
    encode_force,
)
from hardware.simulated_robot import SimulatedRobot, simulated_rig
from hardware.tape import MANIFEST, Tape, stream_name
from hardware.world import RobotWorld
from tactilenlp.measurements import Measurements

__all__ = ["terminal"]  # a fixture
numbers = itertools.count()
S = np.linspace(0, 1, 11)[:, None, None]
ENDS = np.array(
    [[[0.1, 0, 0.06], [-0.1, 0, 0.06]], [[0.08, 0, 0.06], [-0.08, 0, 0.06]]]
)
PATH = SimpleNamespace(
    time=0.4 * S[:, 0, 0], finger_position=ENDS[0] + S * (ENDS[1] - ENDS[0])
)


def recorded(kind, folder, bus="blf"):
    """Record a short action of the simulated robot; return what its world measured."""
    if kind == "densetact":
        pytest.importorskip("cv2", reason="needs tactilenlp[optical]")
    rig = simulated_rig(kind, f"tape {next(numbers)}")
    starts = zip(rig.fingers, ENDS[0], strict=True)
    robot = SimulatedRobot(rig, angles=[f.geometry.inverse(p) for f, p in starts])
    options = {"clock": robot, "reader": robot.reader, "listen_only": False}
    tape = Tape(folder, rig, bus=bus)
    with robot, tape, Bench(rig, tape=tape, **options) as bench:
        world = RobotWorld(bench)
        data = world.execute(PATH)
    return data, world.origin


@pytest.fixture(scope="module")
def taped(tmp_path_factory):
    """A recording with OptoForce sensors on CAN, and what was measured live."""
    folder = tmp_path_factory.mktemp("tape") / "touches"
    return folder, *recorded("optoforce_can", folder)


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


def test_a_tape_that_cannot_be_written_says_so(tmp_path):
    (tmp_path / "file").write_text("in the way")
    rig = simulated_rig("optoforce_can")
    with pytest.raises(RecordingError, match="cannot be written"):
        Tape(tmp_path / "file" / "tape", rig).__enter__()
    with pytest.raises(RecordingError, match="no such format"):
        Tape(tmp_path / "tape", rig, bus="asc")


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


def test_counters_give_the_times_that_arrivals_blur():
    rng = np.random.default_rng(0)
    true = 1.7e9 + 1.00005 * np.arange(3000) / 1000
    arrival = true[np.minimum((np.arange(3000) // 16 + 1) * 16 - 1, 2999)]
    late = arrival + rng.exponential(2e-4, 3000)
    late = np.maximum.accumulate(late)
    frames = [
        (t, ForceFrame((65000 + k) % 65536, 0, (0, 0, 0))) for k, t in enumerate(late)
    ]
    times = device_times(frames, 1e-3)
    assert np.abs(times - true).max() < 2e-3
    assert np.abs(np.diff(times) - 1.00005e-3).max() < 1e-6
    assert np.abs(late - true).max() > 0.01


def test_a_sensor_that_was_switched_on_again_has_a_new_clock():
    counters = [*range(5000, 5500), *range(0, 500)]
    true = 1.7e9 + np.r_[np.arange(500), 900 + np.arange(500)] / 100
    frames = [
        (t, ForceFrame(c, 0, (0, 0, 0)))
        for t, c in zip(true.tolist(), counters, strict=True)
    ]
    assert np.abs(device_times(frames, 0.01) - true).max() < 1e-3


# Damage


@pytest.fixture
def copy(taped, tmp_path):
    folder, _, _ = taped
    return shutil.copytree(folder, tmp_path / "copy")


@pytest.mark.parametrize("content", ["", "{}", "[1]", '{"format": 7, "rig": {}}'])
def test_what_is_no_manifest_is_refused(copy, content):
    (copy / MANIFEST).write_text(content)
    with pytest.raises(RecordingError, match=r"manifest\.json"):
        Recording(copy)


def test_a_missing_stream_is_named(copy):
    next(copy.glob("finger_1_board_0.*")).unlink()
    with pytest.raises(RecordingError, match="finger_1_board_0"):
        Recording(copy).fingers()


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
    table = tmp_path / "tape" / "s.csv"
    table.write_text(table.read_text()[:-6])
    assert len(list(Recording(tmp_path / "tape").chunks("s"))) == 9
    raw = tmp_path / "tape" / "s.bin"
    raw.write_bytes(raw.read_bytes()[:22])
    assert len(list(Recording(tmp_path / "tape").chunks("s"))) == 4
    table.write_text("time,bytes\nnoon,5\n")
    with pytest.raises(RecordingError, match=r"s\.csv"):
        list(Recording(tmp_path / "tape").chunks("s"))


# Rigs


def test_a_rig_survives_its_file(tmp_path):
    for kind in ("densetact", "optoforce", "optoforce_can"):
        rig = simulated_rig(kind)
        rig.save(tmp_path / "rig.json")
        assert Rig.load(tmp_path / "rig.json") == rig


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"fingers": []}, "no fingers"),
        ({"finger": []}, "missing"),
        ({"fingers": [{"name": "a"}]}, "missing.*degrees"),
        ({"fingers": [{"nom": "a"}]}, "missing"),
    ],
)
def test_a_rig_that_is_not_understood_says_what_it_may_hold(tmp_path, change, word):
    path = tmp_path / "rig.json"
    path.write_text(json.dumps(change))
    with pytest.raises(RigError, match=word):
        Rig.load(path)


def test_parts_of_a_rig_are_checked_when_it_is_made():
    one = simulated_rig("optoforce_can").fingers[0]
    with pytest.raises(RigError, match="two boards"):
        Rig((replace(one, boards=({},)),))
    with pytest.raises(RigError, match="two of one name"):
        Rig((one, one))
    with pytest.raises(RigError, match="no such sensor"):
        Tactile("camera")
    with pytest.raises(RigError, match="no such robot"):
        Rig((replace(one, robot="trio"),))
    with pytest.raises(RigError, match="wrong options"):
        Tactile("optoforce", touch={"colour": "red"}).toucher()
    with pytest.raises(RigError, match="wrong options"):
        Tactile("densetact", touch={}).toucher()
    with pytest.raises(RigError, match="no rig"):
        Rig.load("/nowhere/rig.json")


def test_a_magnetic_skin_is_a_rig_too():
    tactile = Tactile("anyskin", source="/dev/ttyACM0", touch={"on": 80.0, "off": 50.0})
    reader = tactile.reader("skin", None, None)
    assert isinstance(reader.framer, AnySkinFramer)
    assert reader.baudrate == 115_200
    rest = SimpleNamespace(temperature=np.zeros(5), field=np.zeros((5, 3)))
    assert len(encode_field(rest)) == 82
    assert tactile.toucher().decide.on == 80.0


# The command line


def test_help_explains_itself(capsys):
    for name in ("record", "replay", "check", "assemble"):
        with pytest.raises(SystemExit) as leave:
            main([name, "--help"])
        assert leave.value.code == 0
        said = capsys.readouterr().out
        assert f"    python -m hardware {name} " in said  # one that can be copied
        assert "default:" in said
    done = subprocess.run(
        [sys.executable, "-W", "error", "-m", "hardware", "--help"],
        capture_output=True,
        text=True,
        check=True,
    )
    for word in ("record", "replay", "check", "assemble", "rig.json"):
        assert word in done.stdout


def test_a_recording_is_checked_and_assembled(taped, tmp_path, capsys):
    folder, _, _ = taped
    assert main(["check", str(folder)]) == 0
    told = capsys.readouterr().out
    assert "finger 1, board 0" in told
    assert "ended as it should and is complete enough." in told
    assert main(["check", str(folder), "--complete", "1.1"]) == 1
    out = tmp_path / "touches.npz"
    assert main(["assemble", str(folder), str(out)]) == 0
    data = Measurements.load(out)
    assert data.fingers == 2
    assert str(data.samples) in capsys.readouterr().out
    assert main(["assemble", str(folder), str(out), "--complete", "1.1"]) == 1
    assert "CompletenessError" in capsys.readouterr().err


def test_what_is_no_recording_is_told_without_a_traceback(tmp_path, capsys):
    assert main(["check", str(tmp_path)]) == 1
    assert capsys.readouterr().err.startswith("RecordingError: ")


def test_a_recording_sent_out_again_can_be_recorded_again(taped, tmp_path):
    folder, _, _ = taped

    def config(number):
        return {"interface": "virtual", "channel": f"again {number}"}

    with Replay(Recording(folder), config) as replay:
        tape = Tape(tmp_path / "copy", replay.rig)
        with tape, Bench(replay.rig, tape=tape) as bench:
            count = replay.run(speed=100)
            bench.poll()
    for stream in ("finger_0_board_0", "finger_1_board_1", "finger_1_tactile"):
        first, second = (
            [bytes(m.data) for m in Recording(f).messages(stream) if m.is_rx]
            for f in (folder, tmp_path / "copy")
        )
        assert second == first
    assert count == sum(tape.counts.values())
    assert count > 500


def test_serial_bytes_are_sent_to_a_terminal(tmp_path):
    rig = simulated_rig("optoforce", f"tape {next(numbers)}")
    sent = [encode_force(ForceFrame(k, 0, (k, 0, -k))) for k in range(20)]
    with Tape(tmp_path / "tape", rig) as tape:
        for one in rig.fingers:
            for k in range(2):
                bus = tape.can(stream_name(one.name, f"board {k}"))
                bus(encode(Pair(Quantity.POSITION, (0.0, 0.0)), 1.0))
            sink = tape.bytes(stream_name(one.name, "tactile"))
            for k, packet in enumerate(sent):
                sink(packet, 1.0 + k / 1000)

    def config(number):
        return {"interface": "virtual", "channel": f"sent {number}"}

    with Replay(Recording(tmp_path / "tape"), config) as replay:
        port = os.open(replay.rig.fingers[1].tactile.source, os.O_RDWR | os.O_NOCTTY)
        assert replay.run(speed=10) == 2 * (2 + 20)
        assert os.read(port, 4096) == b"".join(sent)
        os.close(port)
        with pytest.raises(HardwareError, match="no speed"):
            replay.run(speed=0)


def test_recording_ends_well_by_hand(tmp_path, monkeypatch, capsys):
    rig = simulated_rig("optoforce_can", f"tape {next(numbers)}")
    rig.save(tmp_path / "rig.json")
    monkeypatch.setattr("hardware.__main__.time.sleep", interrupt)
    assert main(["record", str(tmp_path / "rig.json"), str(tmp_path / "tape")]) == 0
    assert "stopped by hand" in capsys.readouterr().err
    assert Recording(tmp_path / "tape").complete


def interrupt(seconds):
    raise KeyboardInterrupt


def test_recording_a_silent_robot_ends_with_what_is_silent(tmp_path, capsys):
    rig = simulated_rig("optoforce_can", f"tape {next(numbers)}")
    rig.save(tmp_path / "rig.json")
    words = ["record", str(tmp_path / "rig.json"), str(tmp_path / "tape"), "--ask"]
    assert main([*words, "--patience", "0.1"]) == 1
    assert "StaleStreamError: finger 0, board 0" in capsys.readouterr().err
    assert not Recording(tmp_path / "tape").complete


def test_asking_sends_zero_current_and_enables_nothing(tmp_path):
    rig = simulated_rig("optoforce_can", f"tape {next(numbers)}")
    heard = []
    with can.Bus(**rig.fingers[0].boards[0]) as bus:
        asked = Bench(rig, listen_only=False)
        with asked:
            asked.boards[0].ask()
        while (message := bus.recv(timeout=0)) is not None:
            heard.append(bytes(message.data))
    assert heard[:2] == [bytes(8), bytes.fromhex("0000000100000014")]
    assert bytes.fromhex("0000000100000002") not in heard


def test_a_report_is_read_by_people(taped):
    folder, _, _ = taped
    report = examine(Recording(folder).fingers())
    lines = str(report).splitlines()
    assert len(lines) == 2 * 3 + 2
    assert "Hz" in lines[0]
    assert "% of" in lines[-1]


def test_a_finger_is_described_by_its_fields():
    names = set(FingerRig.__dataclass_fields__)
    assert {"name", "degrees", "boards", "tactile", "zero", "motors"} <= names
