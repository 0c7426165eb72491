"""The last act of a process: it leaves at once, without taking the interpreter apart."""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import os
import sys
import time
from typing import NoReturn

__all__ = ["leave_process", "leave_process_after"]

#: Notification of a POSIX timer by a call in a thread of its own (`signal.h`).
_SIGEV_THREAD = 2


class _TimerNotification(ctypes.Structure):
    """Structure `sigevent` of POSIX, as Linux has it: 64 bytes."""

    _fields_ = (
        ("value", ctypes.c_size_t),
        ("signal_number", ctypes.c_int),
        ("kind", ctypes.c_int),
        ("function", ctypes.c_void_p),
        ("attributes", ctypes.c_void_p),
        ("_rest", ctypes.c_byte * 32),
    )


class _TimerSetting(ctypes.Structure):
    """Structure `itimerspec` of POSIX."""

    _fields_ = (
        ("interval_seconds", ctypes.c_long),
        ("interval_nanoseconds", ctypes.c_long),
        ("seconds", ctypes.c_long),
        ("nanoseconds", ctypes.c_long),
    )


def leave_process(exit_code: int) -> NoReturn:
    """Run the exit functions, write what is still to be printed, and end the process.

    The interpreter would take 0.1 to 0.4 s of processor to free every object of a node with its
    compiled code, and the teardown of libraries has been seen to spin. Whoever calls this has
    closed its files, nodes and connections.

    Parameters
    ----------
    exit_code
        Exit code of the process.
    """
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):  # the reader is gone, or the stream closed
            stream.flush()
    os._exit(exit_code)


def leave_process_after(delay: float, exit_code: int) -> None:
    """End the process with an exit code after a delay, even where the interpreter lock is held.

    A timer of Python or its signal handler would wait for the interpreter lock, and
    `faulthandler.dump_traceback_later` ends a process with code 1 only. The C library calls
    ``_exit(exit_code)`` itself, from a POSIX timer (`timer_create`, `SIGEV_THREAD`).

    Parameters
    ----------
    delay
        Time until the end, s; more than zero.
    exit_code
        Exit code of the process.

    Raises
    ------
    OSError
        The system gives no timer.
    """
    library = ctypes.CDLL(None, use_errno=True)
    leave = ctypes.cast(library._exit, ctypes.c_void_p)
    notification = _TimerNotification(
        value=exit_code, kind=_SIGEV_THREAD, function=leave.value, attributes=None
    )
    timer = ctypes.c_void_p()
    seconds, fraction = divmod(delay, 1.0)
    setting = _TimerSetting(seconds=int(seconds), nanoseconds=int(1e9 * fraction))
    if library.timer_create(
        time.CLOCK_MONOTONIC, ctypes.byref(notification), ctypes.byref(timer)
    ) or library.timer_settime(timer, 0, ctypes.byref(setting), None):
        error = ctypes.get_errno()
        raise OSError(error, os.strerror(error))
