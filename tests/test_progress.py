"""A bar tells who waits at a terminal; pipes, files and the impatient see nothing."""

import io

import pytest

from tactilenlp.common import progress as module
from tactilenlp.common.progress import progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def clock(monkeypatch):
    """A clock that a test sets."""
    now = [0.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    return now


def walk(clock, steps, seconds, stream, **options):
    """Take steps that last so many seconds each; return them."""
    taken = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module.sys, "stderr", stream)
        for step in progress(steps, "solving", **options):
            taken.append(step)
            clock[0] += seconds
    return taken


def test_steps_pass_unchanged_and_short_work_is_silent(clock):
    terminal = Terminal()
    assert walk(clock, range(10), 0.1, terminal) == list(range(10))
    assert terminal.getvalue() == ""


def test_long_work_draws_a_bar_and_wipes_it(clock):
    terminal = Terminal()
    walk(clock, range(10), 1.0, terminal)
    said = terminal.getvalue()
    assert "solving [" in said
    assert "5/10, 5 s left" in said
    assert said.endswith("\r\033[K")


def test_a_file_gets_no_progress_bar(clock):
    file = io.StringIO()
    walk(clock, range(10), 1.0, file)
    assert file.getvalue() == ""


def test_an_unknown_number_of_steps_is_counted(clock):
    terminal = Terminal()
    walk(clock, iter(range(5)), 1.0, terminal)
    assert "4 in 4 s" in terminal.getvalue()
    walk(clock, iter(range(5)), 1.0, terminal, total=5)
    assert "4/5" in terminal.getvalue()


def test_the_line_is_clean_after_ctrl_c(clock, monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr(module.sys, "stderr", terminal)
    with pytest.raises(KeyboardInterrupt):  # noqa: PT012 (the loop is what is tested)
        for step in progress(range(10), "solving"):
            clock[0] += 1.0
            if step == 6:
                raise KeyboardInterrupt
    assert terminal.getvalue().count("\n") == 0


def test_a_terminal_that_has_gone_does_not_end_the_work(clock):
    gone = Terminal()
    gone.close()
    assert walk(clock, range(10), 1.0, gone) == list(range(10))

    class Lost(Terminal):
        def write(self, line):
            raise OSError(5, "Input/output error")

    for stream in (Lost(), None):
        assert walk(clock, range(10), 1.0, stream) == list(range(10))


def test_a_search_and_an_exploration_draw_bars(monkeypatch):
    from tactilenlp import Options, World, explore

    terminal, quick = Terminal(), Options(hypotheses=2, starts=2)
    monkeypatch.setattr(module.sys, "stderr", terminal)
    monkeypatch.setattr(module, "FIRST_DELAY", -1.0)  # as if it took long
    lean = {"formulation": "quasi_static", "options": quick}
    world = World((0.05, 0.04, 0.03))
    for _ in explore(world, actions=1, centre=(0, 0), policy="random", **lean):
        assert terminal.getvalue().endswith(module.ERASE_LINE)  # the user may write now
    assert "search [" in terminal.getvalue()
    assert "explore [" in terminal.getvalue()
