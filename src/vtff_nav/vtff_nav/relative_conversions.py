"""Conversion between solutions and measurements of the relative filters and their messages."""

from __future__ import annotations

import array
import math
from typing import Any

import numpy as np
import numpy.typing as npt

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
    # Many integers were fixed at one epoch, whose time is one object.
    times = {id(time): time for time in table.fixed_since}
    seconds = {name: _unix_seconds(time) for name, time in times.items()}
    message = AmbiguityStatus(
        ratio=solution.ratio,
        success_rate=solution.success_rate,
        child_frame_id=deputy,
        system=_content(table.system, np.uint8),
        prn=_content(table.prn, np.uint8),
        band=_content(table.band, np.uint8),
        attribute=_content(table.attribute, np.uint8),
        reference_prn=_content(table.reference_prn, np.uint8),
        ambiguity_cycles=_content(table.ambiguity_cycles, np.float64),
        ambiguity_sigma_cycles=_content(table.ambiguity_sigma_cycles, np.float32),
        state=_content(table.state, np.uint8),
        fixed_since=[seconds[id(time)] for time in table.fixed_since],
    )
    _set_header(message, solution, chief)
    return message


def differential_tec_to_message(solution: RelativeSolution, chief: str, deputy: str) -> SlantTec:
    """Return the message of the differential TEC of a solution.

    Columns without a value for a difference (TEC from code, vertical TEC, pierce points) are NaN.
    """
    table = solution.differential_tec
    count = len(table)
    unknown = array.array("f", (math.nan,)) * count
    message = SlantTec(
        child_frame_id=deputy,
        system=_content(table.system, np.uint8),
        prn=_content(table.prn, np.uint8),
        band_first=_content(table.band_first, np.uint8),
        band_second=_content(table.band_second, np.uint8),
        stec_tecu=_content(table.stec_tecu, np.float64),
        stec_sigma_tecu=_content(table.stec_sigma_tecu, np.float32),
        stec_code_tecu=array.array("d", (math.nan,)) * count,
        vtec_tecu=unknown,
        elevation=_content(table.elevation, np.float32),
        azimuth=_content(table.azimuth, np.float32),
        pierce_latitude_deg=unknown,
        pierce_longitude_deg=unknown,
        arc=_content(table.arc, np.uint32),
        rejected=array.array("H", (0,)) * count,
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


def _set_header(message: Any, solution: RelativeSolution, chief: str) -> None:
    message.header.stamp = to_stamp(solution.time.to_unix_nanoseconds())
    message.header.frame_id = f"{chief}/rtn"


def _content(values: npt.ArrayLike, kind: type[np.generic]) -> bytes:
    """Return a column as bytes, of which a message makes an array of its own."""
    return np.asarray(values, dtype=kind).tobytes()


def _unix_seconds(time: GpsTime | None) -> float:
    return 0.0 if time is None else time.to_unix_nanoseconds() / NANOSECONDS_PER_SECOND
