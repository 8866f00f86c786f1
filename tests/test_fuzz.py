"""Hostile input is accepted or refused by a typed error: drawn at random, seeded.

TACTILENLP_FUZZ_SECONDS and TACTILENLP_FUZZ_SEED set how long, and which inputs.
A million inputs: python tests/fuzzing.py --inputs 1000000
"""

import os

import fuzzing
import pytest


@pytest.mark.slow
def test_hostile_input_is_accepted_or_refused_by_a_typed_error(capsys):
    seconds = float(os.environ.get("TACTILENLP_FUZZ_SECONDS", "6"))
    seed = int(os.environ.get("TACTILENLP_FUZZ_SEED", "0"))
    found = fuzzing.fuzz(fuzzing.small_estimates(), seed, 10**9, seconds)
    with capsys.disabled():
        print("\n" + fuzzing.report(found))
    assert not found["failures"]
    drawn = {kind for kind, _ in found["counts"]}
    assert drawn == {*fuzzing.KINDS}


def test_a_bare_error_a_hang_and_a_signal_are_failures(tmp_path, monkeypatch):
    def bare(rng, known):
        raise KeyError("x")

    kinds = dict.fromkeys(fuzzing.KINDS, bare)
    with pytest.raises(KeyError):
        fuzzing.one(kinds, None, 0, 0, None)
    monkeypatch.setattr(fuzzing, "LONGEST", 0.05)
    with fuzzing.interrupting(), pytest.raises(fuzzing.Hang):
        fuzzing.one(dict.fromkeys(kinds, forever), None, 0, 0, None)
    (tmp_path / "at").write_text("7")
    script = tmp_path / "crash"
    script.write_text("#!/bin/sh\nkill -SEGV $$\n")
    script.chmod(0o700)
    monkeypatch.setattr(fuzzing.sys, "executable", str(script))
    (failed,) = fuzzing.in_process(tmp_path, [])["failures"]
    assert failed["number"] == 7
    assert "exit code -11" in failed["what"]


def forever(rng, known):
    while True:
        pass
