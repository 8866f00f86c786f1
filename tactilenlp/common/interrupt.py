"""Ctrl-C while compiled code runs that loses the exception."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


class _Listener:
    """A handler of SIGINT that raises KeyboardInterrupt and records that it did."""

    def __init__(self):
        self.received = False

    def __call__(self, number, frame):
        self.received = True
        raise KeyboardInterrupt


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt at the end if Ctrl-C was pressed inside.

    Compiled code loses the exception: IPOPT stops and reports a failed solve (CasADi
    3.8), so that a loop over solves would continue; reading a number from a CasADi
    matrix turns it into SystemError; a callback may drop it.  At the end of this block,
    nested ones included, it is raised again.

    Only the main thread receives signals: in other threads, and where another handler
    of SIGINT is installed, nothing is changed.
    """
    main = threading.current_thread() is threading.main_thread()
    before = signal.getsignal(signal.SIGINT)
    within = isinstance(before, _Listener)
    if not main or not (within or before is signal.default_int_handler):
        yield
        return
    listener = before if within else _Listener()
    signal.signal(signal.SIGINT, listener)
    try:
        yield
    except KeyboardInterrupt:
        listener.received = False  # it propagates already
        raise
    except Exception as error:
        if listener.received:
            listener.received = False
            raise KeyboardInterrupt from error
        raise
    finally:
        signal.signal(signal.SIGINT, before)
    if listener.received:
        listener.received = False
        raise KeyboardInterrupt
