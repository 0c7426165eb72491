"""Levels of diagnostics, and a diagnostic_msgs/DiagnosticStatus built in one call."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

__all__ = ["ERROR", "OK", "STALE", "WARN", "DiagnosticStatus", "status"]

OK = DiagnosticStatus.OK
WARN = DiagnosticStatus.WARN
ERROR = DiagnosticStatus.ERROR
STALE = DiagnosticStatus.STALE


def status(
    name: str,
    level: bytes,
    message: str,
    values: Mapping[str, Any] | None = None,
    hardware_id: str = "",
) -> DiagnosticStatus:
    """Build a status.

    Parameters
    ----------
    name
        Subject of the report, ``<node>: <subject>`` as REP-107 asks.
    level
        `OK`, `WARN`, `ERROR` or `STALE`.
    message
        One line for the operator.
    values
        Numbers and texts shown beside the message.
    hardware_id
        Serial number or port of the device, empty for software.
    """
    return DiagnosticStatus(
        name=name,
        level=level,
        message=message,
        hardware_id=hardware_id,
        values=[KeyValue(key=key, value=str(value)) for key, value in (values or {}).items()],
    )
