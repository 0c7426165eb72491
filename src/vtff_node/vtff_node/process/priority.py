"""Priority of a process among the other work of its machine."""

from __future__ import annotations

import contextlib
import os
import pathlib

__all__ = ["set_niceness"]

_TASKS = pathlib.Path("/proc/self/task")
# Linux shares the processor among sessions first (sched_autogroup): the niceness of a process
# counts within its own only.
_SESSION = pathlib.Path("/proc/self/autogroup")


def set_niceness(niceness: int) -> bool:
    """Give all threads of this process a niceness; return whether the system permits it.

    Threads that begin later inherit it. So does the session of a process that leads one, as those
    of a run do. Less than the present one needs the right to it: a limit
    `RLIMIT_NICE` or `CAP_SYS_NICE`.

    Parameters
    ----------
    niceness : int
        -20, the first to run, to 19.
    """
    try:
        threads = [int(task.name) for task in _TASKS.iterdir()]
    except OSError:
        threads = [0]
    for thread in threads:
        try:
            os.setpriority(os.PRIO_PROCESS, thread, niceness)
        except ProcessLookupError:
            continue  # it has ended meanwhile
        except PermissionError:
            return False
    if os.getsid(0) == os.getpid() and _SESSION.exists():
        with contextlib.suppress(OSError):
            _SESSION.write_text(f"{niceness}", encoding="ascii")
    return True
