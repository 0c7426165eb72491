"""A limit on the wall time of a call, kept by an alarm signal."""

from __future__ import annotations

import atexit
import math
import signal
import threading
import time

__all__ = ["TimeLimitReachedError", "time_limit"]


#: Longest time between two looks at the handler of SIGALRM, s: a look takes as long
#: as a third of a controller.
LOOK_INTERVAL = 1.0


class TimeLimitReachedError(BaseException):
    """Raised inside a call that lasts too long; no ``except Exception`` of a plug-in stops it."""


class time_limit:  # noqa: N801 - used as `with time_limit(...)`, like contextlib.suppress
    """Raise `TimeLimitReachedError` in the body once it lasts longer than a limit, s.

    Only the main thread gets signals; elsewhere nothing is raised. The handler of SIGALRM and the
    alarm stay from one call to the next: to set both for each call would take a fifth of the time
    of a controller. An alarm that other code has taken is set again by the next call, a handler
    after `LOOK_INTERVAL`.
    """

    __slots__ = ("_limit",)

    #: When the body of the main thread has to be left, s of the monotonic clock; inf without one.
    deadline = math.inf
    #: When the handler is looked at again, s of the monotonic clock.
    next_look = -math.inf

    def __init__(self, limit: float) -> None:
        self._limit = limit

    def __enter__(self) -> None:
        """Have an alarm come no later than the limit."""
        if threading.get_ident() == threading.main_thread().ident:
            now = time.monotonic()
            time_limit.deadline = now + self._limit
            # The alarm of an earlier body serves too; a body may have taken it away.
            left = signal.getitimer(signal.ITIMER_REAL)[0]
            if now >= time_limit.next_look or not 0.0 < left <= self._limit:
                time_limit.next_look = now + LOOK_INTERVAL
                if signal.getsignal(signal.SIGALRM) is not _interrupt:
                    signal.signal(signal.SIGALRM, _interrupt)
                    # Python gives SIGALRM its own meaning back at its end: to end the process.
                    atexit.unregister(_take_alarm_back)
                    atexit.register(_take_alarm_back)
                signal.setitimer(signal.ITIMER_REAL, self._limit)

    def __exit__(self, *_: object) -> None:
        """Let the alarm mean nothing from now on."""
        if threading.get_ident() == threading.main_thread().ident:
            time_limit.deadline = math.inf


def _take_alarm_back() -> None:
    signal.setitimer(signal.ITIMER_REAL, 0.0)


def _interrupt(*_: object) -> None:
    """Raise an error in a body that lasts too long; the alarm may be that of an earlier body."""
    if time_limit.deadline < math.inf:
        left = time_limit.deadline - time.monotonic()
        if left <= 0.0:
            time_limit.deadline = math.inf
            raise TimeLimitReachedError
        signal.setitimer(signal.ITIMER_REAL, left)
