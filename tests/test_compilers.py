"""Compilers run beside each other and beside a fork of their process."""

import multiprocessing
import os
from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import pytest
from cache_child import COMPILED, LONGEST

from tactilenlp.common.deadline import NEVER, Deadline
from tactilenlp.nlp import codegen, compilation
from tactilenlp.nlp.term_functions import TermFunctionCache

pytestmark = [
    pytest.mark.skipif(codegen.compiler() is None, reason="no C compiler here"),
    pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning"),
]


def test_compilers_run_beside_each_other(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    x = ca.SX.sym("x")
    waiting = [
        codegen.start_compilation([ca.Function("value", [x], [x**k])], f"{k}")
        for k in (3, 4, 5)
    ]
    assert 1 <= len(compilation._running) <= (os.cpu_count() or 1)
    values = [float(made()[0](2.0)) for made in waiting]
    assert values == [8.0, 16.0, 32.0]
    assert not compilation._running
    assert codegen.compiled_earlier(["value"], "4")[0].class_name() == COMPILED


def forked(compute):
    """Return what compute() returns in a fork of this process."""
    fork = multiprocessing.get_context("fork")
    receive, send = fork.Pipe(duplex=False)
    process = fork.Process(target=lambda: send.send(compute()))
    process.start()
    send.close()
    try:
        assert receive.poll(LONGEST)
        return receive.recv()
    finally:
        process.join()


def test_a_fork_leaves_the_compilers_of_its_parent_alone(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    x = ca.SX.sym("x")
    powers = range(3, 3 + (os.cpu_count() or 1))  # as many as may run
    begun = [
        codegen.start_compilation([ca.Function("value", [x], [x**k])], f"{k}")
        for k in powers
    ]
    assert compilation._running

    def compute():
        (another,) = codegen.start_compilation(
            [ca.Function("value", [x], [x - 1])], "another"
        )()
        (first,) = begun[0]()
        return [f.class_name() for f in (another, first)], float(first(2.0))

    assert forked(compute) == ([COMPILED] * 2, 8.0)
    assert [made()[0].class_name() for made in begun] == [COMPILED] * len(powers)
    assert not [*tmp_path.rglob("unfinished-*")]


def test_only_gcc_is_told_to_leave_out_its_passes(tmp_path, monkeypatch):
    for name in ("x86_64-linux-gnu-gcc-12", "clang-17"):
        (tmp_path / name).touch()
        (tmp_path / "cc").unlink(missing_ok=True)
        (tmp_path / "cc").symlink_to(tmp_path / name)
        monkeypatch.setattr(codegen, "compiler", lambda: str(tmp_path / "cc"))
        told = {*codegen._flags()}
        assert told >= {*codegen.FLAGS}
        assert ("gcc" in name) == (told >= {*codegen.UNUSED_PASSES})
        assert ("gcc" in name) == bool(told & {*codegen.UNUSED_PASSES})


def power(cache, k: int, deadline=NEVER):
    """Return a part of a term function of |z|^k, compiled if that is possible."""
    term = cache.of(lambda z: ca.sumsqr(z) ** (k / 2), [3], [("z", 3)], deadline)
    return term.part("second").class_name()


def test_an_interrupted_compilation_is_begun_again(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    cache = TermFunctionCache()
    with monkeypatch.context() as patch:

        def interrupted(*_):
            raise KeyboardInterrupt

        patch.setattr(compilation.Compilation, "_status", interrupted)
        with pytest.raises(KeyboardInterrupt):
            power(cache, 3)
    assert not compilation._running
    assert [power(cache, k) for k in (3, 5)] == [COMPILED, COMPILED]


def test_two_threads_wait_for_one_compilation(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    term = TermFunctionCache().of(lambda z: ca.sumsqr(z) ** 3.5, [3], [("z", 3)])
    with ThreadPoolExecutor(2) as pool:
        parts = list(pool.map(term.part, ["second"] * 2))
    assert [part.class_name() for part in parts] == [COMPILED] * 2


def test_what_a_short_limit_left_uncompiled_is_compiled_later(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    cache = TermFunctionCache()
    assert power(cache, 7, Deadline.within(0.1)) != COMPILED
    assert power(cache, 7) == COMPILED
