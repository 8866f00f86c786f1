"""Who may import whom, and who may know what; `lint-imports` checks the layers too."""

import ast
import re
import sys
from functools import cache
from itertools import chain
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
NLP, SOLVERS = (sorted((ROOT / "tactilenlp" / room).glob("*.py"))
                for room in ("nlp", "solvers"))  # fmt: skip
TACTILE = re.compile(
    r"finger|touch|contact|friction|pose\b|poses|object_|ground|tactile"
)


@cache
def parsed(path):
    return ast.parse(path.read_text())


@cache
def imported(path):
    """Return the modules that a file imports, relative ones with their dots."""
    found = set()
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        if isinstance(node, ast.ImportFrom):
            found |= {"." * node.level + (node.module or "")}
    return found


def words(path):
    """Return the names and strings of a file's code, without docstrings, comments."""
    tree, docs, found = parsed(path), set(), []
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list) and body and isinstance(body[0], ast.Expr):
            docs.add(body[0].value)
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            found += [node.value] * (node not in docs)
        found += [
            getattr(node, field)
            for field in ("id", "arg", "attr", "name")
            if isinstance(getattr(node, field, None), str)
        ]
    return found


@pytest.mark.parametrize(
    "page", sorted((ROOT / "formulations").glob("*.py")), ids=lambda page: page.stem
)
def test_a_page_imports_casadi_the_language_and_other_pages_only(page):
    for module in imported(page):
        first = module.split(".")[0]
        assert first in {"", "casadi"} or first in sys.stdlib_module_names, module


@pytest.mark.parametrize("package", ["tactilenlp", "formulations"])
def test_nothing_imports_the_bench(package):
    for path in (ROOT / package).rglob("*.py"):
        assert not any(m.split(".")[0] == "hardware" for m in imported(path)), path.name


@pytest.mark.parametrize("path", [*NLP, *SOLVERS], ids=lambda path: path.stem)
def test_the_nlp_package_has_no_tactile_word(path):
    room = NLP if path in NLP else SOLVERS
    own = {f".{module.stem}" for module in room}
    own |= {f"..nlp.{module.stem}" for module in NLP if room is SOLVERS}
    general = (
        *("brief", "deadline", "interrupt", "library_cache", "named", "validation"),
    )
    own |= {"..errors", *(f"..common.{module}" for module in general)}
    assert {m for m in imported(path) if m.startswith(".")} <= own
    outside = {m.split(".")[0] for m in imported(path) if not m.startswith(".")}
    assert not outside & {"formulations", "hardware", "mujoco", "trimesh"}
    known = [word.replace("tactilenlp", "").replace("TACTILENLP", "")
             for word in words(path)]  # fmt: skip
    assert [word for word in known if TACTILE.search(word.lower())] == []


PACKAGES = sorted(path.parent for path in (ROOT / "tactilenlp").rglob("__init__.py"))


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.name)
def test_a_package_has_at_most_twelve_modules_of_at_most_300_lines(package):
    modules = [path for path in package.glob("*.py") if path.name != "__init__.py"]
    assert len(modules) <= 12
    for path in modules:
        assert len(path.read_text().splitlines()) <= 300, path.name


@pytest.mark.parametrize("package", PACKAGES[1:], ids=lambda package: package.name)
def test_a_package_names_all_its_modules_in_its_docstring(package):
    words = ast.get_docstring(parsed(package / "__init__.py"))
    modules = {path.stem for path in package.glob("*.py")} - {"__init__"}
    assert {name for name in modules if f"`{name}`" not in words} == set()


def test_a_page_has_at_most_150_lines():
    """A page is a whole problem: it states `build` and LEVELS."""
    for path in (ROOT / "formulations").glob("*.py"):
        text = path.read_text()
        if "\ndef build(" in text and "\nLEVELS" in text:
            assert len(text.splitlines()) <= 150, path.name


OF_PAGES = {  # what every page, or every error of the fingers, states for itself
    *("ALIKE", "ALPHA", "EXTENDS", "FREED", "LEVELS", "NAME", "NORMAL", "OFFSETS"),
    *("REDUCTIONS", "ROUGH", "TOUCH", "V_EPS", "WEIGHTS", "MM"),
}


def constants_of(line, in_pairs=True):
    """Yield name and value of the constants that a line of a module defines.

    in_pairs: also of those that it defines together, as A, B = 1, 2.
    """
    for target in line.targets if isinstance(line, ast.Assign) else ():
        both = isinstance(target, ast.Tuple) and isinstance(line.value, ast.Tuple)
        pairs = zip(target.elts, line.value.elts, strict=True) if both else ()
        for name, value in pairs if both and in_pairs else [(target, line.value)]:
            if isinstance(name, ast.Name) and name.id.isupper():
                yield name.id, ast.unparse(value)


def several_values(paths, in_pairs):
    """Return the names of constants that have several values in some modules."""
    values = {}
    for line in chain.from_iterable(parsed(path).body for path in paths):
        for name, value in constants_of(line, in_pairs):
            values.setdefault(name, set()).add(value)
    return {name for name, found in values.items() if len(found) > 1}


def test_the_name_of_a_constant_means_one_thing():
    machine = [*(ROOT / "tactilenlp").rglob("*.py")]
    pages = [*(ROOT / "formulations").glob("*.py")]
    assert several_values([*machine, *pages], in_pairs=False) <= OF_PAGES
    assert several_values(machine, in_pairs=True) == set()
