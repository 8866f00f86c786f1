"""Refuse a rig in which two devices share one wire.

Boards have no address: two on one bus would both follow every command, and the
positions of one would be taken for those of the other.  An OptoForce has identifiers of
its own, and may be on the bus of a board.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from .errors import RigError

if TYPE_CHECKING:
    from .rig import FingerRig, Tactile

# Which keys of a configuration of python-can tell one bus from another: two adapters of
# one kind may have equal channels, and differ in a serial number.
IDENTITY = (
    *("interface", "channel", "config_context", "port", "serial", "index", "device"),
    *("device_id", "unique_hardware_id", "bus", "address"),
)


def check_wires(fingers: Iterable[FingerRig]) -> None:
    """Raise RigError where two boards, or two sensors, are on one wire."""
    boards, sensors = {}, {}
    for one in fingers:
        for k, config in enumerate(one.boards):
            _take(boards, _bus(config), f"{one.name}, board {k}")
        if wire := _sensor(one.tactile):
            _take(sensors, wire, f"{one.name}, tactile")


def _take(taken: dict, wire: tuple, name: str) -> None:
    """Note the device on a wire; raises RigError where there is another one."""
    if (other := taken.setdefault(wire, name)) != name:
        raise RigError(
            "two devices on one wire",
            where="rig",
            got=f"{other} and {name} on {dict(wire)}",
            expected="a CAN bus for each board, a port for each sensor",
            next="correct interface, channel or source of one of them",
        )


def _bus(config: Mapping) -> tuple:
    """Return what tells the bus of a configuration from another one."""
    return tuple((key, str(config[key])) for key in IDENTITY if key in config)


def _sensor(tactile: Tactile) -> tuple:
    """Return what tells the wire of a sensor from another one, () if it has none."""
    if tactile.can and tactile.wire == "can":
        return _bus(tactile.can)
    source = tactile.source
    if isinstance(source, int):  # the number of a camera on Linux
        source = f"/dev/video{source}"
    return (("source", source),) if source and tactile.wire != "can" else ()
