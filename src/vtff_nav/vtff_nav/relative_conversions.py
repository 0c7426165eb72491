"""Conversion between solutions and measurements of the relative filters and their messages."""

from __future__ import annotations

import array
from collections.abc import Mapping
from typing import Any

import numpy as np

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_msgs.msg import AmbiguityStatus, LaserRange, RelativeState, SlantTec
from vtff_nav.relative.common.solution import LaserMeasurement, RelativeSolution
from vtff_node.stamps import to_nanoseconds, to_stamp

__all__ = [
    "ambiguities_to_message",
    "differential_tec_to_message",
    "laser_from_message",
    "relative_state_to_message",
]


def relative_state_to_message(solution: RelativeSolution, chief: str, deputy: str) -> RelativeState:
    """Return the message of a solution; `chief` and `deputy` are the names of the spacecraft."""
    message = RelativeState(
        child_frame_id=deputy,
        position=solution.position_rtn,
        velocity=solution.velocity_rtn,
        covariance=solution.covariance_rtn.ravel(),
        position_chief_gcrf=solution.position_chief_gcrf,
        velocity_chief_gcrf=solution.velocity_chief_gcrf,
        solution=solution.solution,
        satellites_used=solution.satellites_used,
        ambiguities_fixed=solution.ambiguities_fixed,
        ratio=solution.ratio,
        innovation_rms=solution.innovation_rms,
        age=solution.age,
    )
    _set_header(message, solution, chief)
    return message


def ambiguities_to_message(solution: RelativeSolution, chief: str, deputy: str) -> AmbiguityStatus:
    """Return the message of the ambiguities of a solution."""
    table = solution.ambiguities
    message = AmbiguityStatus(
        ratio=solution.ratio, success_rate=solution.success_rate, child_frame_id=deputy
    )
    _set_header(message, solution, chief)
    _set_columns(
        message,
        {
            "system": (table.system, np.uint8),
            "prn": (table.prn, np.uint8),
            "band": (table.band, np.uint8),
            "attribute": (table.attribute, np.uint8),
            "reference_prn": (table.reference_prn, np.uint8),
            "ambiguity_cycles": (table.ambiguity_cycles, np.float64),
            "ambiguity_sigma_cycles": (table.ambiguity_sigma_cycles, np.float32),
            "state": (table.state, np.uint8),
            "fixed_since": ([_unix_seconds(time) for time in table.fixed_since], np.float64),
        },
    )
    return message


def differential_tec_to_message(solution: RelativeSolution, chief: str, deputy: str) -> SlantTec:
    """Return the message of the differential TEC of a solution.

    Columns without a value for a difference (TEC from code, vertical TEC, pierce points) are NaN.
    """
    table = solution.differential_tec
    not_a_number = np.full(len(table), np.nan)
    message = SlantTec(child_frame_id=deputy)
    _set_header(message, solution, chief)
    _set_columns(
        message,
        {
            "system": (table.system, np.uint8),
            "prn": (table.prn, np.uint8),
            "band_first": (table.band_first, np.uint8),
            "band_second": (table.band_second, np.uint8),
            "stec_tecu": (table.stec_tecu, np.float64),
            "stec_sigma_tecu": (table.stec_sigma_tecu, np.float32),
            "stec_code_tecu": (not_a_number, np.float64),
            "vtec_tecu": (not_a_number, np.float32),
            "elevation": (table.elevation, np.float32),
            "azimuth": (table.azimuth, np.float32),
            "pierce_latitude_deg": (not_a_number, np.float32),
            "pierce_longitude_deg": (not_a_number, np.float32),
            "arc": (table.arc, np.uint32),
            "rejected": (np.zeros(len(table)), np.uint16),
        },
    )
    return message


def laser_from_message(message: LaserRange) -> LaserMeasurement | None:
    """Return the measurement of a message; None without an echo."""
    if not (message.valid and np.isfinite(message.range)):
        return None
    return LaserMeasurement(
        time=GpsTime.from_unix_nanoseconds(to_nanoseconds(message.header.stamp)),
        range=message.range,
        range_sigma=message.range_sigma,
    )


def _set_header(message: Any, solution: RelativeSolution, chief: str) -> None:
    message.header.stamp = to_stamp(solution.time.to_unix_nanoseconds())
    message.header.frame_id = f"{chief}/rtn"


def _set_columns(message: Any, columns: Mapping[str, tuple[Any, type[np.generic]]]) -> None:
    for name, (values, kind) in columns.items():
        column = np.asarray(values).astype(kind)
        setattr(message, name, array.array(column.dtype.char, column.tobytes()))


def _unix_seconds(time: GpsTime | None) -> float:
    return 0.0 if time is None else time.to_unix_nanoseconds() / NANOSECONDS_PER_SECOND
