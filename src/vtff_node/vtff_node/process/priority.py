"""Priority of a process among the other work of its machine."""

from __future__ import annotations

import contextlib
import os
import pathlib

__all__ = ["is_niceness_chosen", "run_at_once", "set_niceness", "yield_to_others"]

_TASKS = pathlib.Path("/proc/self/task")
# Linux shares the processor among sessions first (sched_autogroup): the niceness of a process
# counts within its own only.
_SESSION = pathlib.Path("/proc/self/autogroup")


def is_niceness_chosen() -> bool:
    """Return whether this process was begun with a niceness of its own, by `nice` for example."""
    return os.getpriority(os.PRIO_PROCESS, 0) != 0


def set_niceness(niceness: int) -> bool:
    """Give all threads of this process a niceness; return whether the system permits it.

    Threads that begin later inherit it. A process that leads a session, as each process of a run
    does, gives it to the session too. A niceness below the present one needs the limit
    `RLIMIT_NICE` or the capability `CAP_SYS_NICE`.

    Parameters
    ----------
    niceness : int
        -20, the first to run, to 19.
    """
    for thread in _find_threads():
        try:
            os.setpriority(os.PRIO_PROCESS, thread, niceness)
        except ProcessLookupError:
            continue  # it has ended meanwhile
        except OSError:  # no right to it, or a sandbox without the call
            return False
    if os.getsid(0) == os.getpid():
        with contextlib.suppress(OSError):  # a kernel without sched_autogroup has no such file
            _SESSION.write_text(f"{niceness}", encoding="ascii")
    return True


def run_at_once() -> bool:
    """Let all threads of this process run as soon as they wake; return whether that is permitted.

    By default a thread may wait for milliseconds behind another one while a core is idle. With the
    policy SCHED_RR it runs on any core that does nothing more urgent. Threads that begin later
    inherit the policy. It needs the limit `RLIMIT_RTPRIO` or the capability `CAP_SYS_NICE`; the
    system keeps a share of the processor for other work (`sched_rt_runtime_us`). A policy that the
    user has chosen (chrt) stays.
    """
    if not hasattr(os, "sched_setscheduler"):  # not Linux
        return False
    for thread in _find_threads():
        try:
            if os.sched_getscheduler(thread) == os.SCHED_OTHER:
                priority = os.sched_get_priority_min(os.SCHED_RR)
                os.sched_setscheduler(thread, os.SCHED_RR, os.sched_param(priority))
        except ProcessLookupError:
            continue  # it has ended meanwhile
        except OSError:  # no right to it, or a sandbox without the call
            return False
    return True


def yield_to_others() -> None:
    """Let no thread of this process interrupt another process when it wakes, where that exists.

    By default the scheduler of Linux stops what runs on a core to run a thread that has just got a
    message. With the policy SCHED_BATCH the thread gets its share of the processor when the other
    one waits or has had its own share. Threads that begin later inherit the policy. One that the
    user has chosen (chrt) stays.
    """
    if not hasattr(os, "sched_setscheduler"):  # not Linux
        return
    for thread in _find_threads():
        with contextlib.suppress(OSError):  # it has ended meanwhile, or a sandbox without the call
            if os.sched_getscheduler(thread) == os.SCHED_OTHER:
                os.sched_setscheduler(thread, os.SCHED_BATCH, os.sched_param(0))


def _find_threads() -> list[int]:
    try:
        return [int(task.name) for task in _TASKS.iterdir()]
    except OSError:
        return [0]
