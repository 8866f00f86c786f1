"""Describe a robot: the place, wires and sensor of each finger.

A rig is a JSON file, written by hand (README.md has an example) and kept in recordings.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass, field, replace

from tactilenlp.common.validation import (
    check_kind,
    check_one_of,
    check_range,
    check_whole,
)
from tactilenlp.common.whole_file import open_file, write_whole
from tactilenlp.errors import typed_call

from .clock import Clock
from .errors import FrameError, RigError, translated
from .frames import Camera, check_camera
from .kinematics import Finger, finger
from .motor_joints import JointMap
from .serial_reader import OptoForceCan, SerialTactile
from .serial_tactile import (
    SPEEDS,
    AnySkinFramer,
    OptoForceFramer,
    encode_configuration,
)
from .touch import FieldTouch, ForceTouch, Toucher
from .wires import check_wires

SERIAL, ON_CAN, CAMERA = "serial", "can", "camera"  # what a sensor is read through
DEEPEST = 20  # [levels] of lists and objects in a rig
FASTEST_SENSOR = 100_000  # [Hz]
KINDS = {
    "optoforce": SERIAL,
    "optoforce_can": ON_CAN,
    "anyskin": SERIAL,
    "reskin": SERIAL,
    "densetact": CAMERA,
}


@typed_call(RigError)
@dataclass(frozen=True)
class Tactile:
    """Describe the sensor of a finger.

    kind:    optoforce, optoforce_can, anyskin, reskin or densetact
    source:  port of a serial sensor, number or path of a camera
    can:     of python-can, for optoforce_can
    touch:   options of ForceTouch, FieldTouch or OpticalTouch; `lens` of a densetact
             is {"centre": [u, v], "edge": px, ...}
    camera:  options of Camera: size, rate, exposure
    speed:   [Hz] of an OptoForce: on a serial line it is told to send at it, on CAN it
             is only listened to, and must have been told
    latency: [s] from touch to time stamp, subtracted later
    """

    kind: str
    source: str | int = ""
    can: dict = field(default_factory=dict)
    touch: dict = field(default_factory=dict)
    camera: dict = field(default_factory=dict)
    speed: int = 1000
    latency: float = 0.0

    def __post_init__(self) -> None:
        check_one_of("tactile.kind", self.kind, KINDS, "no such sensor", RigError)
        check_kind("tactile.source", self.source, (str, int), RigError)
        for name in ("can", "touch", "camera"):
            check_kind(f"tactile.{name}", getattr(self, name), dict, RigError)
        check_whole("tactile.speed", self.speed, 1, FASTEST_SENSOR, RigError)
        object.__setattr__(self, "speed", int(self.speed))  # JSON has no NumPy
        if self.kind.startswith("optoforce"):
            rates, told = sorted(SPEEDS.keys() - {0}), ("no such rate", RigError, "Hz")
            check_one_of("tactile.speed", self.speed, rates, *told)
        check_camera("tactile.camera", self.camera)
        check_range("tactile.latency", self.latency, 0.0, 1.0, "s", RigError)

    @property
    def wire(self) -> str:
        """What the sensor is read through: serial, can or camera."""
        return KINDS[self.kind]

    @property
    def interval(self) -> float | None:
        """The time [s] between samples that the sensor was told; None: it is not."""
        if self.kind.startswith("optoforce"):
            return SPEEDS[self.speed] * 1e-3
        return 1 / rate if (rate := self.camera.get("rate")) else None

    def toucher(self) -> Toucher:
        """Return the function from frames of the sensor to touches; raises RigError."""
        options = dict(self.touch)
        make = {"anyskin": FieldTouch, "reskin": FieldTouch}.get(self.kind, ForceTouch)
        try:
            if self.wire == CAMERA:
                from .optical import Lens, OpticalTouch  # an extra

                lens = options.pop("lens")
                if "radius" in lens:
                    raise RigError(
                        "a lens has no radius", where="tactile.touch.lens",
                        got=lens["radius"],
                        next="remove it: that of the dome is the tip_radius",
                    )  # fmt: skip
                return OpticalTouch(Lens(**lens), **options)
            return make(**options)
        except (TypeError, KeyError, FrameError) as bad:
            raise RigError(
                "wrong options", where="tactile.touch", got=bad,
                next="name those of the sensor: see hardware/README.md",
            ) from bad  # fmt: skip

    def framer(self) -> OptoForceFramer | AnySkinFramer:
        """Return the framer of a serial sensor."""
        return OptoForceFramer() if self.kind == "optoforce" else AnySkinFramer()

    def reader(self, name: str, sink, clock: Clock) -> SerialTactile | Camera:
        """Return the driver, not opened."""
        options = {"name": name, "sink": sink, "clock": clock}
        if self.wire == ON_CAN:
            return OptoForceCan(self.can, **options)
        if self.wire == CAMERA:
            return Camera(self.source, **self.camera, **options)
        if self.kind == "optoforce":
            options["configure"] = encode_configuration(self.speed)
        return SerialTactile(str(self.source), self.framer(), **options)


@typed_call(RigError)
@dataclass(frozen=True)
class FingerRig:
    """Describe the kinematics, wires and sensor of one finger.

    name:    for messages and files
    degrees: angle of the finger on the robot
    boards:  two configurations of python-can, one bus each
    zero:    (3,) [rad], found by homing
    motors:  (board, motor) of each joint
    tip_radius: [m], None: that of the robot
    """

    name: str
    degrees: float
    boards: tuple[dict, dict]
    tactile: Tactile
    robot: str = "edu_dair"
    zero: tuple[float, float, float] = (0.0, 0.0, 0.0)
    motors: tuple = JointMap.motors
    tip_radius: float | None = None

    def __post_init__(self) -> None:
        check_kind("finger.name", self.name, str, RigError)
        check_kind(f"{self.name}, tactile", self.tactile, Tactile, RigError)
        check_kind(f"{self.name}, boards", self.boards, (tuple, list), RigError)
        for k, board in enumerate(self.boards):
            check_kind(f"{self.name}, boards[{k}]", board, dict, RigError)
        if len(self.boards) != 2:
            raise RigError(
                "a finger has two boards",
                where=self.name,
                got=len(self.boards),
                next="three motors, two on a board; one CAN bus for each board",
            )
        self.joints, self.geometry  # noqa: B018 (they check)

    @property
    def geometry(self) -> Finger:
        """The kinematics of the finger."""
        made, radius = finger(self.robot, self.degrees), self.tip_radius
        return made if radius is None else replace(made, tip_radius=radius)

    @property
    def joints(self) -> JointMap:
        """The map from motors to joints."""
        return JointMap(self.motors, self.zero)


@typed_call(RigError)
@dataclass(frozen=True)
class Rig:
    """Describe the fingers of a robot; each board and sensor has a wire of its own."""

    fingers: tuple[FingerRig, ...]

    def __post_init__(self) -> None:
        check_kind("rig.fingers", self.fingers, (tuple, list), RigError)
        for one in self.fingers:
            check_kind("rig.fingers", one, FingerRig, RigError)
        names = [finger.name for finger in self.fingers]
        files = {stream_name(name, "") for name in names}
        if not names or len(files) < len(names) or not all(names):
            expected = "names that differ in letters or digits"
            told = {"where": "rig", "got": names, "expected": expected}
            raise RigError("no fingers, or two of one name", **told)
        check_wires(self.fingers)

    @classmethod
    def load(cls, path: str | os.PathLike) -> Rig:
        """Read a JSON file; raises RigError if it is not a rig."""
        others = ValueError, OSError, RecursionError
        no_rig = translated(
            RigError, "no rig", path, "README.md of hardware has one", others
        )
        with no_rig, open_file(path, RigError) as stream:
            return cls.from_dict(json.load(stream))

    def save(self, path: str | os.PathLike) -> None:
        """Write a JSON file that loads to an equal rig."""
        write_whole(path, json.dumps(asdict(self), indent=2) + "\n")

    @classmethod
    def from_dict(cls, content: dict) -> Rig:
        """Return a rig from plain lists and dictionaries; raises RigError."""
        given, fingers = _frozen(content), []
        check_kind("rig", given, dict, RigError)
        check_kind("rig.fingers", given.get("fingers", ()), (tuple, list), RigError)
        for one in given.get("fingers", ()):
            check_kind("finger", one, dict, RigError)
            tactile = one.get("tactile")
            made = Tactile(**tactile) if isinstance(tactile, dict) else tactile
            fingers.append(FingerRig(**one | {"tactile": made}))
        return cls(**given | {"fingers": tuple(fingers)})


def _frozen(value: object, depth: int = 0) -> object:
    """Return lists as tuples, at any depth to DEEPEST: JSON has no tuples."""
    if depth > DEEPEST:
        raise RigError("nested too deeply", where="rig", expected=f"{DEEPEST} levels")
    if isinstance(value, dict):
        return {key: _frozen(item, depth + 1) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return tuple(_frozen(item, depth + 1) for item in value)
    return value


def stream_name(finger: str, part: str) -> str:
    """Return the name of a stream as it is used for files: "finger_0_board_1"."""
    return "".join(c if c.isalnum() else "_" for c in f"{finger} {part}")
