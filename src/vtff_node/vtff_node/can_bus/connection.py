"""A CAN bus that may go away: it is opened at first use and opened again after it has failed."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable

import can

from vtff_node.can_bus.loopback import LoopbackCanBus

__all__ = ["FIRST_RETRY", "BusConnection", "open_bus"]

FIRST_RETRY = 0.1  # s from a loss of the bus to the first attempt to open it again
LONGEST_RETRY = 2.0  # s, bound of the doubling pause between attempts

_BUS_ERRORS = (can.CanError, OSError)


def open_bus(interface: str, channel: str, port: int = 0) -> can.BusABC:
    """Open a CAN bus.

    Parameters
    ----------
    interface
        Interface of python-can: virtual (within a process), socketcan, that of an adapter, or
        udp_multicast, which reaches the programs of this machine only.
    channel
        Name of the bus: any text, vcan0, or an address of a multicast group.
    port
        UDP port of udp_multicast, 0 for its default; of no meaning otherwise.

    Raises
    ------
    can.CanError or OSError
        If it cannot be opened; `can.CanInterfaceNotImplementedError` if it never can.
    """
    if interface == "udp_multicast":
        return LoopbackCanBus(channel, port)
    return can.Bus(channel, interface)


class BusConnection:
    """A bus. Nothing is raised when it fails: it is closed and opened again.

    One thread may receive while another one sends.

    Parameters
    ----------
    open_bus
        Called without arguments to open the bus.
    clock
        Monotonic seconds of wall time.

    Attributes
    ----------
    problem
        Why the bus is not there, one line; empty if it is.
    errors
        Times that the bus failed or could not be opened.
    """

    def __init__(
        self, open_bus: Callable[[], can.BusABC], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.problem = ""
        self.errors = 0
        self._open_bus = open_bus
        self._clock = clock
        self._bus: can.BusABC | None = None
        self._lock = threading.Lock()  # of opening and losing, never held while frames are awaited
        self._retry_at = -float("inf")
        self._retry_pause = FIRST_RETRY

    def connect(self) -> bool:
        """Open the bus if it is not open and the next attempt is due; return whether it is open.

        Raises
        ------
        can.CanInterfaceNotImplementedError
            If the interface does not exist: no later attempt can help.
        """
        return self._opened() is not None

    def _opened(self) -> can.BusABC | None:
        with self._lock:
            if self._bus is None and self._clock() >= self._retry_at:
                try:
                    self._bus = self._open_bus()
                except can.CanInterfaceNotImplementedError:
                    raise
                except _BUS_ERRORS as error:
                    self._note(error)
                else:
                    self.problem = ""
                    self._retry_pause = FIRST_RETRY
            return self._bus

    def send(self, frames: Iterable[can.Message], timeout: float) -> None:
        """Send frames; each waits at most `timeout` seconds of wall time for the bus."""
        bus = self._opened()
        if bus is None:
            return
        try:
            for frame in frames:
                bus.send(frame, timeout=timeout)
        except _BUS_ERRORS as error:
            self._lose(bus, error)

    def receive(self, timeout: float) -> can.Message | None:
        """Return the next frame, waiting for it up to `timeout` seconds of wall time."""
        bus = self._opened()
        if bus is None:
            return None
        try:
            return bus.recv(timeout)
        except _BUS_ERRORS as error:
            self._lose(bus, error)
        except ValueError:  # the descriptor of a bus that the sending thread has closed meanwhile
            if self._bus is bus:
                raise
        return None

    def close(self) -> None:
        """Close the bus."""
        with self._lock:
            bus, self._bus = self._bus, None
        if bus is not None:
            bus.shutdown()

    def _note(self, error: Exception) -> None:
        self.errors += 1
        self.problem = str(error) or type(error).__name__
        self._retry_at = self._clock() + self._retry_pause
        self._retry_pause = min(2.0 * self._retry_pause, LONGEST_RETRY)

    def _lose(self, bus: can.BusABC, error: Exception) -> None:
        with self._lock:
            if bus is not self._bus:  # the other thread has lost it already
                return
            self._bus = None
            self._note(error)
        try:
            bus.shutdown()
        except _BUS_ERRORS as close_error:
            self.problem += f"; closing it failed too: {close_error}"
