"""What the tests of the bench share: captures, pseudo-terminals, how much to fuzz."""

import os
import time
import tty
from pathlib import Path

import numpy as np
import pytest

from hardware.errors import HardwareError
from hardware.serial_tactile import ForceFrame
from tactilenlp.errors import TactileError

CAPTURES = Path(__file__).resolve().parents[2] / "shared" / "captures"
# The full run is TACTILENLP_FUZZ=1000000; a tenth of a second per test otherwise.
FUZZ = int(os.environ.get("TACTILENLP_FUZZ", "10000"))


def capture(name):
    """Return the path of a real capture; skips where it is absent."""
    path = CAPTURES / name
    if not path.is_file():
        pytest.skip(f"no real capture beside this checkout ({path})")
    return path


class Terminal:
    """A pseudo-terminal: `name` for who opens a port, the other end is ours."""

    def __init__(self):
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        self.name = os.ttyname(self._slave)

    def write(self, data):
        while data:
            try:
                data = data[os.write(self.master, data) :]
            except BlockingIOError:
                continue

    def read(self):
        try:
            return os.read(self.master, 65536)
        except BlockingIOError:
            return b""

    def read_until(self, words):
        """Return what has come once `words` are in it: the kernel hands on parts."""
        got = bytearray()

        def came():
            got.extend(self.read())
            return words in got

        wait_for(came)
        return bytes(got)

    def unplug(self):
        """Close both ends, as an adapter that is pulled out."""
        for end in (self.master, self._slave):
            if end is not None:
                os.close(end)
        self.master = self._slave = None


@pytest.fixture
def terminal():
    """A pseudo-terminal that is closed afterwards."""
    terminal = Terminal()
    yield terminal
    terminal.unplug()


def refused(check, since, seconds=10.0):
    """Check until it refuses; return the error, and when it passed last.

    Seconds count from `since` (monotonic) to the beginning of a check: a computer that
    is busy with something else makes checks late, not wrong.
    """
    passed = 0.0
    while (began := time.monotonic() - since) < seconds:
        try:
            check()
        except TactileError as bad:
            return bad, passed
        passed = began
        time.sleep(0.001)
    raise AssertionError("it never refused")


class ManualClock:
    """A clock that moves when told to, and calls `tick` while it does."""

    def __init__(self, now=1.7e9, tick=None):
        self.time, self.tick, self.step = now, tick, 1e-3

    def now(self):
        return self.time

    wall = now

    def sleep(self, duration):
        for _ in range(max(round(duration / self.step), 1)):
            self.time += self.step
            if self.tick is not None:
                self.tick(self.time)


def wait_for(condition, seconds=60.0):
    """Wait until something is so; fails where it never is."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.002)


def complaint(device):
    """What is wrong with a device, "" if nothing is."""
    try:
        device.check()
    except HardwareError as bad:
        return str(bad)
    return ""


def forces(n, seed=0):
    """Return n successive frames of an OptoForce sensor."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(-3000, 3000, (n, 3)).tolist()
    return [ForceFrame((65500 + k) % 65536, 0, tuple(c)) for k, c in enumerate(counts)]
