"""Fixes, receiver time, ionosphere model and version to BESTXYZ, TIME, IONUTC and VERSION.

Source: OEM7 Commands and Logs Reference Manual.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

from vtff_dynamics.time.timescales import GpsTime, leap_seconds
from vtff_gnss import fix as f
from vtff_gnss.fix import Fix, ReceiverTime
from vtff_gnss.novatel import message_ids as ids
from vtff_gnss.novatel.encode.frame import (
    ID_IONUTC,
    TIME_STATUS_FINE_STEERING,
    HeaderSettings,
    encode_frame,
)

__all__ = [
    "ComponentVersion",
    "IonosphereUtc",
    "encode_bestxyz",
    "encode_ionutc",
    "encode_receiver_time",
    "encode_version",
]

_BESTXYZ = struct.Struct("<II3d3fII3d3f4s3f8B")
_TIME = struct.Struct("<I3dI4BII")
_IONUTC = struct.Struct("<8dII2dIIiiI")
_VERSION = struct.Struct("<I16s16s16s16s16s12s12s")

_SOLUTION_COMPUTED, _INSUFFICIENT_OBSERVATIONS = 0, 1
_TYPE_NONE, _TYPE_DOPPLER_VELOCITY = 0, 8
_CLOCK_VALID, _CLOCK_INVALID = 0, 3
_UTC_VALID = 1
_BASE_STATION = b"AAAA"
_MASK_GPS_L1_L2 = 0x03
_GPS_EPOCH = datetime(1980, 1, 6)


@dataclass(frozen=True)
class IonosphereUtc:
    """Klobuchar coefficients and UTC parameters (IS-GPS-200, 20.3.3.5.1.6 and .7).

    Parameters
    ----------
    alpha, beta : tuple of 4 float
        s and s per semicircle^k.
    reference_week, reference_time_of_week : int
        WNt (full week) and tot, s.
    utc_a0, utc_a1 : float
        s, s/s.
    leap_seconds, leap_seconds_future : int
        s.
    leap_second_week, leap_second_day : int
        WN_LSF (full week) and DN.
    """

    alpha: tuple[float, float, float, float]
    beta: tuple[float, float, float, float]
    reference_week: int
    reference_time_of_week: int
    utc_a0: float
    utc_a1: float
    leap_seconds: int
    leap_seconds_future: int
    leap_second_week: int
    leap_second_day: int

    @classmethod
    def at(
        cls,
        time: GpsTime,
        alpha: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
        beta: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
    ) -> IonosphereUtc:
        """Return parameters for the week of `time`: exact UTC, no leap second ahead."""
        seconds = leap_seconds(time)
        return cls(alpha, beta, time.week, 0, 0.0, 0.0, seconds, seconds, time.week, 7)


@dataclass(frozen=True)
class ComponentVersion:
    """One component of the VERSION log; `component_type` 1 is the receiver card."""

    component_type: int = 1
    model: str = "EMULATED"
    serial_number: str = "VTFF00000000"
    hardware_version: str = "OEM628-EMULATED"
    software_version: str = "EMULATED"
    boot_version: str = "EMULATED"
    compile_date: str = "2016/Mar/21"
    compile_time: str = "01:00:00"


def encode_bestxyz(
    fix: Fix,
    settings: HeaderSettings,
    time_status: int = TIME_STATUS_FINE_STEERING,
    receiver_status: int = 0,
    galileo_beidou_mask: int = 0,
    gps_glonass_mask: int = _MASK_GPS_L1_L2,
) -> bytes:
    """Return a fix as a BESTXYZ log; its clock offset stands in the TIME log.

    A fix with `STATUS_NONE` becomes INSUFFICIENT_OBS with zeros, a NaN velocity likewise.

    Raises
    ------
    ValueError
        If the time is not a whole millisecond.
    """
    has_position = fix.status != f.STATUS_NONE
    has_velocity = has_position and not math.isnan(fix.velocity[0])
    zeros = (0.0, 0.0, 0.0)
    payload = _BESTXYZ.pack(
        _SOLUTION_COMPUTED if has_position else _INSUFFICIENT_OBSERVATIONS,
        fix.receiver_solution_type if has_position else _TYPE_NONE,
        *(fix.position if has_position else zeros),
        *(fix.position_sigma if has_position else zeros),
        _SOLUTION_COMPUTED if has_velocity else _INSUFFICIENT_OBSERVATIONS,
        _TYPE_DOPPLER_VELOCITY if has_velocity else _TYPE_NONE,
        *(fix.velocity if has_velocity else zeros),
        *(fix.velocity_sigma if has_velocity else zeros),
        _BASE_STATION, fix.velocity_latency, 0.0, 0.0,
        fix.satellites_tracked, fix.satellites_used, fix.satellites_used, 0, 0, 0,
        galileo_beidou_mask, gps_glonass_mask,
    )  # fmt: skip
    return encode_frame(ids.ID_BESTXYZ, payload, fix.time, settings, time_status, receiver_status)


def encode_receiver_time(
    receiver_time: ReceiverTime,
    settings: HeaderSettings,
    time_status: int = TIME_STATUS_FINE_STEERING,
    receiver_status: int = 0,
) -> bytes:
    """Return the receiver's estimate of its clock as a TIME log.

    Raises
    ------
    ValueError
        If the time is not a whole millisecond.
    """
    time = receiver_time.time
    utc_nanoseconds = time.nanoseconds + round(
        (receiver_time.utc_offset - receiver_time.clock_offset) * 1e9
    )
    utc = _GPS_EPOCH + timedelta(milliseconds=round(utc_nanoseconds * 1e-6))
    payload = _TIME.pack(
        _CLOCK_VALID if receiver_time.is_valid else _CLOCK_INVALID,
        receiver_time.clock_offset, receiver_time.clock_offset_sigma, receiver_time.utc_offset,
        utc.year, utc.month, utc.day, utc.hour, utc.minute,
        utc.second * 1000 + utc.microsecond // 1000, _UTC_VALID,
    )  # fmt: skip
    return encode_frame(ids.ID_TIME, payload, time, settings, time_status, receiver_status)


def encode_ionutc(
    parameters: IonosphereUtc,
    time: GpsTime,
    settings: HeaderSettings,
    time_status: int = TIME_STATUS_FINE_STEERING,
    receiver_status: int = 0,
) -> bytes:
    """Return ionosphere and UTC parameters as an IONUTC log.

    Raises
    ------
    ValueError
        If the time is not a whole millisecond.
    """
    p = parameters
    payload = _IONUTC.pack(
        *p.alpha, *p.beta, p.reference_week, p.reference_time_of_week, p.utc_a0, p.utc_a1,
        p.leap_second_week, p.leap_second_day, p.leap_seconds, p.leap_seconds_future, 0,
    )  # fmt: skip
    return encode_frame(ID_IONUTC, payload, time, settings, time_status, receiver_status)


def encode_version(
    components: Sequence[ComponentVersion],
    time: GpsTime | None,
    settings: HeaderSettings,
    time_status: int = TIME_STATUS_FINE_STEERING,
    receiver_status: int = 0,
) -> bytes:
    """Return the versions of the receiver's components as a VERSION log.

    Raises
    ------
    ValueError
        If a text is not ASCII or too long for its field, or the time is not a whole millisecond.
    """
    payload = struct.pack("<I", len(components))
    for component in components:
        texts = [
            _text(component, name, length)
            for name, length in (
                ("model", 16), ("serial_number", 16), ("hardware_version", 16),
                ("software_version", 16), ("boot_version", 16),
                ("compile_date", 12), ("compile_time", 12),
            )
        ]  # fmt: skip
        payload += _VERSION.pack(component.component_type, *texts)
    return encode_frame(ids.ID_VERSION, payload, time, settings, time_status, receiver_status)


def _text(component: ComponentVersion, name: str, length: int) -> bytes:
    text: str = getattr(component, name)
    # The field ends with a zero byte.
    if not text.isascii() or len(text) >= length:
        raise ValueError(f"{name}: {text!r} is not ASCII of at most {length - 1} characters")
    return text.encode("ascii")
