"""A limit on the wall time of a call, kept by an alarm signal."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator

__all__ = ["TimeLimitReachedError", "time_limit"]


class TimeLimitReachedError(BaseException):
    """Raised inside a call that lasts too long; no ``except Exception`` of a plug-in stops it."""


@contextlib.contextmanager
def time_limit(limit: float) -> Iterator[None]:
    """Raise `TimeLimitReachedError` in the body once it lasts longer than a limit, s.

    Only the main thread gets signals; elsewhere nothing is raised.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    is_running = True

    def interrupt(*_: object) -> None:
        if is_running:
            raise TimeLimitReachedError

    previous = signal.signal(signal.SIGALRM, interrupt)
    try:
        signal.setitimer(signal.ITIMER_REAL, limit)
        yield
    finally:
        is_running = False
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, previous)
