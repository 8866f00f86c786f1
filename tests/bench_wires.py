"""What the wires of a finger give while an action is measured."""

from dataclasses import replace

import numpy as np
from scipy.interpolate import PchipInterpolator

from hardware.assemble import assemble
from hardware.kinematics import finger
from hardware.motor_board import MotorBoard
from hardware.motor_can import Pair, Quantity, encode
from hardware.motor_joints import JointMap
from hardware.streams import FingerStreams, Stream, touch_stream
from hardware.touch import Touch
from tactilenlp.data.measurements import Measurements

NOON = 1.7e9  # [s], a time of day
JOINTS = JointMap(zero=(0.02, -0.4, 1.1))
NAMES = "finger 0", "finger 1"


def slcan(terminal):
    """Return the configuration of python-can for an adapter on a terminal."""
    config = {"interface": "slcan", "channel": terminal.name}
    return config | {"bitrate": 1_000_000, "sleep_after_open": 0}


def line(message):
    """Write a frame as an slcan adapter does."""
    data = bytes(message.data)
    return f"t{message.arbitration_id:03X}{len(data)}{data.hex().upper()}\r".encode()


def on_the_wire(stamps, angles, keep=None):
    """Send joint angles (n, 3) [rad] as frames of two boards, and read them back."""
    boards = [MotorBoard({}, name=f"board {k}") for k in range(2)]
    turns = JOINTS.revolutions(angles)
    for k, board in enumerate(boards):
        for n, stamp in enumerate(stamps):
            if keep is None or keep[n, k]:
                pair = Pair(Quantity.POSITION, tuple(turns[n, k].tolist()))
                board.on_message_received(encode(pair, float(stamp)))
    return tuple(
        Stream.sorted(board.name, *board.series(Quantity.POSITION)) for board in boards
    )


def streams(data, k, rng=None, dropped=0.0, jitter=0.0, latency=0.0):
    """Return what the wires of finger k give while one action is measured.

    Encoders at 1 kHz, touches at the samples of the data; `dropped` [1] of all frames,
    stamps late by up to `jitter` [s].
    """
    geometry = replace(finger("edu_dair", (180, 0)[k]), tip_radius=0.01)
    path = PchipInterpolator(data.time, data.finger_position[:, k])
    # encoders start before the first touch and end after the last
    dense = np.arange(-5, 1000 * (data.time[-1] - data.time[0]) + 6) / 1000
    inside = np.clip(dense, 0, data.time[-1] - data.time[0]) + data.time[0]
    angles = geometry.inverse(path(inside))
    keep, late = None, 0.0
    if rng is not None:
        keep = rng.random((len(dense), 2)) >= dropped
        late = rng.uniform(0, jitter, len(data.time))
    touches, R_wt = [], geometry.rotation(geometry.inverse(data.finger_position[:, k]))
    stamps = NOON + data.time + latency + late
    for n, stamp in enumerate(stamps.tolist()):
        if rng is None or rng.random() >= dropped:
            normal = R_wt[n].T @ data.normal[n, k]
            felt = bool(data.contact[n, k]), normal, 1.0, bool(data.valid[n, k])
            touches.append(Touch(stamp, *felt))
    boards = on_the_wire(NOON + data.time[0] + dense, angles, keep)
    touch = touch_stream(f"{NAMES[k]}, tactile", touches)
    return FingerStreams(NAMES[k], geometry, JOINTS, boards, touch, latency)


def again(data):
    """Send whole data over the wires, action by action, and assemble them."""
    parts = []
    for action in np.unique(data.action):
        one = data.select([action])
        fingers = [streams(one, k) for k in range(2)]
        parked = [NAMES[k] for k in range(2) if not one.valid[:, k].any()]
        options = {"action": int(action), "parked": parked}
        parts.append(assemble(fingers, origin=NOON, **options))
    whole = parts[0]
    for part in parts[1:]:
        whole = whole.append(part)
    return whole


def straight(T=31, touching=slice(10, 20)):
    """One action of two fingers that meet in the middle and touch for a while."""
    s = np.linspace(0, 1, T)[:, None]
    p = np.stack([[0.1, 0.01, 0.06] - s * [0.07, 0, 0.01]] * 2, axis=1)
    p[:, 1, 0] *= -1
    contact = np.zeros((T, 2), bool)
    contact[touching] = True
    normal = np.zeros((T, 2, 3))
    normal[touching] = [[0.8, 0.0, 0.6], [-1.0, 0.0, 0.0]]
    return Measurements(
        time=np.arange(T) / 30,
        finger_position=p,
        finger_radius=0.01,
        contact=contact,
        normal=normal,
        action=np.zeros(T, int),
    )
