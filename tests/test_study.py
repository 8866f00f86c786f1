"""A study is one file: kept trial by trial, taken up again, read without us."""

import json
import re
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import BENCHMARKS, benchmark
from threadpoolctl import threadpool_info

from tactilenlp.errors import FileError

CASES = [(2, "a"), (3, "b"), (4, "c")]


study = benchmark("study")


def squared(number, word):
    return {"square": number**2, "word": word}


def test_results_come_in_the_order_of_the_cases(study, tmp_path):
    here = study.run_study(tmp_path / "a.jsonl", "squares", squared, CASES)
    with ThreadPoolExecutor(2) as pool:
        there = study.run_study(tmp_path / "b.jsonl", "squares", squared, CASES, pool)
    assert [r["square"] for r in here] == [4, 9, 16]
    assert there == here
    assert study.results_of(tmp_path / "a.jsonl", "squares") == here


def numbers(count):
    return {"count": np.int64(count), "odd": np.bool_(count % 2), "span": (0, count)}


def test_a_result_is_the_same_whether_it_is_new_or_was_kept(study, tmp_path):
    file = tmp_path / "deep" / "a.jsonl"
    new = study.run_study(file, "numbers", numbers, [(3,)])
    assert new == study.run_study(file, "numbers", numbers, [(3,)])
    assert new == [{"count": 3, "odd": True, "span": [0, 3]}]
    assert type(new[0]["count"]) is int
    assert new[0]["odd"] is True


def test_a_table_has_a_column_for_every_key_of_any_row(study, tmp_path):
    study.write_csv(tmp_path / "a.csv", [{"a": 1}, {"a": 2, "b": "x, y"}])
    assert (tmp_path / "a.csv").read_text() == 'a,b\n1,\n2,"x, y"\n'


def test_a_study_writes_its_trials_and_their_table_beside_each_other(study, tmp_path):
    path, here = tmp_path / "some_squares", SimpleNamespace(executor="none", workers=1)
    assert study.tabled_study(here, path, squared, CASES)[0]["square"] == 4
    assert study.results_of(path.with_suffix(".jsonl"), "some squares")
    assert path.with_suffix(".csv").read_text() == "square,word\n4,a\n9,b\n16,c\n"
    study.tabled_study(here, path, squared, CASES, table=lambda rows: rows[:1])
    assert path.with_suffix(".csv").read_text() == "square,word\n4,a\n"


def test_a_study_is_read_without_us(study, tmp_path):
    study.run_study(tmp_path / "a.jsonl", "squares", squared, CASES, about={"n": 2})
    with open(tmp_path / "a.jsonl") as file:
        header, *trials = map(json.loads, file)
    assert header["format"] == "tactilenlp study"
    assert header["version"] == study.VERSION
    assert header["about"] == {"n": 2}
    assert "tactilenlp" in header["written_by"]
    assert trials[1] == {"case": [3, "b"], "result": {"square": 9, "word": "b"}}


def test_what_is_kept_is_not_run_again_and_a_cut_line_is(study, tmp_path):
    file, ran = tmp_path / "a.jsonl", []

    def stopped(number, word):
        ran.append(number)
        if ran == [2, 3]:
            raise KeyboardInterrupt
        return squared(number, word)

    with pytest.raises(KeyboardInterrupt):
        study.run_study(file, "squares", stopped, CASES)
    file.write_text(file.read_text() + '{"case": [3, "b"], "res')
    rows = study.run_study(file, "squares", stopped, CASES)
    assert ran == [2, 3, 3, 4]
    assert rows == [squared(*case) for case in CASES]
    assert study.run_study(file, "squares", stopped, CASES) == rows
    assert len(ran) == 4


def test_a_trial_that_fails_ends_the_study_and_cancels_the_rest(study, tmp_path):
    ran = []

    def fails(number, word):
        ran.append(number)
        time.sleep(0.05)
        raise ZeroDivisionError(word)

    many = [(k, "") for k in range(100)]
    with ThreadPoolExecutor(1) as pool, pytest.raises(ZeroDivisionError):
        study.run_study(tmp_path / "a.jsonl", "s", fails, many, pool)
    assert len(ran) < 50  # a few more begin before the first is heard of


@pytest.mark.parametrize(
    ("content", "word"),
    [
        ("time, x\n", "no file of a study"),
        ("[]\n", "no file of a study"),
        ('{"format": "tactilenlp study"}\n{}\n', "no file of a study"),
        ('{"format": "tactilenlp study", "version": 0}\n', "'version': 0"),
        ('{"format": "tactilenlp study", "version": 1, "study": 3}\n', "'study': 3"),
    ],
)
def test_another_file_is_refused_and_left_as_it_is(study, content, word, tmp_path):
    file = tmp_path / "a.jsonl"
    file.write_text(content)
    with pytest.raises(FileError, match=word):
        study.run_study(file, "squares", squared, CASES)
    assert file.read_text() == content


def test_other_settings_are_another_study(study, tmp_path):
    file = tmp_path / "a.jsonl"
    study.run_study(file, "squares", squared, CASES, about={"n": 2})
    with pytest.raises(FileError, match=r"'n': 3.*'n': 2.*another file"):
        study.run_study(file, "squares", squared, CASES, about={"n": 3})


def test_what_is_mapped_keeps_its_order_and_may_say_what_stands_for_a_failure(study):
    def inverse(number):
        return 1 / number

    cases = [(2,), (0,), (4,)]
    with ThreadPoolExecutor(2) as pool:
        for executor in (None, pool):
            lost = lambda case, error: (case, type(error))  # noqa: E731
            found = list(study.mapped(executor, inverse, cases, lost))
            assert found == [0.5, ((0,), ZeroDivisionError), 0.25]
            with pytest.raises(ZeroDivisionError):
                list(study.mapped(executor, inverse, cases))


ONE_RUN = {  # benchmarks of which there is nothing to spread, and why
    "count_code": "reads sources",
    "executors": "measures executors",
    "exploration_report": "reads a study",
    "optical_frame": "times one picture",
    "predicted_pushes": "half a minute",
    "record": "reads a table",
    "regress": "times pairs, one process at a time",
    "report_cuboid": "reads runs",
    "search": "pairs of trees in turn",
    "time_limits": "times one process at a time",
    "shape_classes": "a minute a class",
    "report_monte_carlo": "reads a study",
}


def test_a_trial_is_told_by_its_case_and_what_its_last_row_has_of_some_columns(study):
    say = study.telling("refused", "off_mm", "ratios")
    last = {"refused": "", "off_mm": 1.2345, "ratios": [0.5, 2.0], "more": 1}
    assert say(["box", 3], last) == "box 3: off_mm 1.23, ratios 2"
    assert say(["box", 3], [{}, last]) == "box 3: off_mm 1.23, ratios 2"
    assert say([4], {"refused": "no contact", "ratios": []}) == (
        "4: refused no contact, ratios none"
    )


def threads():
    return [library["num_threads"] for library in threadpool_info()]


@pytest.mark.slow
def test_trials_have_one_thread_wherever_they_run(study, monkeypatch):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    for name in ("none", "processes"):
        where = SimpleNamespace(executor=name, workers=1)
        with study.executor_of(where) as executor:
            (found,) = study.mapped(executor, threads, [()])
        assert set(found) == {1}


def test_a_running_cluster_imports_all_scripts_anew_once_all_are_there(
    study, monkeypatch
):
    scripts, sent, ran = {p.stem for p in BENCHMARKS.glob("*.py")}, {}, []

    class Client(nullcontext):
        def __init__(self, address):
            self.enter_result = self

        def upload_file(self, file, load=True):
            sent[Path(file).stem] = load

        def run(self, function):
            assert sent.keys() == scripts
            with monkeypatch.context() as worker:
                for name in scripts:  # as after a study
                    worker.setitem(sys.modules, name, None)
                function()
                ran.append((function.__name__, scripts & sys.modules.keys()))

        def run_on_scheduler(self, function):
            self.run(function)

        def get_executor(self, pure):
            return "pool"

    monkeypatch.setitem(sys.modules, "distributed", SimpleNamespace(Client=Client))
    where = SimpleNamespace(executor="dask", workers=None, address="tcp://there:8786")
    with study.executor_of(where) as pool:
        assert pool == "pool"
        assert sent == dict.fromkeys(scripts, False)
    assert ran == [("drop", set()), ("drop", set()), ("one_thread", scripts)]


def test_a_wrong_commit_is_told_with_what_git_says(study, monkeypatch, capfd):
    monkeypatch.setenv("OMP_NUM_THREADS", "1")  # as the script sets it
    import regress

    with pytest.raises(subprocess.CalledProcessError):
        regress.tree_of("no-such-commit").__enter__()
    assert capfd.readouterr().err.strip()


TIMED = (  # benchmarks whose result are seconds
    *("time_against_error", "scale", "cube_tosses", "estimate_cuboid"),
    *("estimate_polytope", "compare_formulations", "build_time", "reductions"),
)


@pytest.mark.parametrize("name", TIMED)
def test_where_seconds_are_the_result_one_process_is_the_default(name):
    text = (BENCHMARKS / f"{name}.py").read_text(encoding="utf-8")
    assert re.search(r'study_parser\(.*executor="none"\)', text)


def test_every_study_takes_an_executor():
    texts = {p.stem: p.read_text(encoding="utf-8") for p in BENCHMARKS.glob("*.py")}
    scripts = {name for name, text in texts.items() if '"__main__"' in text}
    takes = re.compile(r"\b(executor_of|tabled_study)\(")
    spread = {name for name in scripts if takes.search(texts[name])}
    assert scripts - spread == {*ONE_RUN}
