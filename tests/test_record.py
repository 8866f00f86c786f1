"""The record of benchmarks: what became worse is said, and ends with an exit code."""

import subprocess
import sys

import pytest
from conftest import BENCHMARKS, benchmark

HEAD = "start,actions,page,mm,converged,best,iterations,cpu_s\n"
BEFORE = HEAD + (
    "near,2,shooting,0.50,True,True,20,1.0\n"
    "near,2,shooting,0.70,True,False,22,1.2\n"
    "near,2,shooting,0.60,False,False,21,1.1\n"
    "far,2,paper,,False,False,200,9.0\n"
)


record = benchmark("record")


@pytest.fixture
def differ(record, tmp_path):
    """Return verdicts by (quantity, group) of a run that replaced some words."""

    def run(*changes, was=BEFORE):
        old, new = tmp_path / "old.csv", tmp_path / "new.csv"
        old.write_text(was)
        for before, after in changes:
            was = was.replace(before, after)
        new.write_text(was)
        record.keep("formulations", record.read(old), tmp_path)
        lines = record.compared("formulations", record.read(new), tmp_path)
        return {(q["quantity"], q["group"].split(", ")[2]): q["verdict"] for q in lines}

    return run


def test_the_same_run_differs_in_nothing(differ):
    assert set(differ().values()) == {"same"}


def test_an_error_beyond_its_tolerance_is_worse_and_within_it_the_same(differ):
    # The median is 0.6 mm: a quarter of it is tolerated.
    assert differ(("0.60", "0.74"))["median mm", "shooting"] == "same"
    found = differ(("0.60", "0.76"), ("0.70", "0.80"))
    assert found["median mm", "shooting"] == "worse"
    assert [v for v in found.values() if v != "same"] == ["worse"]


def test_fewer_failures_are_better_and_more_are_worse(differ):
    share = "share converged", "shooting"
    assert differ(("0.60,False", "0.60,True"))[share] == "better"
    assert differ(("0.70,True", "0.70,False"))[share] == "worse"
    lost = differ(("0.50,True,True", "0.50,True,False"))
    assert lost["share best", "shooting"] == "worse"


def test_what_is_no_longer_run_is_missing(differ):
    found = differ(("far,2,paper,,False,False,200,9.0\n", ""))
    assert found["median cpu_s", "paper"] == "missing"
    # An error that was never known is not missed.
    assert found["median mm", "paper"] == "same"


def test_a_record_says_when_and_with_what_it_was_made(record, tmp_path):
    (tmp_path / "run.csv").write_text(BEFORE)
    path = record.keep("formulations", record.read(tmp_path / "run.csv"), tmp_path)
    day, made, header, *lines = path.read_text().splitlines()
    assert day.startswith("# 20")
    assert "casadi" in made
    assert header.split(",") == list(record.FIELDS)
    assert len(lines) == 2 * 5


def test_a_regression_ends_with_an_exit_code(tmp_path):
    (tmp_path / "old.csv").write_text(BEFORE)
    (tmp_path / "new.csv").write_text(BEFORE.replace("1.1\n", "9.9\n").replace(
        "1.2\n", "9.9\n"))  # fmt: skip

    def call(verb, file):
        script, name = str(BENCHMARKS / "record.py"), "formulations"
        return subprocess.run(
            [sys.executable, script, verb, name, str(tmp_path / file),
             "--results", str(tmp_path / "results")],
            capture_output=True, text=True, timeout=120,
        )  # fmt: skip

    assert call("keep", "old.csv").returncode == 0
    assert call("compare", "old.csv").returncode == 0
    worse = call("compare", "new.csv")
    assert worse.returncode == 1
    assert "median cpu_s" in worse.stdout


def test_every_record_that_is_kept_belongs_to_a_benchmark(record):
    for path in record.RESULTS.glob("*.csv"):
        lines = record.read(path)
        assert path.stem in record.RECIPES
        assert {line["worse"] for line in lines} <= {"up", "down"}
        assert set(lines[0]) == set(record.FIELDS)
