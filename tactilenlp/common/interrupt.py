"""Hear Ctrl-C while compiled code runs that would swallow it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


class _Listener:
    """A handler of SIGINT that raises KeyboardInterrupt and remembers that it did."""

    def __init__(self):
        self.heard = False

    def __call__(self, number, frame):
        self.heard = True
        raise KeyboardInterrupt


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise KeyboardInterrupt at the end if Ctrl-C was pressed inside.

    Compiled code loses the exception: IPOPT stops and reports no more than a failed
    solve (CasADi 3.8), so that a loop over solves would go on; reading a number out of
    a CasADi matrix turns it into SystemError; a callback may drop it.  Whatever comes
    of it inside, here it is Ctrl-C again, also of blocks within blocks.

    Only the main thread hears signals: elsewhere, and where somebody else handles
    SIGINT already, nothing is changed.
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
        listener.heard = False  # it is on its way
        raise
    except Exception as error:
        if listener.heard:
            listener.heard = False
            raise KeyboardInterrupt from error
        raise
    finally:
        signal.signal(signal.SIGINT, before)
    if listener.heard:
        listener.heard = False
        raise KeyboardInterrupt
