"""A limit on the wall time of a call, kept by an alarm signal."""

from __future__ import annotations

import atexit
import math
import signal
import threading
import time

__all__ = ["TimeLimitReachedError", "time_limit"]


#: Longest time between two looks at the handler of SIGALRM and the alarm, s: a look takes as long
#: as a third of a controller.
LOOK_INTERVAL = 1.0


class TimeLimitReachedError(BaseException):
    """Raised inside a call that lasts too long; no ``except Exception`` of a plug-in stops it."""


class time_limit:  # noqa: N801 - used as `with time_limit(...)`, like contextlib.suppress
    """Raise `TimeLimitReachedError` in the body once it lasts longer than a limit, s.

    Only the main thread gets signals; elsewhere nothing is raised. The handler of SIGALRM and the
    alarm stay from one call to the next: to set both for each call would take a fifth of the time
    of a controller. Where other code has taken them, they are set again after `LOOK_INTERVAL`.
    """

    __slots__ = ("_limit",)

    #: When the body of the main thread has to be left, s of the monotonic clock; inf without one.
    deadline = math.inf
    #: When the alarm is due, s of the monotonic clock.
    alarm_time = -math.inf
    #: When handler and alarm are looked at again, s of the monotonic clock.
    next_look = -math.inf

    def __init__(self, limit: float) -> None:
        self._limit = limit

    def __enter__(self) -> None:
        """Have an alarm come no later than the limit."""
        if threading.get_ident() == threading.main_thread().ident:
            now = time.monotonic()
            time_limit.deadline = deadline = now + self._limit
            if now >= time_limit.next_look or not now < time_limit.alarm_time <= deadline:
                time_limit.next_look = now + LOOK_INTERVAL
                if signal.getsignal(signal.SIGALRM) is not _interrupt:
                    signal.signal(signal.SIGALRM, _interrupt)
                    # Python gives SIGALRM its own meaning back at its end: to end the process.
                    atexit.unregister(_take_alarm_back)
                    atexit.register(_take_alarm_back)
                _set_alarm(now, self._limit)

    def __exit__(self, *_: object) -> None:
        """Let the alarm mean nothing from now on."""
        if threading.get_ident() == threading.main_thread().ident:
            time_limit.deadline = math.inf


def _set_alarm(now: float, wait: float) -> None:
    """Have the alarm come after a time, s, from now, s of the monotonic clock."""
    time_limit.alarm_time = now + wait
    signal.setitimer(signal.ITIMER_REAL, wait)


def _take_alarm_back() -> None:
    signal.setitimer(signal.ITIMER_REAL, 0.0)


def _interrupt(*_: object) -> None:
    """Raise an error in a body that lasts too long; the alarm may be that of an earlier body."""
    if time_limit.deadline < math.inf:
        now = time.monotonic()
        if now >= time_limit.deadline:
            raise TimeLimitReachedError
        _set_alarm(now, time_limit.deadline - now)
