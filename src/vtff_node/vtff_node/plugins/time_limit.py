"""A limit on the wall time of a call, kept by an alarm signal."""

from __future__ import annotations

import math
import signal
import threading
import time

__all__ = ["TimeLimitReachedError", "time_limit"]


#: Time between two looks whether SIGALRM still has the own handler, s: a look takes as long as a
#: third of a controller.
LOOK_INTERVAL = 1.0


class TimeLimitReachedError(BaseException):
    """Raised inside a call that lasts too long; no ``except Exception`` of a plug-in stops it."""


class time_limit:  # noqa: N801 - used as `with time_limit(...)`, like contextlib.suppress
    """Raise `TimeLimitReachedError` in the body once it lasts longer than a limit, s.

    Only the main thread gets signals; elsewhere nothing is raised. The handler of SIGALRM stays:
    to set it for each call would take a fifth of the time of a controller. Where other code has
    taken it, it is set again after `LOOK_INTERVAL`.
    """

    __slots__ = ("_limit",)

    #: Whether a body runs in the main thread, whose time is limited.
    is_running = False
    #: When the handler is looked at again, s of the monotonic clock.
    next_look = -math.inf

    def __init__(self, limit: float) -> None:
        self._limit = limit

    def __enter__(self) -> None:
        """Set the alarm."""
        if threading.get_ident() == threading.main_thread().ident:
            now = time.monotonic()
            if now >= time_limit.next_look:
                time_limit.next_look = now + LOOK_INTERVAL
                if signal.getsignal(signal.SIGALRM) is not _interrupt:
                    signal.signal(signal.SIGALRM, _interrupt)
            time_limit.is_running = True
            signal.setitimer(signal.ITIMER_REAL, self._limit)

    def __exit__(self, *_: object) -> None:
        """Take the alarm back."""
        if threading.get_ident() == threading.main_thread().ident:
            time_limit.is_running = False
            signal.setitimer(signal.ITIMER_REAL, 0.0)


def _interrupt(*_: object) -> None:
    if time_limit.is_running:
        raise TimeLimitReachedError
