"""Linear algebra of an estimate runs on one thread, and on as many as before after."""

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController, threadpool_limits

from tactilenlp.common.threads import on_one_thread


def threads() -> set[int]:
    """Return how many threads the BLAS libraries of this process use."""
    np.linalg.inv(np.eye(2))
    pools = ThreadpoolController().select(user_api="blas").info()
    return {pool["num_threads"] for pool in pools}


@pytest.fixture
def two():
    """BLAS on two threads, as by default on a machine with two cores."""
    with threadpool_limits(limits=2, user_api="blas"):
        if threads() != {2}:
            pytest.skip(f"BLAS here cannot use two threads: {threads()}")
        yield


def test_one_thread_while_it_runs_and_as_many_as_before_after(two):
    assert on_one_thread(threads)() == {1}
    assert threads() == {2}


def test_the_limit_is_lifted_after_an_error(two):
    with pytest.raises(ZeroDivisionError):
        on_one_thread(lambda: 1 / 0)()
    assert threads() == {2}


def test_an_estimate_is_solved_and_read_on_one_thread(two, recorded, monkeypatch):
    from tactilenlp import solve_estimate
    from tactilenlp.estimation import solver

    seen = []
    read = solver.read_off

    def watched(*given):
        seen.append(threads())
        return read(*given)

    monkeypatch.setattr(solver, "read_off", watched)
    solve_estimate(recorded[0].select([0]), recorded[1])
    assert seen == [{1}]
    assert threads() == {2}
