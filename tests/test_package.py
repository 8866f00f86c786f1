"""The package as a user meets it: names, documents, what lies beside what."""

import importlib
import re
import subprocess
import sys
import types
from pathlib import Path

import tactilenlp
from tactilenlp import solve_estimate

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
