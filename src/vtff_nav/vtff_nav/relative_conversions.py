"""Conversion between solutions and measurements of the relative filters and their messages."""

from __future__ import annotations

import math

import numpy as np

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_msgs.msg import AmbiguityStatus, LaserRange, RelativeState, SlantTec
from vtff_nav.relative.common.solution import LaserMeasurement, RelativeSolution
from vtff_node.conversions.gnss import column_to_array
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
        system=column_to_array("B", table.system),
        prn=column_to_array("B", table.prn),
        band=column_to_array("B", table.band),
        attribute=column_to_array("B", table.attribute),
        reference_prn=column_to_array("B", table.reference_prn),
        ambiguity_cycles=column_to_array("d", table.ambiguity_cycles),
        ambiguity_sigma_cycles=column_to_array("f", table.ambiguity_sigma_cycles),
        state=column_to_array("B", table.state),
        fixed_since=column_to_array("d", [_unix_seconds(time) for time in table.fixed_since]),
        ratio=solution.ratio,
        success_rate=solution.success_rate,
        child_frame_id=deputy,
    )
    _set_header(message, solution, chief)
    return message


def differential_tec_to_message(solution: RelativeSolution, chief: str, deputy: str) -> SlantTec:
    """Return the message of the differential TEC of a solution.

    Columns without a value for a difference (TEC from code, vertical TEC, pierce points) are NaN.
    """
    table = solution.differential_tec
    unknown = np.full(len(table), math.nan)
    message = SlantTec(
        child_frame_id=deputy,
        system=column_to_array("B", table.system),
        prn=column_to_array("B", table.prn),
        band_first=column_to_array("B", table.band_first),
        band_second=column_to_array("B", table.band_second),
        stec_tecu=column_to_array("d", table.stec_tecu),
        stec_sigma_tecu=column_to_array("f", table.stec_sigma_tecu),
        stec_code_tecu=column_to_array("d", unknown),
        vtec_tecu=column_to_array("f", unknown),
        elevation=column_to_array("f", table.elevation),
        azimuth=column_to_array("f", table.azimuth),
        pierce_latitude_deg=column_to_array("f", unknown),
        pierce_longitude_deg=column_to_array("f", unknown),
        arc=column_to_array("I", table.arc),
        rejected=column_to_array("H", np.zeros(len(table))),
    )
    _set_header(message, solution, chief)
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


def _set_header(
    message: RelativeState | AmbiguityStatus | SlantTec, solution: RelativeSolution, chief: str
) -> None:
    message.header.stamp = to_stamp(solution.time.to_unix_nanoseconds())
    message.header.frame_id = f"{chief}/rtn"


def _unix_seconds(time: GpsTime | None) -> float:
    """Return a time in Unix time, s; 0 for None."""
    return 0.0 if time is None else time.to_unix_nanoseconds() / NANOSECONDS_PER_SECOND
