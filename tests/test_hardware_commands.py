"""python -m hardware: record, replay, check, assemble."""

import importlib
import os
import subprocess
import sys
import threading
from types import SimpleNamespace

import can
import pytest
from bench import ManualClock, terminal
from bench_tape import numbers, taped
from conftest import ROOT

from hardware.__main__ import main
from hardware.assemble import examine
from hardware.bench import Bench
from hardware.errors import HardwareError, StaleStreamError
from hardware.motor_can import (
    Command,
    Fault,
    Pair,
    Quantity,
    Status,
    encode,
    encode_command,
    encode_current,
)
from hardware.recording import Recording
from hardware.replay import Replay
from hardware.rig import FingerRig, stream_name
from hardware.serial_tactile import (
    CONFIG_ID,
    ForceFrame,
    encode_configuration,
    encode_force,
    to_can,
)
from hardware.simulated_robot import simulated_rig
from hardware.tape import Tape
from tactilenlp.data.measurements import Measurements

__all__ = ["taped", "terminal"]  # fixtures


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


def test_commands_that_another_program_sent_are_not_sent_again(tmp_path):
    """A listener records them as received: they would move a robot."""
    rig = simulated_rig("optoforce_can", f"tape {next(numbers)}")
    orders = [encode_command(Command.ENABLE_MOTOR_1, 1), encode_current(1.5, -1.5)]
    orders += list(to_can(encode_configuration(100), CONFIG_ID))
    measured = encode(Pair(Quantity.POSITION, (0.1, 0.2)))
    with Tape(tmp_path / "tape", rig) as tape:
        for one in rig.fingers:
            for part in ("board 0", "board 1", "tactile"):
                sink = tape.can(stream_name(one.name, part))
                for message in (*orders, measured):
                    message.timestamp = 1.7e9
                    sink(message)

    def config(number):
        return {"interface": "virtual", "channel": f"orders {number}"}

    recording = Recording(tmp_path / "tape")
    with Replay(recording, config) as replay, can.Bus(**config(1)) as board:
        assert replay.run() == 6
        assert bytes(board.recv(timeout=0).data) == bytes(measured.data)
        assert board.recv(timeout=0) is None


def test_a_replay_that_no_other_process_hears_is_refused(taped, tmp_path, capsys):
    words = ["replay", str(taped[0]), "--rig", str(tmp_path / "rig.json")]
    assert main([*words, "--interface", "virtual"]) == 1
    assert "no other process hears a virtual bus" in capsys.readouterr().err
    assert not (tmp_path / "rig.json").exists()


def test_serial_bytes_are_sent_to_a_terminal(tmp_path):
    rig = simulated_rig("optoforce", f"tape {next(numbers)}")
    sent = [encode_force(ForceFrame(k, 0, (k, 0, -k))) for k in range(20)]
    with Tape(tmp_path / "tape", rig) as tape:
        for one in rig.fingers:
            for k in range(2):
                bus = tape.can(stream_name(one.name, f"board {k}"))
                bus(encode(Pair(Quantity.POSITION, (0.0, 0.0)), 1.7e9))
            sink = tape.bytes(stream_name(one.name, "tactile"))
            for k, packet in enumerate(sent):
                sink(packet, 1.7e9 + k / 1000)

    def config(number):
        return {"interface": "virtual", "channel": f"sent {number}"}

    with Replay(Recording(tmp_path / "tape"), config) as replay:
        port = os.open(replay.rig.fingers[1].tactile.source, os.O_RDWR | os.O_NOCTTY)
        assert replay.run(speed=10) == 2 * (2 + 20)
        got, whole = b"", b"".join(sent)
        while len(got) < len(whole):  # a terminal hands over what has come so far
            got += os.read(port, 4096)
        assert got == whole
        os.close(port)
        with pytest.raises(HardwareError, match="speed: out of range"):
            replay.run(speed=0)


def test_a_frame_that_is_late_is_not_slept_for():
    rig, slept = simulated_rig("optoforce_can"), []

    class Late(ManualClock):
        def sleep(self, duration):
            slept.append(duration)
            self.time += duration + 1.0

    def messages(stream):
        times = (0.0, 1.0, 1.0, 1.5, 3.0) if stream == "finger_0_board_0" else ()
        return [encode(Pair(Quantity.POSITION, (0.0, 0.0)), t) for t in times]

    def config(number):
        return {"interface": "virtual", "channel": f"late {number}"}

    recording = SimpleNamespace(rig=rig, messages=messages)
    with Replay(recording, config, Late(0.0)) as replay:
        assert replay.run() == 5
    assert slept == [1.0, 1.0]


def test_without_pseudo_terminals_only_serial_bytes_are_not_sent(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "tty", None)  # as on Windows
    for name in ("hardware.replay", "hardware.__main__"):
        monkeypatch.delitem(sys.modules, name)
        importlib.import_module(name)
    rig = simulated_rig("optoforce", f"tape {next(numbers)}")
    with Tape(tmp_path / "tape", rig):
        pass
    replay = Replay(
        Recording(tmp_path / "tape"),
        lambda number: {"interface": "virtual", "channel": f"no terminal {number}"},
    )
    with pytest.raises(HardwareError, match="finger_0_tactile: serial bytes"):
        replay.__enter__()


def test_recording_ends_well_by_hand(tmp_path, monkeypatch, capsys):
    rig = simulated_rig("optoforce_can", f"tape {next(numbers)}")
    rig.save(tmp_path / "rig.json")
    monkeypatch.setattr("hardware.__main__.time.sleep", interrupt)
    assert main(["record", str(tmp_path / "rig.json"), str(tmp_path / "tape")]) == 0
    assert "stopped by hand" in capsys.readouterr().err
    assert Recording(tmp_path / "tape").complete


def test_a_recording_that_is_killed_is_closed_first(tmp_path):
    rig = simulated_rig("optoforce_can", f"tape {next(numbers)}")
    rig.save(tmp_path / "rig.json")
    words = ["record", "rig.json", "tape", "--patience", "60"]
    with subprocess.Popen(
        [sys.executable, "-m", "hardware", *words], cwd=tmp_path, text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    ) as process:  # fmt: skip
        assert "finger_1_board_1" in process.stdout.readline()
        process.terminate()
        assert "stopped by hand" in process.communicate(timeout=60)[1]
    assert process.returncode == 0
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


def test_a_recording_goes_on_through_faults_and_error_frames(tmp_path, capsys):
    rig = simulated_rig("optoforce_can", f"tape {next(numbers)}")
    rig.save(tmp_path / "rig.json")
    quiet = Status(True, (False, False), (False, False), Fault.RECEIVE_TIMEOUT)
    off = can.Message(arbitration_id=0x40, data=bytes(8), is_error_frame=True)
    words = ["record", str(tmp_path / "rig.json"), str(tmp_path / "tape")]
    with can.Bus(**rig.fingers[0].boards[1]) as bus:
        timer = threading.Timer(0.05, lambda: [bus.send(encode(quiet)), bus.send(off)])
        timer.start()
        assert main([*words, "--seconds", "0.2"]) == 0
        timer.join()
    said = capsys.readouterr().out
    counts = "error frames 1, broken frames 0, faults RECEIVE_TIMEOUT"
    assert f"finger 0, board 1: {counts}\n" in said
    assert "finger 0, board 0: " not in said
    assert Recording(tmp_path / "tape").complete


def test_the_patience_of_a_recording_holds_for_the_status_too():
    rig, clock = simulated_rig("optoforce_can", f"tape {next(numbers)}"), ManualClock()
    with Bench(rig, clock=clock) as bench:
        clock.time += 4.0
        bench.check_heard(6.0)
        with pytest.raises(StaleStreamError, match=r"expected one every 3\.5 s"):
            bench.check_heard(3.5)
        for board in bench.boards:
            board._heard["POSITION"] = clock.now()
        with pytest.raises(StaleStreamError, match="no status"):
            bench.check_heard(1.0)


def test_asking_sends_zero_current_and_enables_nothing(tmp_path):
    rig = simulated_rig("optoforce_can", f"tape {next(numbers)}")
    heard = []
    with can.Bus(**rig.fingers[0].boards[0]) as bus:
        asked = Bench(rig, listen_only=False)
        with asked:
            asked.boards[0].ask()
        while (message := bus.recv(timeout=0)) is not None:
            heard.append(bytes(message.data))
    # and no stop at the end: another program may drive the robot
    assert heard == [bytes(8), bytes.fromhex("0000000100000014")]


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
