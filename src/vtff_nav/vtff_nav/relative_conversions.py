"""Conversion between solutions and measurements of the relative filters and their messages."""

from __future__ import annotations

import array
import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from std_msgs.msg import Header

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_msgs.msg import AmbiguityStatus, LaserRange, RelativeState, SlantTec
from vtff_nav.relative.common.solution import LaserMeasurement, RelativeSolution
from vtff_node.message_bytes import message_of_fields
from vtff_node.stamps import to_nanoseconds, to_stamp

__all__ = [
    "ambiguities_to_message",
    "differential_tec_to_message",
    "laser_from_message",
    "relative_state_to_message",
]


_ARRAYS_KEPT = 64
#: Arrays of messages by kind and identity of what they were made of, which is kept too.
_known_arrays: dict[tuple[str, int], tuple[Any, array.array[Any]]] = {}


def relative_state_to_message(solution: RelativeSolution, chief: str, deputy: str) -> RelativeState:
    """Return the message of a solution; `chief` and `deputy` are the names of the spacecraft."""
    message: RelativeState = message_of_fields(
        RelativeState,
        header=_header(solution, chief),
        child_frame_id=deputy,
        position=np.array(solution.position_rtn, dtype=np.float64),
        velocity=np.array(solution.velocity_rtn, dtype=np.float64),
        covariance=np.array(solution.covariance_rtn, dtype=np.float64).reshape(36),
        position_chief_gcrf=np.array(solution.position_chief_gcrf, dtype=np.float64),
        velocity_chief_gcrf=np.array(solution.velocity_chief_gcrf, dtype=np.float64),
        solution=solution.solution,
        satellites_used=solution.satellites_used,
        ambiguities_fixed=solution.ambiguities_fixed,
        ratio=solution.ratio,
        innovation_rms=solution.innovation_rms,
        age=solution.age,
    )
    return message


def ambiguities_to_message(solution: RelativeSolution, chief: str, deputy: str) -> AmbiguityStatus:
    """Return the message of the ambiguities of a solution."""
    table = solution.ambiguities
    message: AmbiguityStatus = message_of_fields(
        AmbiguityStatus,
        header=_header(solution, chief),
        system=_column(table.system, np.uint8),
        prn=_column(table.prn, np.uint8),
        band=_column(table.band, np.uint8),
        attribute=_column(table.attribute, np.uint8),
        reference_prn=_column(table.reference_prn, np.uint8),
        ambiguity_cycles=_column(table.ambiguity_cycles, np.float64),
        ambiguity_sigma_cycles=_column(table.ambiguity_sigma_cycles, np.float32),
        state=_column(table.state, np.uint8),
        fixed_since=_kept(tuple(table.fixed_since), "times", _seconds),
        ratio=solution.ratio,
        success_rate=solution.success_rate,
        child_frame_id=deputy,
    )
    return message


def differential_tec_to_message(solution: RelativeSolution, chief: str, deputy: str) -> SlantTec:
    """Return the message of the differential TEC of a solution.

    Columns without a value for a difference (TEC from code, vertical TEC, pierce points) are NaN.
    """
    table = solution.differential_tec
    count = len(table)
    message: SlantTec = message_of_fields(
        SlantTec,
        header=_header(solution, chief),
        child_frame_id=deputy,
        system=_column(table.system, np.uint8),
        prn=_column(table.prn, np.uint8),
        band_first=_column(table.band_first, np.uint8),
        band_second=_column(table.band_second, np.uint8),
        stec_tecu=_column(table.stec_tecu, np.float64),
        stec_sigma_tecu=_column(table.stec_sigma_tecu, np.float32),
        stec_code_tecu=_filled("d", math.nan, count),
        vtec_tecu=_filled("f", math.nan, count),
        elevation=_column(table.elevation, np.float32),
        azimuth=_column(table.azimuth, np.float32),
        pierce_latitude_deg=_filled("f", math.nan, count),
        pierce_longitude_deg=_filled("f", math.nan, count),
        arc=_column(table.arc, np.uint32),
        rejected=_filled("H", 0, count),
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


def _header(solution: RelativeSolution, chief: str) -> Any:
    """Return the header of the messages of a solution."""
    stamp = to_stamp(solution.time.to_unix_nanoseconds())
    return message_of_fields(Header, stamp=stamp, frame_id=f"{chief}/rtn")


def _column(values: npt.ArrayLike, kind: type[np.generic]) -> array.array[Any]:
    """Return numbers as an array of a message.

    Columns that nothing can be written to are those of many solutions: their array is made once.
    Others look into memory that is not their own.
    """
    if isinstance(values, np.ndarray) and values.base is None and not values.flags.writeable:
        return _kept(values, kind.__name__, lambda column: _array(column, kind))
    return _array(values, kind)


def _array(values: npt.ArrayLike, kind: type[np.generic]) -> array.array[Any]:
    column = np.asarray(values, dtype=kind)
    return array.array(column.dtype.char, column.tobytes())


def _kept(values: Any, kind: str, convert: Callable[[Any], array.array[Any]]) -> array.array[Any]:
    """Return the array of values that do not change; the same one for the same object."""
    known = _known_arrays.get((kind, id(values)))
    if known is None or known[0] is not values:
        if len(_known_arrays) >= _ARRAYS_KEPT:
            _known_arrays.clear()
        known = _known_arrays[kind, id(values)] = values, convert(values)
    return known[1]


@functools.lru_cache(maxsize=_ARRAYS_KEPT)
def _filled(code: str, value: float, count: int) -> array.array[Any]:
    """Return an array of equal numbers."""
    return array.array(code, (value,)) * count


def _seconds(times: Sequence[GpsTime | None]) -> array.array[Any]:
    """Return times in Unix time, s; 0 for None."""
    return array.array("d", [_unix_seconds(time) for time in times])


def _unix_seconds(time: GpsTime | None) -> float:
    return 0.0 if time is None else time.to_unix_nanoseconds() / NANOSECONDS_PER_SECOND
