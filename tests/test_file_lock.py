"""One process at a time explores or studies into a file."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from test_study import squared, study  # noqa: F401

from tactilenlp import explore
from tactilenlp.common.file_lock import locked
from tactilenlp.errors import FileError

HOLD = """
import os, sys, time
from tactilenlp.common.file_lock import locked
with locked(sys.argv[1]):
    if sys.argv[2] != "fork" or os.fork() == 0:
        print(os.getpid(), flush=True)  # a forked worker speaks once it runs
    time.sleep(60)
"""


class Never:
    """A world that must not be commanded."""

    finger_radius = (0.01, 0.01)

    def execute(self, trajectory):
        pytest.fail("a command before the lock")


def holder(file, how="alone"):
    """Return a process that holds the lock of a file, and the number that it says."""
    path = os.pathsep.join(sys.path)
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(file), how], stdout=subprocess.PIPE,
        env=os.environ | {"PYTHONPATH": path}, text=True,
    )  # fmt: skip
    return process, int(process.stdout.readline())


def kill(process):
    process.send_signal(signal.SIGKILL)
    process.wait(30)
    process.stdout.close()


@pytest.fixture
def file(tmp_path):
    return tmp_path / "kept.npz"


def test_a_second_process_is_refused_until_the_first_one_dies(study, file):  # noqa: F811
    process, number = holder(file)
    try:
        with pytest.raises(FileError, match="another process") as refused:
            next(explore(Never(), file=file))
        assert f"process {number}" in str(refused.value)
        with pytest.raises(FileError, match=f"process {number}"):
            study.run_study(file, "squares", squared, [(2, "a")])
        assert not file.exists()
    finally:
        kill(process)
    assert Path(f"{file}.lock").exists()  # kill -9 leaves it, which locks nothing
    assert study.run_study(file, "squares", squared, [(2, "a")])
    assert not Path(f"{file}.lock").exists()


def test_a_forked_worker_that_outlives_its_parent_holds_no_lock(file):
    process, worker = holder(file, "fork")
    try:
        with pytest.raises(FileError, match=f"process {process.pid}"), locked(file):
            pass
        kill(process)
        os.kill(worker, 0)  # it still runs
        with locked(file):
            pass
    finally:
        os.kill(worker, signal.SIGKILL)


def test_one_process_holds_a_lock_once_by_whatever_name(file, tmp_path):
    file.touch()
    (tmp_path / "link.npz").symlink_to(file)
    with (
        locked(file),
        pytest.raises(FileError, match="in use by this process"),
        locked(tmp_path / "link.npz"),
    ):
        pass
    with locked(tmp_path / "link.npz"):
        assert Path(f"{file}.lock").read_text() == str(os.getpid())


def test_an_error_in_the_block_ends_the_lock(file):
    with pytest.raises(KeyError), locked(file):
        raise KeyError
    with locked(file):
        pass


@pytest.mark.parametrize("make", [os.mkdir, os.mkfifo])
def test_what_cannot_be_locked_is_refused(file, make):
    make(f"{file}.lock")
    with pytest.raises(FileError, match="cannot be locked"), locked(file):
        pass


def test_an_exploration_that_is_left_ends_its_lock(file):
    steps = explore(Never(), file=file)
    with pytest.raises(BaseException, match="a command"):
        next(steps)
    with locked(file):
        pass
