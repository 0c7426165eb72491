"""Broadcast ephemerides to GPSEPHEM, RAWEPHEM, GALINAVEPHEMERIS and GALFNAVEPHEMERIS.

Source: OEM7 Commands and Logs Reference Manual. The header of these logs has the time at which
the broadcast data were received, with the time status SATTIME.
"""

from __future__ import annotations

import math
import struct

from vtff_gnss import constants as c
from vtff_gnss.ephemeris import BroadcastEphemeris, galileo_accuracy
from vtff_gnss.novatel import message_ids as ids
from vtff_gnss.novatel.encode.frame import TIME_STATUS_SATELLITE, HeaderSettings, encode_frame
from vtff_gnss.novatel.encode.lnav import LnavMessage, encode_subframes

__all__ = ["encode_galileo_ephemeris", "encode_gpsephem", "encode_rawephem"]

_GPSEPHEM = struct.Struct("<Id5I16dI5dI2d")
_RAWEPHEM = struct.Struct("<III30s30s30s")
_INAV_HEAD = struct.Struct("<IBBxxBBxxHBBII")
_FNAV_HEAD = struct.Struct("<IBBxxHBxII")
_NO_SISA = 255
_INAV_SIGNALS_E1B_E5B = 3


def encode_gpsephem(
    ephemeris: BroadcastEphemeris, settings: HeaderSettings, receiver_status: int = 0
) -> bytes:
    """Return a GPS ephemeris as a GPSEPHEM log: nothing is rounded, angles in rad.

    Raises
    ------
    ValueError
        If it is not of GPS LNAV, or its time is not a whole millisecond.
    """
    e = _of_source(ephemeris, c.SYSTEM_GPS, c.EPHEMERIS_SOURCE_LNAV)
    gravitation = c.GRAVITATIONAL_PARAMETER_BROADCAST[c.SYSTEM_GPS]
    mean_motion = math.sqrt(gravitation / e.semi_major_axis**3) + e.mean_motion_difference
    payload = _GPSEPHEM.pack(
        e.prn, e.time.time_of_week, e.health,
        e.issue_of_data_ephemeris, e.issue_of_data_ephemeris, e.gps_week, e.time.week,
        e.toe, e.semi_major_axis, e.mean_motion_difference, e.mean_anomaly, e.eccentricity,
        e.argument_of_perigee, e.cuc, e.cus, e.crc, e.crs, e.cic, e.cis,
        e.inclination, e.inclination_rate,
        e.longitude_of_ascending_node, e.right_ascension_rate,
        e.issue_of_data_clock, e.toc, e.group_delay, e.af0, e.af1, e.af2,
        True, mean_motion, e.accuracy**2,
    )  # fmt: skip
    return _frame(ids.ID_GPSEPHEM, payload, e, settings, receiver_status)


def encode_rawephem(
    ephemeris: BroadcastEphemeris,
    settings: HeaderSettings,
    receiver_status: int = 0,
    message: LnavMessage | None = None,
) -> bytes:
    """Return a GPS ephemeris as a RAWEPHEM log, rounded as in the broadcast message.

    Raises
    ------
    ValueError
        See `vtff_gnss.novatel.encode.lnav.encode_subframes`.
    """
    subframes = encode_subframes(ephemeris, message or LnavMessage())
    payload = _RAWEPHEM.pack(ephemeris.prn, ephemeris.gps_week, int(ephemeris.toe), *subframes)
    return _frame(ids.ID_RAWEPHEM, payload, ephemeris, settings, receiver_status)


def encode_galileo_ephemeris(
    ephemeris: BroadcastEphemeris, settings: HeaderSettings, receiver_status: int = 0
) -> bytes:
    """Return a Galileo ephemeris as GALINAVEPHEMERIS or GALFNAVEPHEMERIS, as its source says.

    The logs hold the square root of the semi-major axis, whole seconds and, instead of the
    accuracy, the SISA index; the accuracy is rounded up to the next index.

    Raises
    ------
    ValueError
        If it is neither I/NAV nor F/NAV of Galileo, or its time is not a whole millisecond.
    """
    is_inav = ephemeris.source == c.EPHEMERIS_SOURCE_INAV
    source = c.EPHEMERIS_SOURCE_INAV if is_inav else c.EPHEMERIS_SOURCE_FNAV
    e = _of_source(ephemeris, c.SYSTEM_GALILEO, source)
    sisa = _sisa_index(e.accuracy)
    e5b = (e.health >> 7 & 3, e.health >> 6 & 1)
    e5a = (e.health >> 4 & 3, e.health >> 3 & 1)
    e1b = (e.health >> 1 & 3, e.health & 1)
    times = (int(e.toe), int(e.toc))
    delays: tuple[float, ...] = (e.group_delay,)
    if is_inav:
        head = _INAV_HEAD.pack(
            e.prn, *e5b, *e1b, e.issue_of_data_ephemeris, sisa, _INAV_SIGNALS_E1B_E5B, *times
        )  # fmt: skip
        delays = (e.group_delay, e.group_delay_secondary)
    else:
        head = _FNAV_HEAD.pack(e.prn, *e5a, e.issue_of_data_ephemeris, sisa, *times)
    elements = (
        e.mean_anomaly, e.mean_motion_difference, e.eccentricity, math.sqrt(e.semi_major_axis),
        e.inclination, e.inclination_rate,
        e.longitude_of_ascending_node, e.argument_of_perigee, e.right_ascension_rate,
        e.cuc, e.cus, e.crc, e.crs, e.cic, e.cis, e.af0, e.af1, e.af2, *delays,
    )  # fmt: skip
    payload = head + struct.pack(f"<{len(elements)}d", *elements)
    message_id = ids.ID_GALINAVEPHEMERIS if is_inav else ids.ID_GALFNAVEPHEMERIS
    return _frame(message_id, payload, e, settings, receiver_status)


def _of_source(ephemeris: BroadcastEphemeris, system: int, source: int) -> BroadcastEphemeris:
    if (ephemeris.system, ephemeris.source) != (system, source):
        raise ValueError(
            f"ephemeris: system {ephemeris.system}, source {ephemeris.source}; "
            f"{system}, {source} are required"
        )
    return ephemeris


def _sisa_index(accuracy: float) -> int:
    for index in range(126):
        if accuracy <= galileo_accuracy(index) + 1e-9:
            return index
    return _NO_SISA


def _frame(
    message_id: int,
    payload: bytes,
    ephemeris: BroadcastEphemeris,
    settings: HeaderSettings,
    receiver_status: int,
) -> bytes:
    return encode_frame(
        message_id, payload, ephemeris.time, settings, TIME_STATUS_SATELLITE, receiver_status
    )
