"""Whatever goes wrong on the robot, it ends in time and without current."""

from dataclasses import replace

import can
import pytest
from bench import Terminal, terminal, wait_for
from bench_robot import FREE, Setup, numbers, stop_a_board
from bench_wires import line, slcan

from hardware.errors import (
    BoardError,
    BusError,
    CompletenessError,
    HardwareError,
    LimitError,
    StaleStreamError,
)
from hardware.impedance import Limits
from hardware.motor_can import Fault
from hardware.recording import Recording
from hardware.simulated_robot import simulated_rig

__all__ = ["terminal"]  # a fixture


def stop_a_sensor(setup):
    setup.robot.fingers[0].skin.silent = True


def fail_a_board(setup):
    setup.robot.fingers[0].boards[1].fail(Fault.ENCODER)


def close_a_bus(setup):
    setup.bench.fingers[0].boards[0].bus.shutdown()


def report_bus_off(setup):
    frame = can.Message(arbitration_id=0x40, data=bytes(8), is_error_frame=True)
    setup.robot.fingers[1].boards[1].send(frame)


def press_ctrl_c(setup):
    raise KeyboardInterrupt


class Held:
    """A clock of the control loop after which a second has passed at once."""

    def __init__(self, clock):
        self.clock, self.sleep = clock, clock.sleep

    def now(self):
        return self.clock.now() + 1.0


def hang(setup):
    setup.world.clock = Held(setup.world.clock)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("harm", "error", "word"),
    [
        (stop_a_board, StaleStreamError, "finger 1, board 0: no position"),
        (stop_a_sensor, StaleStreamError, "finger 0, tactile: no touch"),
        (fail_a_board, BoardError, "finger 0, board 1.*ENCODER"),
        (close_a_bus, BusError, "finger 0, board 0: cannot"),
        (report_bus_off, BusError, "the bus is off"),
        (press_ctrl_c, KeyboardInterrupt, "^$"),
        (hang, HardwareError, "held up"),
    ],
)
def test_whatever_goes_wrong_ends_within_200_ms_without_current(
    harm, error, word, tmp_path
):
    with Setup(tape=tmp_path / "tape") as setup:
        setup.world.start()
        done = setup.after(0.2, lambda: harm(setup))
        with pytest.raises(error, match=word):
            setup.world.execute(FREE)
        assert setup.robot.now() - done[0] < 0.2
        if harm is not close_a_bus:  # that board hears nothing, its time-out must do
            assert setup.left_in_peace()
    # all data so far are on disk, and say that it ended early
    recording = Recording(tmp_path / "tape")
    for streams in recording.fingers():
        for stream in (*streams.boards, streams.touch):
            assert stream.time[-1] > done[0] - 0.02
            assert stream.time[0] < done[0] - 0.2


def test_a_board_that_hears_nothing_any_more_switches_itself_off():
    with Setup() as setup:
        setup.world.start()
        setup.after(0.2, lambda: close_a_bus(setup))
        with pytest.raises(BusError):
            setup.world.execute(FREE)
        setup.robot.sleep(0.12)
        assert not setup.robot.fingers[0].boards[0].current.any()


@pytest.mark.slow
def test_a_camera_that_freezes_ends_it_within_200_ms(tmp_path):
    with Setup("densetact", tape=tmp_path / "tape") as setup:
        setup.world.start()

        def freeze():
            setup.robot.fingers[1].skin.frozen = True

        done = setup.after(0.2, freeze)
        with pytest.raises(StaleStreamError, match="finger 1, tactile: no touch"):
            setup.world.execute(FREE)
        assert setup.robot.now() - done[0] < 0.2
        assert setup.left_in_peace()
    pictures = list(Recording(tmp_path / "tape").pictures("finger_1_tactile"))
    assert len(pictures) > 12
    assert pictures[-1][0] == pytest.approx(done[0], abs=0.035)


def test_a_terminal_that_is_pulled_out_ends_it_within_200_ms(tmp_path, terminal):
    rig = simulated_rig("optoforce", f"world {next(numbers)}")
    second = Terminal()
    ends = terminal, second
    wired = [
        replace(one, tactile=replace(one.tactile, source=end.name))
        for one, end in zip(rig.fingers, ends, strict=True)
    ]
    rig = replace(rig, fingers=tuple(wired))
    with Setup(rig=rig, tape=tmp_path / "tape") as setup:
        readers = [one.skin.reader for one in setup.bench.fingers]
        for reader in readers:
            wait_for(lambda reader=reader: reader.opened)
        for one, end, reader in zip(setup.robot.fingers, ends, readers, strict=True):

            def write(packet, end=end, reader=reader):
                if end.master is not None:  # simulated time waits for the real wire
                    count = reader.framer.good + 1
                    end.write(packet)
                    wait_for(lambda: reader.framer.good >= count)

            one.skin.write = write
        setup.world.start()
        done = setup.after(0.2, second.unplug)
        with pytest.raises(StaleStreamError, match="finger 1, tactile"):
            setup.world.execute(FREE)
        assert setup.robot.now() - done[0] < 0.2
        assert setup.left_in_peace()
    chunks = list(Recording(tmp_path / "tape").chunks("finger_1_tactile"))
    assert chunks[-1][0] > done[0] - 0.03


class Adapter:
    """An slcan adapter, between a terminal and the virtual bus of a board."""

    def __init__(self, terminal, config):
        self.terminal, self.bus, self.rest = terminal, can.Bus(**config), b""

    def carry(self, port):
        """Carry what waits both ways; simulated time waits for the real wire."""
        if self.terminal.master is None:
            return
        *lines, self.rest = (self.rest + self.terminal.read()).split(b"\r")
        for one in lines:
            if one.startswith(b"t"):  # others open the channel
                data = bytes.fromhex(one[5:].decode())
                message = can.Message(
                    arbitration_id=int(one[1:4], 16), data=data, is_extended_id=False
                )
                self.bus.send(message)
        while (message := self.bus.recv(timeout=0)) is not None:
            self.terminal.write(line(message))
            wait_for(lambda: port.in_waiting)


def test_a_can_adapter_that_is_pulled_out_ends_it_within_200_ms(tmp_path, terminal):
    setup = Setup(tape=tmp_path / "tape")
    first, second = setup.rig.fingers
    adapter = Adapter(terminal, second.boards[0])
    wired = replace(second, boards=(slcan(terminal), second.boards[1]))
    setup.bench.rig = replace(setup.rig, fingers=(first, wired))
    with adapter.bus, setup:
        port = setup.bench.fingers[1].boards[0].bus.serialPortOrig

        setup.robot.after = lambda now: adapter.carry(port)
        setup.world.start()
        due = setup.robot.now() + 0.2

        def look(now):
            adapter.carry(port)
            if now >= due and terminal.master is not None:
                terminal.unplug()

        setup.robot.after = look
        with pytest.raises(BusError, match="finger 1, board 0: cannot"):
            setup.world.execute(FREE)
        assert setup.robot.now() - due < 0.2
        setup.robot.sleep(0.12)  # the board behind it hears nothing: its time-out
        boards = setup.boards
        assert not any(board.current.any() for board in boards)
        for board in boards[:2] + boards[3:]:
            assert not board.reference.any()
    recording = Recording(tmp_path / "tape")
    assert len(list(recording.messages("finger_1_board_0"))) > 100
    assert recording.fingers()[0].touch.time[-1] > due - 0.02


def test_a_joint_that_runs_away_is_stopped():
    with Setup() as setup:
        setup.world.limits = Limits(top_speed=0.05)
        with pytest.raises(LimitError, match="runs away"):
            setup.world.execute(FREE)
        assert setup.left_in_peace()


def test_an_action_that_misses_too_much_is_refused():
    with Setup() as setup:
        setup.world.complete = 1.01
        with pytest.raises(CompletenessError, match="valid"):
            setup.world.execute(FREE)
        assert setup.left_in_peace()
