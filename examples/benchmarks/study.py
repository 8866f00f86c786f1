"""Run the trials of a study on any executor; save them in one file and resume.

The file is text with one JSON value a line.  The first line is a header: "format",
"version", "study" (its name), "about" (what all trials share), "written_by" (versions).
Each further line is a finished trial: "case" (its arguments), "result".  An incomplete
line, as after a power failure, is dropped and its trial is run again:

    header, *trials = map(json.loads, open("study.jsonl"))
"""

import csv
import importlib
import io
import json
import os
import sys
from argparse import ArgumentParser
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path

from threadpoolctl import threadpool_limits

from tactilenlp.common.file_lock import locked
from tactilenlp.common.npz import versions
from tactilenlp.common.progress import progress, wipe
from tactilenlp.common.whole_file import write_whole
from tactilenlp.errors import FileError

FORMAT, VERSION = "tactilenlp study", 1
EXECUTORS = ("processes", "dask", "mpi", "none")


def run_study(path, name, function, cases, executor=None, about=None, say=None) -> list:
    """Return function(*case) of every case, in order; run what the file has not yet.

    cases: lists of plain values; results: plain values or NumPy's numbers, returned as
    the file has them.  executor: of concurrent.futures, None runs here; say(case,
    result): words for each that ended.  Raises FileError while another process runs a
    study into the file.
    """
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    header = {"format": FORMAT, "version": VERSION, "study": name, "about": about}
    cases = [list(case) for case in cases]
    with locked(path):
        kept = _taken_up(Path(path), header, drop=True)
        todo = [case for case in cases if json.dumps(case) not in kept]
        ended = progress(_ended(executor, function, todo), name, total=len(todo))
        for case, result in _written(path, header, ended):
            kept[json.dumps(case)] = result
            if say is not None:
                wipe()
                print(say(case, result), flush=True)
    return [kept[json.dumps(case)] for case in cases]


def _written(path, header: dict, ended):
    """Yield each case that ended and its result, as the file has it by then.

    The same values whether a trial is new or was kept: tuples are lists.
    """
    with open(path, "a", encoding="utf-8") as file:
        if not file.tell():
            file.write(json.dumps(header | {"written_by": versions()}) + "\n")
        for case, result in ended:
            line = json.dumps({"case": case, "result": result}, default=_plain)
            file.write(line + "\n")
            file.flush()
            yield case, json.loads(line)["result"]


def tabled_study(arguments, path, function, cases, say=None, table=None):
    """Run a study on the executor that `arguments` choose; return its results.

    path: without suffix.  path.jsonl keeps the trials, path.csv is their table, and the
    study has the path's last part as its name.  Results of several rows are returned as
    these.  table(results): the rows of the table, by default the results.
    """
    file, name = path.with_suffix(".jsonl"), path.name.replace("_", " ")
    with executor_of(arguments) as executor:
        results = run_study(file, name, function, cases, executor, say=say)
    results = [row for r in results for row in (r if isinstance(r, list) else [r])]
    write_csv(path.with_suffix(".csv"), table(results) if table else results)
    return results


def telling(*columns):
    """Return what says of a trial that ended its case and some columns.

    Of a trial of several rows they are those of the last row; of a column of lists it
    is the largest number.  What a row does not have is left out.
    """

    def say(case, result) -> str:
        row = result[-1] if isinstance(result, list) else result
        told = [f"{c} {words_of(row[c])}" for c in columns if row.get(c, "") != ""]
        return f"{' '.join(map(str, case))}: {', '.join(told)}"

    return say


def grouped(rows, *columns) -> dict[tuple, list[dict]]:
    """Return the rows by what they have in some columns, in order of appearance."""
    groups = {}
    for row in rows:
        groups.setdefault(tuple(row[column] for column in columns), []).append(row)
    return groups


def table(rows, *names: str) -> str:
    """Return rows as lines of text: these columns, by default all of the first row.

    Numbers have three digits; what a row does not have is blank.
    """
    names = names or tuple(rows[0])
    cells = [names, *([words_of(row.get(name, "")) for name in names] for row in rows)]
    width = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = ([cell.rjust(w) for cell, w in zip(c, width, strict=True)] for c in cells)
    return "\n".join(map("  ".join, lines))


def words_of(value) -> str:
    """Return a value in a few characters: three digits, of a list the largest."""
    if isinstance(value, list):
        value = max(value, default="none")
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def results_of(path, name: str) -> list:
    """Return what is kept of a study so far, in the order in which trials ended."""
    return [*_taken_up(Path(path), {"study": name}).values()]


def write_csv(path, rows: list[dict]) -> None:
    """Write rows as one table; a column for every key that any of them has."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    names, text = dict.fromkeys(key for row in rows for key in row), io.StringIO()
    table = csv.DictWriter(text, [*names])
    table.writeheader()
    table.writerows(rows)
    write_whole(path, text.getvalue())


def _plain(value):
    """Return a NumPy number or boolean as Python's."""
    return value.item()


def _taken_up(path: Path, expected: dict, drop: bool = False) -> dict:
    """Return the results in a file by their case.

    A last line that was cut does not count; drop: the file is cut before it.
    """
    text = path.read_bytes() if path.exists() else b""
    whole = text[: text.rfind(b"\n") + 1]
    if drop and whole != text:
        os.truncate(path, len(whole))
    if not whole:
        return {}
    where = {"where": str(path), "next": "give another file, or delete this one"}
    try:
        found, *trials = [json.loads(line) for line in whole.splitlines()]
        other = {k: found.get(k) for k, v in expected.items() if found.get(k) != v}
        kept = {json.dumps(trial["case"]): trial["result"] for trial in trials}
    except (ValueError, KeyError, TypeError, AttributeError) as bad:
        got = f"{type(bad).__name__}: {bad}"
        raise FileError("no file of a study", got=got, **where) from bad
    if other:
        expected = f"{ {k: expected[k] for k in other} }"
        raise FileError("of another study", got=other, expected=expected, **where)
    return kept


def _ended(executor, function, cases):
    """Yield each case and its result as it ends; what ends badly ends the study."""
    if executor is None:
        for case in cases:
            yield case, function(*case)
        return
    futures = {executor.submit(function, *case): case for case in cases}
    try:
        for future in as_completed(futures):
            yield futures[future], future.result()
    finally:  # after an error or Ctrl-C nobody waits for the others
        for future in futures:
            future.cancel()


def mapped(executor, function, cases, lost=None):
    """Yield function(*case) of every case, in their order; nothing is kept.

    lost(case, error): what stands for a case that failed or took its process along;
    without it, what ends badly ends all.
    """
    cases = [tuple(case) for case in cases]
    futures = [executor.submit(function, *case) for case in cases if executor]
    try:
        for k, case in enumerate(cases):
            try:
                result = futures[k].result() if executor else function(*case)
            except Exception as error:
                if lost is None:
                    raise
                result = lost(case, error)
            yield result
    finally:
        for future in futures:
            future.cancel()


def study_parser(about: str, folder=True, executor="processes") -> ArgumentParser:
    """Return the parser of a script, with the arguments that `executor_of` reads.

    about: its docstring; folder: whether its first argument is where it writes;
    executor: the default, "none" where seconds are compared.
    """
    parser = ArgumentParser(description=about.splitlines()[0])
    if folder:
        parser.add_argument("folder", type=Path)
    parser.add_argument("--executor", choices=EXECUTORS, default=executor)
    parser.add_argument("--workers", type=int, help="processes, all cores by default")
    parser.add_argument("--address", help="of a running Dask scheduler")
    return parser


def one_thread() -> None:
    """Let linear algebra have one thread, here and in processes that are started."""
    os.environ["OMP_NUM_THREADS"] = "1"
    threadpool_limits(1)


@contextmanager
def executor_of(arguments):
    """Give where trials run: None for here, the cores, a Dask cluster, or MPI.

    A cluster that runs already is sent all scripts beside this one.
    """
    one_thread()
    workers = arguments.workers or os.cpu_count()
    if arguments.executor == "none":
        yield None
    elif arguments.executor == "processes":
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            yield pool
    elif arguments.executor == "mpi":
        from mpi4py.futures import MPIPoolExecutor

        with MPIPoolExecutor(workers, initializer=one_thread) as pool:
            yield pool
    else:
        from distributed import Client

        at = {"n_workers": workers, "threads_per_worker": 1}  # a cluster of our own
        at = {"address": arguments.address} if arguments.address else at
        with Client(**at) as client:
            if arguments.address:
                _send_scripts(client)
            yield client.get_executor(pure=False)


def _send_scripts(client) -> None:
    """Send all scripts beside this one to a running cluster, which imports them anew.

    A script of any name may import any other, so they are imported only once all are
    there.
    """
    files = [*Path(__file__).parent.glob("*.py")]
    for file in files:
        client.upload_file(str(file), load=False)
    names = [file.stem for file in files]

    def drop() -> None:  # sent by value: a worker may have an older script of this name
        for name in names:
            sys.modules.pop(name, None)
        importlib.invalidate_caches()

    client.run_on_scheduler(drop)  # which unpickles the functions as well
    client.run(drop)
    client.run(one_thread)
