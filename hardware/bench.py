"""Open all wires of a rig, read them, and stop all motors when they are closed."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import ExitStack
from functools import partial

import numpy as np

from .can_bus import POLL_LIMIT
from .clock import Clock, HostClock
from .errors import HardwareError, StaleStreamError
from .motor_board import MAX_CURRENT, STALE, STATUS_STALE, MotorBoard
from .motor_can import Quantity
from .motor_checks import check_current
from .motor_joints import POLL, start_motors
from .motor_stop import stop_boards
from .rig import SERIAL, FingerRig, Rig, Tactile, stream_name
from .streams import FingerStreams
from .tape import Tape
from .touch import NoTouch, Skin

LEARN = 10.0  # [s], longest time in which the sensors find their zero
SOON = 0.002  # [s], two frames of a board
TOUCH_STALE = 0.12  # [s], between three and four pictures at 30 Hz


class FingerBench:
    """Hold the drivers of one finger: two boards and a skin."""

    def __init__(
        self, rig: FingerRig, boards: Iterable[MotorBoard], skin: Skin
    ) -> None:
        self.rig, self.boards, self.skin = rig, tuple(boards), skin
        self.geometry, self.joints = rig.geometry, rig.joints

    @property
    def angles(self) -> np.ndarray:
        """The newest joint angles (3,) [rad]."""
        return self.joints.angles(self._newest(Quantity.POSITION))

    @property
    def velocities(self) -> np.ndarray:
        """The newest joint velocities (3,) [rad/s]."""
        return self.joints.velocities(self._newest(Quantity.VELOCITY))

    @property
    def stamps(self) -> np.ndarray:
        """When the newest positions of both boards were measured (2,) [s]."""
        return np.array([board.stamp(Quantity.POSITION) for board in self.boards])

    @property
    def position(self) -> np.ndarray:
        """The tip (3,) [m] in the world."""
        return self.geometry.forward(self.angles)

    def apply(self, torques: np.ndarray) -> None:
        """Command joint torques (3,) [N m]; raises LimitError before anything is sent.

        All boards of the finger are commanded, or none.
        """
        currents = self.joints.currents(torques).tolist()
        for board, pair in zip(self.boards, currents, strict=True):
            board.check_currents(*pair)
        for board, pair in zip(self.boards, currents, strict=True):
            board.command(*pair)

    def taken(self) -> Callable[[], FingerStreams]:
        """Return a function that makes streams of the samples so far.

        To take them is quick: lists are copied.  To make arrays of them is not, 0.3 s
        for an action of a minute: meanwhile a thread holds the fingers.
        """
        rows = [board.rows(Quantity.POSITION) for board in self.boards]
        touches, broken = list(self.skin.touches), self.skin.broken
        # On a serial line the samples of a chunk have one time.
        told = self.rig.tactile.interval if self.rig.tactile.wire != SERIAL else None
        return partial(
            FingerStreams.of, self.rig, self.boards, rows, touches, broken, told
        )

    def _newest(self, quantity: Quantity) -> np.ndarray:
        return np.stack([board.newest(quantity) for board in self.boards])


class Bench:
    """Open the drivers of a rig; `with` closes them, with zero current first.

    Where no board was started or commanded, nothing is sent at the end.

    rig:         the description of the wires
    tape:        the recording, already opened
    listen_only: never send; otherwise `start` may be called
    clock:       HostClock, or a simulated robot
    reader:      (tactile, name, sink, clock) -> reader of a sensor; a simulated robot
                 has its own
    touches:     False: frames of sensors are recorded only.  No touches are made of
                 them: to evaluate a picture takes longer than buses keep their frames

    Between `remember` and `forget` all samples are kept in memory, otherwise only the
    newest of each stream.  `stops` counts the calls of `stop`.
    """

    def __init__(
        self,
        rig: Rig,
        *,
        tape: Tape | None = None,
        listen_only: bool = True,
        max_current: float = MAX_CURRENT,
        clock: Clock | None = None,
        reader: Callable | None = None,
        touches: bool = True,
    ) -> None:
        check_current(max_current, "Bench")
        self.rig, self.clock = rig, clock or HostClock()
        self.fingers: list[FingerBench] = []
        self.max_current, self.stops = max_current, 0
        self._tape, self._reader = tape, reader or Tactile.reader
        self._touches = touches
        self._drive = {"listen_only": listen_only, "max_current": max_current}
        self._stack = ExitStack()

    @property
    def boards(self) -> list[MotorBoard]:
        """All boards."""
        return [board for finger in self.fingers for board in finger.boards]

    @property
    def _drivers(self) -> list[MotorBoard | Skin]:
        return [one for f in self.fingers for one in (*f.boards, f.skin)]

    def __enter__(self) -> Bench:
        self.fingers = [self._wired(one) for one in self.rig.fingers]
        with ExitStack() as stack:
            for driver in self._drivers:
                stack.enter_context(driver)
            stack.callback(self._left)  # called first: all boards, then all buses
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *exception) -> None:
        self._stack.__exit__(*exception)

    def _left(self) -> None:
        """Stop, but not what another program drives."""
        if any(board.driven for board in self.boards):
            self.stop()
        self.stops += 1  # a world of this bench has ended

    def _wired(self, one: FingerRig) -> FingerBench:
        tape, clock, tactile = self._tape, self.clock, one.tactile
        boards = []
        for k, config in enumerate(one.boards):
            sink = tape and tape.can(stream_name(one.name, f"board {k}"))
            name = f"{one.name}, board {k}"
            options = {"name": name, "sink": sink, "clock": clock}
            options |= self._drive | {"remember": False}
            boards.append(MotorBoard(config, **options))
        sink = tape and tape.sink(tactile.wire, stream_name(one.name, "tactile"))
        reader = self._reader(tactile, f"{one.name}, tactile", sink, clock)
        toucher = tactile.toucher()  # also checks its options
        skin = Skin(reader, toucher if self._touches else NoTouch())
        return FingerBench(one, boards, skin)

    def poll(self) -> None:
        """Read all frames that have arrived."""
        for driver in self._drivers:
            driver.poll()

    def catch_up(self, stops: int) -> None:
        """Read until all boards have sent a position measured from now on.

        What had waited, while nobody read, is older than the state of the fingers.
        Raises the error of a silent board, and HardwareError after a stop since the
        bench had counted so many.
        """
        while any(board.poll() >= POLL_LIMIT for board in self.boards):
            self.check_running(stops)
        begin = self.clock.now()
        while True:
            self.check_running(stops)
            self.poll()
            if all((finger.stamps >= begin).all() for finger in self.fingers):
                break
            if self.clock.now() > begin + STALE:
                self.check()
            self.clock.sleep(SOON)
        self.check()

    def check(self, stale: float = STALE, touch_stale: float = TOUCH_STALE) -> None:
        """Raise the error of any wire: silence for longer [s], or a fault."""
        for board in self.boards:
            board.check(stale)
        self.check_sensors(touch_stale)

    def check_heard(self, patience: float) -> None:
        """Raise the error of a wire that is silent for longer [s], or of a sensor.

        For who only records: faults of boards and error frames do not end that.  A
        board sends one status a second: STATUS_STALE is the least patience for it.
        """
        for board in self.boards:
            board.check_ages(patience, max(patience, STATUS_STALE))
        self.check_sensors(patience)

    def learn_zeros(self) -> None:
        """Find the zero of every sensor anew, before any motor is enabled.

        Of samples that come from now on, as a hand may have touched it before.  A
        camera takes seconds to open, and its zero longer to compute than a board waits
        for the next current.  Raises StaleStreamError after LEARN seconds, and where a
        sensor is silent, or fails, at the end.
        """
        end, stops = self.clock.now() + LEARN, self.stops
        skins = [finger.skin for finger in self.fingers]
        for skin in skins:
            skin.reset()
        while True:
            self.check_running(stops)
            self.poll()
            if all(skin.touches for skin in skins):
                break
            if self.clock.now() > end:
                self.check_sensors()
                raise StaleStreamError(
                    "a sensor finds no zero", where="Bench",
                    got=f"no touch within {LEARN} s",
                    next="check with `python -m hardware record` that it sends",
                )  # fmt: skip
            self.clock.sleep(POLL)
        self.check_sensors()

    def check_sensors(self, stale: float = TOUCH_STALE) -> None:
        """Raise the error of any sensor: silence for longer [s], or a failure."""
        for finger in self.fingers:
            finger.skin.check(stale)

    def start(self, timeout: float) -> None:
        """Enable all motors; a board switches off after a silence [s]."""
        start_motors(self.boards, self.clock, timeout)

    def stop(self) -> None:
        """Command zero current on all boards, then disable them; logs all errors.

        It may be called by a signal handler or in another thread: what runs, ends.
        """
        self.stops += 1
        stop_boards(self.boards)

    def check_running(self, stops: int) -> None:
        """Raise HardwareError if `stop` was called since it had been so many times."""
        if self.stops != stops:
            fix = "start again when it is safe to"
            raise HardwareError("was stopped", where="Bench", next=fix)

    def remember(self) -> None:
        """Keep all samples from now on, for the streams of an action."""
        for driver in self._drivers:
            driver.remember()

    def taken(self) -> list[Callable[[], FingerStreams]]:
        """Return functions that make each finger's streams, and forget the samples."""
        samples = [finger.taken() for finger in self.fingers]
        self.forget()
        return samples

    def forget(self) -> None:
        """Drop all samples but the newest of each stream, and keep only the newest."""
        for driver in self._drivers:
            driver.forget()
