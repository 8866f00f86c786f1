"""The package as a user meets it: names, documents, what lies beside what."""

import importlib
import re
import subprocess
import sys
import types
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import tactilenlp
from formulations.shape import CUBOID
from tactilenlp import Measurements, Scene, Workspace, choose_action, solve_estimate
from tactilenlp.errors import OptionError

ROOT = Path(__file__).resolve().parents[1]


def test_every_public_name_can_be_imported_and_is_no_module():
    for name in tactilenlp.__all__:
        assert not isinstance(getattr(tactilenlp, name), types.ModuleType)
        assert not (ROOT / "tactilenlp" / f"{name}.py").exists()


def test_the_three_packages_lie_side_by_side():
    folders = {
        Path(importlib.import_module(name).__file__).parents[1]
        for name in ("tactilenlp", "formulations", "hardware")
    }
    assert len(folders) == 1


def test_importing_stays_light():
    code = "import sys, tactilenlp; print(*sorted(sys.modules))"
    out = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    heavy = {"mujoco", "matplotlib", "trimesh", "nlopt", "casadi", "scipy"}
    assert not heavy & set(out.stdout.split())


def test_the_page_of_the_formulations_readme_is_solved_as_printed(recorded):
    text = (ROOT / "formulations" / "README.md").read_text()
    code = re.search(r"```python\n(.*?)```", text, re.S).group(1)
    page = types.ModuleType("my_page")
    exec(compile(code, "formulations/README.md", "exec"), page.__dict__)
    data, scene, _ = recorded
    estimate = solve_estimate(data.select(range(2)), scene, formulation=page)
    assert estimate.formulation == "my_page"
    assert "walk" in estimate.costs


def test_the_versions_of_code_and_citation_agree():
    from importlib.metadata import version

    cited = re.search(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text(), re.M)
    assert cited.group(1) == version("tactilenlp")
    assert f"## {cited.group(1)}" in (ROOT / "CHANGELOG.md").read_text()


def own_distance(theta, q, small):
    h = theta / 2  # first order in the gap: exact on the surface
    size, slope = ca.norm_2(q / h), ca.norm_2(q / h**2)
    return size * (size - 1) / slope


def own_normal(theta, q, small):
    g = q / theta**2
    return g / ca.norm_2(g)


def own_foot(theta, signs):
    return signs * theta * ca.DM([0.05, 0.05, 0.5])


def own_inertia(theta):
    square = theta * theta
    return ca.diag(ca.sum1(square) - square) / 20


OWN = replace(
    CUBOID, name="own ellipsoid", distance=own_distance, normal=own_normal,
    corner=own_foot, inertia=own_inertia,
)  # fmt: skip


@pytest.mark.slow
def test_an_ellipsoid_of_ones_own_is_estimated_and_touched_next():
    axes, height, rho = np.array([0.05, 0.04, 0.03]), 0.015, 0.01
    data = probed(axes, height, rho)
    estimate = solve_estimate(data, Scene(), shape=OWN)
    assert estimate.shape == "own ellipsoid"
    assert np.sort(estimate.theta) == pytest.approx(np.sort(axes), abs=1e-3)
    # its mesh is the ellipsoid, not the hull of its feet: facets cut off about 1 %
    assert estimate.mesh().volume == pytest.approx(
        np.pi / 6 * estimate.theta.prod(), rel=0.015
    )
    # one's own shape is at hand, not in the estimate, that keeps its name
    choice = choose_action(estimate, Workspace(fingers=1), budget=30, shape=OWN)
    assert choice.gain == choice.history.max() > 0.1
    with pytest.raises(OptionError, match="unknown shape"):
        choose_action(estimate)


def probed(axes, height, rho) -> Measurements:
    """Return what a finger feels that touches a fixed ellipsoid from several sides."""
    time, position, contact, normal, action = [], [], [], [], []
    for k, (azimuth, rise) in enumerate(
        [(0, 0), (90, 0), (180, 0), (270, 0), (30, 70)]
    ):
        a, e = np.radians([azimuth, rise])
        d = np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
        point = d / np.linalg.norm(d / (axes / 2))
        n = point / axes**2
        n /= np.linalg.norm(n)
        for i in range(8):
            away = max(0, 5 - i) * 4e-3
            time.append(1.5 * k + i / 30)
            position.append([point + (rho + away) * n + [0, 0, height]])
            contact.append([away == 0])
            normal.append([n * (away == 0)])
            action.append(k)
    return Measurements(
        time=time, finger_position=position, finger_radius=rho, contact=contact,
        normal=normal, action=action,
    )  # fmt: skip
