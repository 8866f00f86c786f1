"""Hear Ctrl-C while compiled code runs that would swallow it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt at the end if Ctrl-C was pressed inside.

    IPOPT stops at Ctrl-C, but reports no more than a failed solve (CasADi 3.8 turns the
    exception into a status), so that a loop over solves would go on.  Only the main
    thread hears signals: elsewhere, and where somebody else handles SIGINT already,
    nothing is changed.
    """
    main = threading.current_thread() is threading.main_thread()
    before = signal.getsignal(signal.SIGINT)
    if not main or before is not signal.default_int_handler:
        yield
        return
    heard = []

    def hear(number, frame):
        heard.append(number)
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, hear)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if heard:
        raise KeyboardInterrupt
