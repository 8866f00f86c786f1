"""The description of a robot: it survives its file, and says what it may hold."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from hardware.errors import RigError
from hardware.rig import Rig, Tactile
from hardware.serial_tactile import (
    AnySkinFramer,
    encode_configuration,
    encode_field,
)
from hardware.simulated_robot import simulated_rig


def test_a_rig_survives_its_file(tmp_path):
    for kind in ("densetact", "optoforce", "optoforce_can"):
        rig = simulated_rig(kind)
        rig.save(tmp_path / "rig.json")
        assert Rig.load(tmp_path / "rig.json") == rig


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"fingers": []}, "no fingers"),
        ({"finger": []}, "no such argument.*did you mean 'fingers'"),
        ({"fingers": [{"name": "a"}]}, "missing.*degrees"),
        ({"fingers": [{"nom": "a"}]}, "no such argument.*got nom; give 'name'"),
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


@pytest.mark.parametrize("change", [{1: 2}, {"fingers": [{1: 2}]}])
def test_keys_of_a_rig_are_words(change):
    with pytest.raises(RigError, match="wrong type"):
        Rig.from_dict(change)
    for name in ("can", "touch", "camera"):
        with pytest.raises(RigError, match=rf"tactile\.{name}: wrong type"):
            Tactile("anyskin", **{name: {1: 2}})


def test_a_magnetic_skin_is_a_rig_too():
    tactile = Tactile("anyskin", source="/dev/ttyACM0", touch={"on": 80.0, "off": 50.0})
    reader = tactile.reader("skin", None, None)
    assert isinstance(reader.framer, AnySkinFramer)
    assert reader.baudrate == 115_200
    rest = SimpleNamespace(temperature=np.zeros(5), field=np.zeros((5, 3)))
    assert len(encode_field(rest)) == 82
    assert tactile.toucher().decide.on == 80.0


@pytest.mark.parametrize("kind", ["optoforce", "optoforce_can"])
def test_a_rate_that_an_optoforce_does_not_have_is_refused(kind):
    with pytest.raises(RigError, match=r"tactile\.speed: no such rate.*333"):
        Tactile(kind, speed=500)
    for speed in (10, 30, 100, 333, 1000):
        Tactile(kind, speed=speed)
    Tactile("anyskin", speed=500)  # which has one rate only


def test_a_rate_may_be_a_number_of_numpy(tmp_path):
    one = simulated_rig("optoforce_can").fingers[0]
    rate = np.int64(333)
    rig = Rig((replace(one, tactile=replace(one.tactile, speed=rate)),))
    rig.save(tmp_path / "rig.json")
    assert Rig.load(tmp_path / "rig.json").fingers[0].tactile.speed == 333
    assert encode_configuration(rate) == encode_configuration(333)


def test_names_that_would_share_a_file_are_refused():
    rig = simulated_rig("optoforce")
    for names in (("finger 0", "finger_0"), ("a", ""), ("a", "a")):
        fingers = [
            replace(one, name=name)
            for one, name in zip(rig.fingers, names, strict=True)
        ]
        with pytest.raises(RigError, match="two of one name"):
            Rig(tuple(fingers))


def test_two_boards_on_one_bus_are_refused():
    first, second = simulated_rig("optoforce_can").fingers
    bus = {"interface": "socketcan", "channel": "can0", "bitrate": 1_000_000}
    slow, other = bus | {"bitrate": 500_000}, bus | {"channel": "can1"}
    for pair in ((bus, bus), (bus, slow)):
        with pytest.raises(RigError, match="finger 0, board 0 and finger 0, board 1"):
            Rig((replace(first, boards=pair),))
    fingers = [replace(one, boards=(bus, other)) for one in (first, second)]
    with pytest.raises(RigError, match="finger 0, board 0 and finger 1, board 0"):
        Rig(tuple(fingers))
    adapters = [{"interface": "vector", "channel": 0, "serial": k} for k in (7, 8)]
    Rig((replace(first, boards=tuple(adapters)),))


@pytest.mark.parametrize(
    "sensors",
    [
        [Tactile("optoforce", source="/dev/ttyACM0")] * 2,
        [Tactile(kind, source="/dev/ttyACM0") for kind in ("anyskin", "reskin")],
        [
            Tactile("densetact", source=0, touch={}),
            Tactile("densetact", source="/dev/video0", touch={}),
        ],
        [Tactile("optoforce_can", can={"interface": "socketcan", "channel": "can4"})]
        * 2,
    ],
)
def test_two_sensors_on_one_port_are_refused(sensors):
    fingers = [
        replace(one, tactile=tactile)
        for one, tactile in zip(
            simulated_rig("optoforce_can").fingers, sensors, strict=True
        )
    ]
    with pytest.raises(RigError, match="finger 0, tactile and finger 1, tactile"):
        Rig(tuple(fingers))


def test_an_optoforce_may_be_on_the_bus_of_a_board():
    one = simulated_rig("optoforce_can").fingers[0]
    Rig((replace(one, tactile=replace(one.tactile, can=one.boards[0])),))
