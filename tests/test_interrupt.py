"""Ctrl-C ends a solve, though compiled code would swallow it."""

import contextlib
import signal
import threading

import casadi as ca
import pytest

from tactilenlp.common.interrupt import interruptible
from tactilenlp.nlp.problem import Problem
from tactilenlp.solvers.options import SolverOptions
from tactilenlp.solvers.solve import Solvers, solve


@pytest.fixture(autouse=True)
def _ours():
    """Let Ctrl-C be what Python makes of it, as for a person at a terminal."""
    if threading.current_thread() is not threading.main_thread():
        pytest.skip("signals are heard in the main thread only")
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def _swallowed():
    """Press Ctrl-C and lose the exception, as CasADi does."""
    with contextlib.suppress(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    yield


def bowl():
    problem = Problem()
    x = problem.variable("x", 2, guess=1.0, unit="m", scale=1.0)
    problem.minimize("bowl", ca.sumsqr, x, role="likelihood")
    return problem


def test_a_solve_that_was_interrupted_does_not_come_back_with_a_status():
    problem = bowl()
    inner = Solvers(problem).solver_for(SolverOptions())

    class Deaf:
        """A solver in which somebody presses Ctrl-C."""

        def __call__(self, **given):
            with _swallowed():
                return inner(**given)

        def stats(self):
            return inner.stats()

    assert solve(problem).success
    with pytest.raises(KeyboardInterrupt):
        solve(problem, solver=Deaf())
    assert solve(problem).success


def test_whatever_compiled_code_makes_of_ctrl_c_it_is_ctrl_c_again():
    with pytest.raises(KeyboardInterrupt) as stop, interruptible(), _swallowed():
        raise SystemError("returned a result with an exception set")
    assert isinstance(stop.value.__cause__, SystemError)
    with pytest.raises(SystemError), interruptible():  # nobody pressed Ctrl-C
        raise SystemError("a defect")


def test_ctrl_c_that_was_lost_between_blocks_is_raised_by_the_next_one():
    done = []

    def work():
        with _swallowed():
            pass
        with interruptible():
            done.append("inner")
        done.append("outer")

    with pytest.raises(KeyboardInterrupt), interruptible():
        work()
    assert done == ["inner"]


def test_after_ctrl_c_the_rest_of_a_block_goes_on():
    with interruptible():
        for _ in range(2):
            with pytest.raises(KeyboardInterrupt), interruptible(), _swallowed():
                pass
        assert solve(bowl()).success


def test_who_handles_ctrl_c_already_goes_on_doing_so():
    heard = []
    signal.signal(signal.SIGINT, lambda number, frame: heard.append(number))
    with interruptible():
        signal.raise_signal(signal.SIGINT)
    assert heard == [signal.SIGINT]
    signal.signal(signal.SIGINT, signal.default_int_handler)


def test_another_thread_may_solve_as_well():
    found = []
    thread = threading.Thread(target=lambda: found.append(solve(bowl()).success))
    thread.start()
    thread.join()
    assert found == [True]
