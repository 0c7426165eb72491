"""Ports of this machine that no program uses, for the emulators of a run."""

from __future__ import annotations

import contextlib
import pathlib
import random
import socket
from collections.abc import Collection

__all__ = ["choose_free_port"]

#: Ports above those that Linux gives to sockets by default and below the last one.
_UPPER_PORTS = range(61000, 65535)
_ATTEMPTS = 200


def choose_free_port(taken: Collection[int] = ()) -> int:
    """Return a port of this machine on which no program has a TCP or UDP socket.

    The port is not one of those that the system gives to sockets without a port of their own: each
    process of a run opens a dozen of these, and may do so before the program for which the port is
    chosen has opened it.

    Parameters
    ----------
    taken
        Ports that are chosen for other programs of the run.
    """
    automatic = _automatic_ports()
    candidates = [port for port in _UPPER_PORTS if port not in automatic]
    # Chance of the system, not of the seed of a run: runs must differ.
    for port in random.sample(candidates, min(_ATTEMPTS, len(candidates))):
        if port not in taken and _is_free(port):
            return port
    while (port := _port_of_the_system()) in taken or not _is_free(port):
        pass
    return port


def _automatic_ports() -> range:
    """Return the ports that the system gives to sockets without a port of their own."""
    path = pathlib.Path("/proc/sys/net/ipv4/ip_local_port_range")
    try:
        first, last = map(int, path.read_text(encoding="ascii").split())
    except (OSError, ValueError):
        return range(0)
    return range(first, last + 1)


def _is_free(port: int) -> bool:
    with contextlib.ExitStack() as opened:
        for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM):
            probe = opened.enter_context(socket.socket(socket.AF_INET, kind))
            try:
                probe.bind(("", port))
            except OSError:
                return False
    return True


def _port_of_the_system() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
