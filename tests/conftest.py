"""What several tests share: where the shared recordings lie, and small estimates."""

import fcntl
import os
import pickle
import sys
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SCENES = ROOT.parent / "shared" / "scenes"
TOSSES = ROOT.parent / "shared" / "captures" / "cube_tosses.npz"
RECORDINGS = ROOT / "tactilenlp" / "data" / "recordings"
RECORDED = RECORDINGS / "cuboid.npz"
BENCHMARKS = ROOT / "examples" / "benchmarks"

os.environ["MPLBACKEND"] = "Agg"


def benchmark(*names):
    """Return a fixture: a script of the benchmarks as a module, or several."""

    @pytest.fixture
    def modules(monkeypatch):
        monkeypatch.syspath_prepend(str(BENCHMARKS))
        found = [import_module(name) for name in names]
        return found if len(found) > 1 else found[0]

    return modules


@pytest.fixture(autouse=True)
def _closed():
    """Close the figures of a test."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


def squeezed(*body, **about):
    """Return the world in which two fingers squeeze a body off its centre.

    It floats; what a World is told of the body.
    """
    from types import SimpleNamespace

    import numpy as np

    from tactilenlp.simulation.world import World

    world = World(*body, **about, ground=None, gravity=0.0)
    left = [(-0.06, 0.008, 0.204), (0.0, 0.008, 0.204)]
    right = [(0.07, -0.01, 0.196), (0.035, -0.01, 0.196)]
    path = np.stack([left, right], axis=1)
    world.execute(SimpleNamespace(time=np.array([0, 1.2]), finger_position=path))
    return world


def _replace_the_default_cache(patch):
    """Make a cache that compiles nothing the default one, and return it."""
    from tactilenlp.nlp import term_functions

    patch.setattr(term_functions, "_default", term_functions.TermFunctionCache())
    patch.setattr(
        term_functions, "start_compilation",
        lambda functions, *_: term_functions.Compiling(functions),
    )  # fmt: skip
    return term_functions.default_cache()


@pytest.fixture(scope="module")
def not_compiled():
    """Compile no term function for a few terms that is not compiled already."""
    with pytest.MonkeyPatch.context() as patch:
        _replace_the_default_cache(patch)
        yield


@pytest.fixture(scope="session")
def scenes() -> Path:
    """The folder of shared scenes; skips where it is absent."""
    if not SCENES.is_dir():
        pytest.skip(f"no shared scenes beside this checkout ({SCENES})")
    return SCENES


@pytest.fixture(scope="session")
def tosses():
    """Four tosses of a real cube, 104.8 mm wide, 0.37 kg; skips where absent."""
    if not TOSSES.is_file():
        pytest.skip(f"no real tosses beside this checkout ({TOSSES})")
    from tactilenlp import Trajectories

    every = Trajectories.load(TOSSES)
    return every.select(every.tosses[:4])


@pytest.fixture(scope="session")
def recorded():
    """The recording that ships with the project: data, scene and truth keys."""
    import numpy as np

    from tactilenlp import Measurements, Scene

    with np.load(RECORDED) as file:
        truth = {key: file[key] for key in file.files}
    return Measurements.load(RECORDED), Scene.load(RECORDED), truth


@pytest.fixture(scope="session")
def two_actions(recorded):
    """The first two actions: from the top, then on two sides; scene and truth keys."""
    data, scene, truth = recorded
    return data.select(range(2)), scene, truth


@pytest.fixture(scope="session")
def once(tmp_path_factory):
    """Return a function: what `make()` returns, made by one worker of pytest-xdist.

    The workers of a run share a folder, into which the first one that asks writes it.
    """
    if "PYTEST_XDIST_WORKER" not in os.environ:
        return lambda name, make: make()
    folder = tmp_path_factory.getbasetemp().parent

    def made(name, make):
        with (folder / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # the others wait until it is written
            file = folder / f"{name}.pickle"
            if not file.exists():
                file.write_bytes(pickle.dumps(make()))
            return pickle.loads(file.read_bytes())

    return made


@pytest.fixture(scope="session")
def estimate(recorded, once):
    """The estimate of the first three actions of the recording."""
    from tactilenlp import solve_estimate

    data, scene, _ = recorded
    return once("estimate", lambda: solve_estimate(data.select(range(3)), scene))


@pytest.fixture(scope="session")
def programme(estimate):
    """The programme of the estimate, at its solution."""
    from tactilenlp.estimation.observed_information import programme_at

    return programme_at(estimate)


@pytest.fixture(scope="session")
def touched(recorded, once):
    """The estimate of two actions, after which some faces are still untouched."""
    from tactilenlp import solve_estimate

    data, scene, _ = recorded
    return once("touched", lambda: solve_estimate(data.select(range(2)), scene))


@pytest.fixture
def truth(recorded, touched):
    file = recorded[2]
    return {
        "position": file["object_position"][: touched.measurements.samples],
        "quaternion": file["object_quaternion"][: touched.measurements.samples],
        "side_lengths": file["side_lengths"],
    }


@pytest.fixture
def interpreted(monkeypatch):
    """Derive every term function anew, evaluated by the virtual machine: its cache."""
    monkeypatch.setattr(
        "tactilenlp.nlp.term_functions.compiled_earlier", lambda *_: None
    )
    return _replace_the_default_cache(monkeypatch)


@pytest.fixture(scope="module")
def pushed():
    """A world after two pushes, and what each of them returned."""
    from pushes import SIZES, push

    from tactilenlp import World

    world = World(SIZES)
    first = world.execute(push())
    return world, first, world.execute(push(reach=-0.05))


@pytest.fixture
def foreign(monkeypatch):
    """The benchmark of boxes in other worlds, as a module."""
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return import_module("foreign")
