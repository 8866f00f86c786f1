"""A motor board and its simulated other end on one bus."""

import itertools
import time

import numpy as np
from bench import ManualClock

from hardware.motor_board import MotorBoard
from hardware.motor_can import (
    Fault,
    Quantity,
    Status,
    encode,
)
from hardware.simulated_board import SimulatedBoard

channels = itertools.count()
MEASURED = {
    Quantity.POSITION: np.array([1.25, -2.5]),
    Quantity.VELOCITY: np.zeros(2),
}


class Wired:
    """A board and its simulated other end on one virtual bus, on one manual clock."""

    def __init__(self, **options):
        channel = f"board {next(channels)}"
        config = {"interface": "virtual", "channel": channel}
        config["preserve_timestamps"] = True
        self.clock = ManualClock(tick=self.tick)
        self.firmware = SimulatedBoard(config)
        self.board = MotorBoard(config, name="board 0", clock=self.clock, **options)

    def tick(self, now):
        self.firmware.listen(now)
        self.firmware.talk(MEASURED, now)

    def __enter__(self):
        self.firmware.__enter__()
        self.board.__enter__()
        return self

    def __exit__(self, *exception):
        self.board.__exit__(*exception)
        self.firmware.listen(self.clock.now())
        self.firmware.__exit__(*exception)


def driven():
    return Wired(listen_only=False)


def status(fault=Fault.NONE):
    return encode(Status(True, (True, True), (True, True), fault), time.time())
