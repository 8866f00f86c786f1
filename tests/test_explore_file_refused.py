"""A file, a folder or fingers that cannot be used are refused before a finger moves."""

import shutil
from collections import namedtuple

import numpy as np
import pytest
from test_explore_refused import Moved, Robot, kept

from tactilenlp import Scene, Workspace, explore
from tactilenlp.errors import FileError, OptionError, StartError

__all__ = ["kept"]  # a fixture
Usage = namedtuple("Usage", "total used free")
CENTRE = (0.0, 0.0, 0.02)


class Hand(Robot):
    """A robot that tells the radii of its fingertips."""

    def __init__(self, *radii):
        self.finger_radius = np.array(radii)


def begin(robot, **options):
    next(explore(robot, Scene(), 1, "random", centre=CENTRE, **options))


def test_a_file_in_no_folder_is_refused_at_rest(tmp_path):
    with pytest.raises(FileError, match="no such folder"):
        begin(Robot(), file=tmp_path / "nowhere" / "kept.npz")
    with pytest.raises(FileError, match="a folder"):
        begin(Robot(), file=tmp_path)


def test_a_folder_in_which_nothing_can_be_made_is_refused_at_rest():
    with pytest.raises(FileError, match="cannot be written"):
        begin(Robot(), file="/proc/kept.npz")  # not even as root


def test_a_disk_that_is_full_is_refused_at_rest(tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: Usage(1e9, 1e9, 1e6))
    with pytest.raises(FileError, match=r"too little space.*10 MB or more.*1\.0 MB"):
        begin(Robot(), file=tmp_path / "kept.npz")


def test_what_is_no_exploration_is_refused_at_rest(tmp_path):
    np.savez(tmp_path / "other.npz", time=np.arange(3))
    with pytest.raises(FileError, match="not an exploration"):
        begin(Robot(), file=tmp_path / "other.npz")


def test_another_number_of_fingers_is_refused_at_rest():
    for radii in ([0.01], [0.01] * 3):
        with pytest.raises(OptionError, match="another number of fingers"):
            begin(Hand(*radii), workspace=Workspace())


def test_a_file_of_other_fingers_is_refused_at_rest(kept, touched):
    given = kept | {"actions": 1, "policy": "random"}
    radius = touched.measurements.finger_radius
    with pytest.raises(StartError, match="other fingers"):
        list(explore(Hand(*(radius + 0.001)), workspace=Workspace(), **given))
    with pytest.raises(Moved):
        list(explore(Hand(*radius), workspace=Workspace(), **given))


def test_a_file_that_can_be_written_is_not_held_up(tmp_path):
    with pytest.raises(Moved):
        begin(Hand(0.01, 0.01), file=tmp_path / "kept.npz")
    assert list(tmp_path.iterdir()) == []
