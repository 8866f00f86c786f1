"""The wheel holds the whole package: installed elsewhere, it estimates on its own."""

import shutil
import subprocess
import sys

import pytest
from conftest import ROOT

TRIAL = """
import sys
import tactilenlp
from tactilenlp import Measurements, Scene, example_recording, solve_estimate

assert tactilenlp.__file__.startswith(sys.argv[1]), tactilenlp.__file__
for name in tactilenlp.__all__:
    getattr(tactilenlp, name)
import formulations, hardware.world
from tactilenlp.output.html_report import write_report
data = Measurements.load(example_recording())
estimate = solve_estimate(data.select([0, 1]), Scene.load(example_recording()))
estimate.report(sys.argv[1] + "/report.html")
print(estimate.success, estimate.objective)
"""


PARTS = ("tactilenlp", "formulations", "hardware")
FILES = ("setup.cfg", "pyproject.toml", "README.md", "LICENSE")


def built(folder):
    """Return the wheel of this checkout, built from a copy without any download."""
    source = folder / "source"  # setuptools would leave its build/ in the checkout
    for name in PARTS:
        unwanted = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, source / name, ignore=unwanted)
    for name in FILES:
        shutil.copy(ROOT / name, source)
    how = ["--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", str(folder)]
    command = [sys.executable, "-m", "pip", "wheel", *how, str(source)]
    subprocess.run(command, check=True)
    (wheel,) = folder.glob("tactilenlp-*.whl")
    return wheel


@pytest.mark.slow
def test_a_wheel_imports_every_public_name_and_estimates_without_the_checkout(tmp_path):
    pytest.importorskip("setuptools", reason="setuptools is not installed (extra test)")
    pytest.importorskip("wheel", reason="wheel is not installed (extra: test)")
    place = tmp_path / "site"
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps",
               "--target", str(place), str(built(tmp_path))]  # fmt: skip
    subprocess.run(command, check=True)
    trial = [sys.executable, "-c", TRIAL, str(place)]
    told = {"PYTHONPATH": str(place), "PATH": "", "HOME": str(tmp_path)}
    done = subprocess.run(
        trial, cwd=tmp_path, env=told, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    success, objective = done.stdout.split()
    assert success == "True"
    assert float(objective) == pytest.approx(0.0, abs=5.0)  # no touch is unexplained


def test_the_version_is_that_of_the_metadata():
    from importlib.metadata import version

    import tactilenlp

    command = [sys.executable, "-m", "tactilenlp", "--version"]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert tactilenlp.__version__ == version("tactilenlp")
    assert said == f"tactilenlp {tactilenlp.__version__}\n"
