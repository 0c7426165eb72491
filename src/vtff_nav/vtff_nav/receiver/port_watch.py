"""Wakes the owner of a live port when bytes can be read."""

from __future__ import annotations

import contextlib
import os
import select
import threading
from collections.abc import Callable

__all__ = ["PortWatch"]


class PortWatch:
    """Thread that waits until a descriptor is readable.

    ROS executors cannot wait for a descriptor, and a timer with a sufficiently short period costs
    more than the reading itself. After each call of `on_readable` the watch rests until `arm`.

    Parameters
    ----------
    on_readable : callable
        Called in the thread of the watch; it must only wake another thread.
    """

    def __init__(self, on_readable: Callable[[], None]) -> None:
        self._on_readable = on_readable
        self._descriptor: int | None = None
        self._epoll = select.epoll()
        self._end_receiver, self._end_sender = os.pipe()
        self._epoll.register(self._end_receiver, select.EPOLLIN)
        self._thread = threading.Thread(target=self._run, name="port watch", daemon=True)
        self._thread.start()

    def watch(self, descriptor: int | None) -> None:
        """Watch another descriptor, or none; call this before the watched descriptor is closed."""
        if self._descriptor is not None:
            with contextlib.suppress(OSError):
                self._epoll.unregister(self._descriptor)
        self._descriptor = descriptor
        if descriptor is not None:
            self._epoll.register(descriptor, select.EPOLLIN | select.EPOLLONESHOT)

    def arm(self) -> None:
        """Call `on_readable` when the descriptor is readable the next time."""
        if self._descriptor is not None:
            self._epoll.modify(self._descriptor, select.EPOLLIN | select.EPOLLONESHOT)

    def close(self) -> None:
        """End the thread; a second call does nothing."""
        if not self._thread.is_alive():
            return
        os.write(self._end_sender, b"\0")
        self._thread.join()
        self._epoll.close()
        os.close(self._end_receiver)
        os.close(self._end_sender)

    def _run(self) -> None:
        while True:
            for descriptor, _ in self._epoll.poll():
                if descriptor == self._end_receiver:
                    return
                self._on_readable()
