"""hardware/README.md does what it says: every block runs, every name is there."""

import importlib
import json
import re
import shlex
from pathlib import Path

import pytest

pytest.importorskip("cv2", reason='needs the extra: pip install "tactilenlp[optical]"')

from hardware.__main__ import main
from hardware.errors import HardwareError
from hardware.rig import Rig
from tactilenlp.data.measurements import Measurements
from tactilenlp.errors import TactileError

README = Path(__file__).resolve().parents[1] / "hardware" / "README.md"
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", README.read_text(), re.S)


@pytest.mark.slow
def test_every_block_runs_in_its_order(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names = {}
    for language, block in BLOCKS:
        if language == "python":
            exec(compile(block, str(README), "exec"), names)
        elif language == "json":
            assert Rig.from_dict(json.loads(block)).fingers[0].tactile.latency == 0.033
        else:
            for line in block.splitlines():
                words = shlex.split(line)
                assert words[:3] == ["python", "-m", "hardware"]
                assert main(words[3:]) == 0, capsys.readouterr().err
    assert {language for language, _ in BLOCKS} == {"python", "json", "sh"}
    check_what_it_made(names, tmp_path)


def check_what_it_made(names, folder):
    data = names["data"]
    assert data.contact[:, 0].any()
    assert not data.valid[:, 1].any()
    assert Measurements.load(folder / "touches.npz").fingers == 2
    assert names["framer"].good == 1
    assert names["touch"].contact
    assert names["poses"].valid.all()


def test_every_module_is_in_the_table():
    table = set(re.findall(r"`(\w+)`", README.read_text().split("\n## ")[0]))
    files = {path.stem for path in README.parent.glob("*.py")}
    here = files - {"__init__", "__main__", "errors", "can_bus"}
    assert here <= table


def test_every_error_is_one_of_the_package():
    errors = vars(importlib.import_module("hardware.errors"))
    mine = [e for e in errors.values() if isinstance(e, type) and e is not TactileError]
    assert len(mine) > 8
    assert all(issubclass(error, HardwareError) for error in mine)
    assert issubclass(HardwareError, TactileError)
