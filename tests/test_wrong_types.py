"""Whatever is public refuses what it cannot use, in words of its own."""

import inspect

import numpy as np
import pytest

import tactilenlp
from tactilenlp.errors import TactileError

NUMBERS = (None, -1, 3.5)
THINGS = ("ball", np.zeros(3), [1, 2], {})
RESULTS = {"Body", "Choice", "Estimate", "Information", "Problem", "Prospect"}
RESULTS |= {"Executor", "Page", "Solution", "Step", "TouchedWorld"}
# nobody makes these by hand
LAZY = {"explore"}  # it yields: nothing is checked before the first step
FREE = {
    "_",
    "executor",
    "axis",
    "truth",
    "throw",
    "path",
    "folder",
    "formulation",
    "key",
}
KNOWN = {"estimate", "solved", "scene", "data", "estimates", "trajectories", "path"}


def cases():
    """Yield every public callable and argument whose other arguments are KNOWN."""
    for name in tactilenlp.__all__:
        thing = getattr(tactilenlp, name)
        error = inspect.isclass(thing) and issubclass(thing, Exception)
        if not callable(thing) or error or name in RESULTS | LAZY:
            continue
        parameters = inspect.signature(thing).parameters.values()
        given = [p for p in parameters if p.kind is not p.VAR_KEYWORD]
        for one in (p for p in given if p.name not in FREE):
            needed = {p.name for p in given if p.default is p.empty} - {one.name}
            if needed <= KNOWN:
                yield pytest.param(thing, one, needed, id=f"{name}-{one.name}")


@pytest.fixture(scope="module")
def known(estimate, recorded):
    """Return a good argument for each name."""
    fall = np.linspace(0, 1, 9)[:, None] * [0, 0, -1.0]
    tossed = tactilenlp.Trajectories(
        toss=np.zeros(9, int), position=fall, quaternion=np.eye(4)[[0] * 9], dt=0.01
    )
    return {
        "estimate": estimate, "solved": estimate, "estimates": [estimate],
        "scene": recorded[1], "data": recorded[0].select([0]), "path": "nowhere.html",
        "trajectories": tossed,
    }  # fmt: skip


@pytest.mark.filterwarnings("ignore")  # of numpy, on the way to the error
@pytest.mark.parametrize(("thing", "one", "needed"), list(cases()))
def test_a_wrong_type_is_refused(thing, one, needed, known, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    good = {name: known[name] for name in needed}
    cheap = inspect.isclass(thing) or one.default is one.empty
    refused = 0
    for wrong in (*THINGS, *NUMBERS) if cheap else THINGS:
        try:
            thing(**good | {one.name: wrong})
        except TactileError:  # any other error fails the test
            refused += 1
    # What takes numbers takes some of these, what takes names none.
    assert refused >= len(THINGS) - 1
