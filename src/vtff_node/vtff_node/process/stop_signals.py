"""Signals that ask a process to end: SIGINT, SIGTERM, and SIGHUP of a closed terminal."""

from __future__ import annotations

import signal
from collections.abc import Callable
from types import FrameType

__all__ = ["StopRequest", "handle_stop_signals"]

#: `vtff run` starts its processes with these blocked, until they can be handled.
_HELD_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class StopRequest:
    """A request to end, made by a signal.

    The handlers replace those of rclpy, which would invalidate the publishers before the nodes are
    closed.
    """

    def __init__(self) -> None:
        # No lock guards it, such as that of an Event: a second signal may interrupt a handler.
        self._requested = False

    def install(self) -> None:
        """Install the handlers; only the main thread of a process may do that."""
        handle_stop_signals(self._request)

    def _request(self) -> None:
        self._requested = True

    @property
    def requested(self) -> bool:
        """Whether a signal has asked for the end."""
        return self._requested


def handle_stop_signals(request_stop: Callable[[], object]) -> None:
    """Call a function at each signal that asks for the end; only for the main thread of a process.

    A SIGHUP that is ignored, as under nohup, stays ignored.
    """

    def handle(number: int, frame: FrameType | None) -> None:
        request_stop()

    for number in _HELD_SIGNALS:
        signal.signal(number, handle)
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        signal.signal(signal.SIGHUP, handle)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _HELD_SIGNALS)
