"""Linear algebra on one thread: matrices here are small, and idle threads cost time."""

from __future__ import annotations

from functools import wraps

from threadpoolctl import threadpool_limits


def on_one_thread(function):
    """Return the function with BLAS limited to one thread while it runs.

    On a busy machine of two cores, reading an estimate takes a fourth of the time then.
    The limit is one of the process, as BLAS knows no other; it is lifted at the end.
    """

    @wraps(function)
    def limited(*arguments, **given):
        with threadpool_limits(limits=1, user_api="blas"):
            return function(*arguments, **given)

    return limited
