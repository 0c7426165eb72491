"""What the nodes of devices on a CAN bus share: parameters, first opening, diagnostics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import can

from vtff_node import diagnostics
from vtff_node.can_bus.connection import open_bus
from vtff_node.parameters import REQUIRED, ParameterError, parameter

__all__ = ["CanBusParameters", "bus_status", "connect_first", "read_database"]


@dataclass(frozen=True)
class CanBusParameters:
    """Parameters of a node whose device is on a CAN bus; tables of such nodes inherit them."""

    dbc_file: str = parameter(REQUIRED, "DBC file with the frames of the device")
    interface: str = parameter(
        "udp_multicast", "interface of python-can: virtual, socketcan, udp_multicast, ..."
    )
    channel: str = parameter(REQUIRED, "bus of that interface, as can0 or a multicast group")
    port: int = parameter(0, "UDP port of udp_multicast, 0 = its default", minimum=0, maximum=65535)

    @property
    def bus_name(self) -> str:
        """Name of the bus for the user."""
        return f"{self.interface} {self.channel}"

    def open_bus(self) -> can.BusABC:
        """Open the bus; raises as `vtff_node.can_bus.connection.open_bus`."""
        return open_bus(self.interface, self.channel, self.port)


def read_database(read: Callable[[str], Any], dbc_file: str) -> Any:
    """Return what a function makes of a DBC file.

    Raises
    ------
    ParameterError
        If the function raises a ValueError; the text names the parameter.
    """
    try:
        return read(dbc_file)
    except ValueError as error:
        raise ParameterError(f"parameter 'dbc_file': {error}") from error


def connect_first(connect: Callable[[], object]) -> None:
    """Open the bus for the first time; a bus that is not there now is opened later.

    Raises
    ------
    ParameterError
        If python-can has no such interface.
    """
    try:
        connect()
    except can.CanInterfaceNotImplementedError as error:
        raise ParameterError(f"parameter 'interface': {error}") from error


def bus_status(
    subject: str,
    bus: CanBusParameters,
    problem: str,
    state: tuple[bytes, str],
    values: Mapping[str, Any],
) -> diagnostics.DiagnosticStatus:
    """Return the status of a bus.

    Parameters
    ----------
    subject
        Name of the status.
    bus
        Names the bus.
    problem
        Why the bus is not there; empty if it is.
    state
        Level and text for a bus that is there.
    values
        Counts and texts beside it.
    """
    level, text = (diagnostics.ERROR, f"no bus: {problem}") if problem else state
    return diagnostics.status(subject, level, text, values, hardware_id=bus.bus_name)
