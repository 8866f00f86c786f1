"""Files of CAN frames: what a killed process leaves behind can be read."""

import json
import shutil
import sys

import can
import numpy as np
import pytest

from hardware.bus_files import BusFile, read_frames
from hardware.errors import RecordingError
from hardware.motor_can import Pair, Quantity, encode
from hardware.recording import Recording
from hardware.simulated_robot import simulated_rig
from hardware.tape import MANIFEST, Tape

BEGIN = 1.7e9 + 0.4  # [s], stamp of the first frame
COUNT = 9_000  # frames: several blocks of a .blf


def frame(k):
    return encode(Pair(Quantity.POSITION, (k / 1024, -k / 1024)), BEGIN + k / 1000)


@pytest.fixture(scope="module", params=["blf", "log"])
def killed(request, tmp_path_factory):
    """A recording as SIGKILL leaves it: a copy of the files while they are open."""
    folder = tmp_path_factory.mktemp("killed")
    with Tape(folder / "tape", simulated_rig(), bus=request.param) as tape:
        sink, _ = tape.can("bus"), tape.can("silent")
        for k in range(COUNT):
            sink(frame(k))
        shutil.copytree(folder / "tape", folder / "copy")
    return folder / "copy", request.param


def test_the_times_of_a_killed_recording_are_absolute(killed):
    recording = Recording(killed[0])
    assert not recording.complete
    stamps = [message.timestamp for message in recording.messages("bus")]
    assert len(stamps) > COUNT / 2
    assert stamps == pytest.approx(BEGIN + np.arange(len(stamps)) / 1000, abs=2e-6)
    assert list(recording.messages("silent")) == []


def test_a_killed_recording_may_end_within_any_frame(killed, tmp_path):
    folder = shutil.copytree(killed[0], tmp_path / "copy")
    path = folder / f"bus.{killed[1]}"
    whole = path.read_bytes()
    counts = []
    for cut in (1, 2, 5, 16, 17, 31, 48, 59):
        path.write_bytes(whole[:-cut])
        messages = list(Recording(folder).messages("bus"))
        counts.append(len(messages))
        for k in (0, len(messages) - 1):
            assert bytes(messages[k].data) == bytes(frame(k).data)
    assert min(counts) > COUNT / 3
    path.write_bytes(whole[:4000] + b"\n?\n" + whole[4003:])
    with pytest.raises(RecordingError, match="cannot be read"):
        list(Recording(folder).messages("bus"))


def test_a_complete_recording_whose_end_is_missing_is_refused(killed, tmp_path):
    folder = shutil.copytree(killed[0], tmp_path / "copy")
    content = json.loads((folder / MANIFEST).read_text()) | {"complete": True}
    (folder / MANIFEST).write_text(json.dumps(content))
    path = folder / f"bus.{killed[1]}"
    text = "(1700000000.0) can0 03" if killed[1] == "log" else "LOBJ"
    path.write_bytes(path.read_bytes() + text.encode())
    with pytest.raises(RecordingError, match="cannot be read"):
        list(Recording(folder).messages("bus"))


def test_times_without_an_origin_are_refused(tmp_path):
    with Tape(tmp_path / "tape", simulated_rig()):
        pass
    with can.BLFWriter(tmp_path / "tape" / "bus.blf") as file:
        file.on_message_received(encode(Pair(Quantity.POSITION, (0.0, 0.0)), 12.0))
    with pytest.raises(RecordingError, match=r"bus\.blf: the times have lost"):
        list(Recording(tmp_path / "tape").messages("bus"))


def test_frames_of_before_the_first_one_keep_their_times(tmp_path):
    """A frame that is sent is stamped when it goes, others when they came."""
    file = BusFile(tmp_path / "bus.blf")
    for late in (0.0, -0.2, 0.1):
        file.write(encode(Pair(Quantity.POSITION, (0.0, 0.0)), BEGIN + late))
    file.close()
    with can.BLFReader(tmp_path / "bus.blf") as reader:
        stamps = [message.timestamp - BEGIN for message in reader]
    assert stamps == pytest.approx([0.0, -0.2, 0.1], abs=2e-6)


@pytest.mark.parametrize("bus", ["blf", "log"])
@pytest.mark.parametrize("stamp", [12.0, 1.2e9])
def test_times_of_a_clock_that_is_not_set_are_kept_or_refused(tmp_path, stamp, bus):
    """A .blf would hold one time for all: that of its header."""
    file = BusFile(tmp_path / f"bus.{bus}")
    message = encode(Pair(Quantity.POSITION, (0.0, 0.0)), stamp)
    if bus == "blf":
        with pytest.raises(RecordingError, match="set the clock"):
            file.write(message)
    else:
        file.write(message)
    file.close()
    kept = [one.timestamp for one in read_frames(tmp_path / f"bus.{bus}", cut=False)]
    assert kept == [stamp] * (bus == "log")


@pytest.mark.parametrize("count", [500, COUNT])
def test_all_frames_but_those_of_the_last_43_ms_are_on_the_disk(tmp_path, count):
    """Equal frames: a block of them is small when it is compressed."""
    file = BusFile(tmp_path / "bus.blf")
    for _ in range(count):
        file.write(frame(0))
    shutil.copy(tmp_path / "bus.blf", tmp_path / "copy.blf")
    file.close()
    with can.BLFReader(tmp_path / "copy.blf") as reader:
        assert count - sum(1 for _ in reader) <= 8 * 1024 / 48  # [bytes] of a frame


def at_line(number, action):
    """Return a tracer that acts once, at a line of python-can's writer."""
    left = [number]

    def trace(stack, event, argument):
        if "can/io" not in stack.f_code.co_filename.replace("\\", "/"):
            return None
        left[0] -= event == "line"
        if left[0] == 0 and event == "line":
            left[0] = -1
            action()
        return trace

    return trace


def traced(trace, write):
    """Write with a tracer; return whether it was interrupted."""
    sys.settrace(trace)
    try:
        write()
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(None)
    return False


@pytest.mark.parametrize("bus", ["blf", "log"])
@pytest.mark.parametrize("act", ["interrupt", "stop"])
def test_a_frame_that_is_interrupted_anywhere_leaves_a_whole_file(tmp_path, bus, act):
    """By Ctrl-C, or by a signal handler that stops the motors and records that."""
    block = 8192 // 48  # frames: the next one completes a block
    for line in range(1, 90):
        file = BusFile(tmp_path / f"{line}.{bus}")

        def interrupt(file=file):
            if act == "stop":
                file.write(frame(5000))
                return
            raise KeyboardInterrupt

        for k in range(block):
            file.write(frame(k))
        hit = traced(at_line(line, interrupt), lambda f=file: f.write(frame(block)))
        file.write(frame(block + 1))
        file.close()
        path = tmp_path / f"{line}.{bus}"
        back = [bytes(m.data) for m in read_frames(path, cut=False)]
        told = [*range(block), block, block + 1]
        assert [one for one in back if one != bytes(frame(5000).data)] == [
            bytes(frame(k).data) for k in told if bus == "blf" or not hit or k != block
        ]
