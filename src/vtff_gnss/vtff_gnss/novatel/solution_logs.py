"""Ephemeris, position and time logs to dataclasses.

A `payload` is that of a binary log, a `message` is a message of novatel_edie. Field names differ
between the definitions of one log; both spellings are read.
"""

from __future__ import annotations

import math
import struct
from typing import Any

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss import constants as c
from vtff_gnss import fix as f
from vtff_gnss.ephemeris import (
    DEFAULT_FIT_INTERVAL,
    BroadcastEphemeris,
    GlonassEphemeris,
    galileo_accuracy,
)
from vtff_gnss.fix import Fix, ReceiverTime
from vtff_gnss.novatel.range.range_logs import GLONASS_CHANNEL_OFFSET
from vtff_gnss.orbits.lnav import SUBFRAME_LENGTH, decode_subframes

__all__ = [
    "fix_from_bestxyz",
    "fix_from_payload",
    "galileo_ephemeris",
    "glonass_ephemeris",
    "gps_ephemeris",
    "gps_ephemeris_from_subframes",
    "receiver_time",
    "receiver_time_from_payload",
]

_SixNumbers = tuple[float, float, float, float, float, float]

_NAN3 = (math.nan, math.nan, math.nan)
_SOLUTION_COMPUTED = 0
_CLOCK_MODEL_VALID = 0

# All definitions that NovAtel has published of these two logs have the same layout: for position
# and then velocity status, type, coordinates and their standard deviations; station; latency, two
# ages; satellites tracked and used. Status of the clock model, three offsets; UTC.
_BESTXYZ = struct.Struct("<II3d3fII3d3f4xf8xBB6x")
_TIME = struct.Struct("<I3d16x")
_NAMED_STATUSES = frozenset(range(26))
_NAMED_TYPES = frozenset(
    (*range(7), 8, *range(16, 21), *range(32, 36), *range(46, 60), *range(64, 83))
)
_NAMED_CLOCK_MODELS = frozenset(range(6))

# NovAtel "Position or Velocity Type" to STATUS_*; other types than these are STATUS_SINGLE.
_STATUS_BY_TYPE = {
    0: f.STATUS_NONE,
    17: f.STATUS_DIFFERENTIAL,  # PSRDIFF
    18: f.STATUS_DIFFERENTIAL,  # WAAS
    20: f.STATUS_DIFFERENTIAL,  # OMNISTAR
    32: f.STATUS_FLOAT,  # L1_FLOAT
    33: f.STATUS_FLOAT,  # IONOFREE_FLOAT
    34: f.STATUS_FLOAT,  # NARROW_FLOAT
    48: f.STATUS_FIXED,  # L1_INT
    49: f.STATUS_FIXED,  # WIDE_INT
    50: f.STATUS_FIXED,  # NARROW_INT
    52: f.STATUS_DIFFERENTIAL,  # INS_SBAS
    54: f.STATUS_DIFFERENTIAL,  # INS_PSRDIFF
    55: f.STATUS_FLOAT,  # INS_RTKFLOAT
    56: f.STATUS_FIXED,  # INS_RTKFIXED
    64: f.STATUS_DIFFERENTIAL,  # OMNISTAR_HP
    65: f.STATUS_DIFFERENTIAL,  # OMNISTAR_XP
    68: f.STATUS_FLOAT,  # PPP_CONVERGING
    69: f.STATUS_FLOAT,  # PPP
    73: f.STATUS_FLOAT,  # INS_PPP_CONVERGING
    74: f.STATUS_FLOAT,  # INS_PPP
    77: f.STATUS_FLOAT,  # PPP_BASIC_CONVERGING
    78: f.STATUS_FLOAT,  # PPP_BASIC
}


def gps_ephemeris(message: Any, time: GpsTime) -> BroadcastEphemeris:
    """Convert GPSEPHEM: angles in rad, semi-major axis in m, accuracy as a variance.

    The log has no fit-interval flag; 4 h is assumed.
    """
    return BroadcastEphemeris(
        time=time,
        system=c.SYSTEM_GPS,
        prn=_field(message, "satellite_id", "prn"),
        source=c.EPHEMERIS_SOURCE_LNAV,
        issue_of_data_ephemeris=message.iode1,
        issue_of_data_clock=message.iodc,
        health=_field(message, "health7", "health6"),
        gps_week=message.wn,
        semi_major_axis=message.a,
        group_delay=message.tgd,
        group_delay_secondary=0.0,
        accuracy=math.sqrt(message.eph_var) if message.eph_var >= 0.0 else math.nan,
        fit_interval=DEFAULT_FIT_INTERVAL,
        **_common_elements(message),
    )


def gps_ephemeris_from_subframes(payload: bytes, time: GpsTime) -> BroadcastEphemeris:
    """Convert the payload of RAWEPHEM: PRN, week, time of ephemeris, subframes 1 to 3.

    Raises
    ------
    vtff_gnss.orbits.lnav.SubframeError
        If the subframes do not belong together.
    """
    prn = int.from_bytes(payload[0:4], "little")
    starts = (12, 12 + SUBFRAME_LENGTH, 12 + 2 * SUBFRAME_LENGTH)
    first, second, third = (payload[start : start + SUBFRAME_LENGTH] for start in starts)
    return decode_subframes(prn, (first, second, third), time)


def galileo_ephemeris(message: Any, time: GpsTime) -> BroadcastEphemeris:
    """Convert GALINAVEPHEMERIS or GALFNAVEPHEMERIS of either definition.

    The logs have no week; the week that brings toe nearest to the header time is taken.
    """
    toe = float(message.toe)
    reference = GpsTime.from_week_tow(time.week, toe)
    week = time.week + round((time - reference) / 604800.0)
    has_root = hasattr(message, "root_a")
    sisa = message.sisa
    return BroadcastEphemeris(
        time=time,
        system=c.SYSTEM_GALILEO,
        prn=message.sat_id,
        source=c.EPHEMERIS_SOURCE_INAV
        if message.name == "GALINAVEPHEMERIS"
        else c.EPHEMERIS_SOURCE_FNAV,
        issue_of_data_ephemeris=message.io_dnav,
        issue_of_data_clock=message.io_dnav,
        health=_galileo_health(message),
        gps_week=week,
        semi_major_axis=message.root_a**2 if has_root else message.a,
        group_delay=message.e1_e5a_bgd,
        group_delay_secondary=getattr(message, "e1_e5b_bgd", 0.0),
        accuracy=galileo_accuracy(sisa) if has_root else sisa,
        fit_interval=DEFAULT_FIT_INTERVAL,
        **_common_elements(message),
    )


def glonass_ephemeris(message: Any, time: GpsTime) -> GlonassEphemeris:
    """Convert GLOEPHEMERIS; its reference time is in GPS time already."""
    return GlonassEphemeris(
        time=time,
        prn=message.sloto - 37,
        glonass_channel=message.freqo - GLONASS_CHANNEL_OFFSET,
        issue_of_data=message.issue,
        health=message.broadcast_health,
        time_of_ephemeris=GpsTime.from_week_tow(message.ephem_week, message.ephem_time / 1000.0),
        position=(message.pos_x, message.pos_y, message.pos_z),
        velocity=(message.vel_x, message.vel_y, message.vel_z),
        acceleration=(message.ls_acc_x, message.ls_acc_y, message.ls_acc_z),
        clock_offset=message.tau,
        relative_frequency_offset=message.gamma,
    )


def fix_from_bestxyz(message: Any, time: GpsTime) -> Fix:
    """Convert BESTXYZ; without a solution, position and velocity are NaN."""
    return _make_fix(
        time,
        (int(message.solution_status), int(message.position_type)),
        (message.x, message.y, message.z, message.x_std_dev, message.y_std_dev, message.z_std_dev),
        (
            int(_field(message, "status", "velocity_status")),
            int(_field(message, "type", "velocity_type")),
        ),
        (
            message.x_1, message.y_1, message.z_1,
            message.x_std_dev_1, message.y_std_dev_1, message.z_std_dev_1,
        ),
        (message.latency, message.num_svs, message.num_soln_svs),
    )  # fmt: skip


def fix_from_payload(payload: bytes, time: GpsTime) -> Fix | None:
    """Convert the payload of a binary BESTXYZ to what novatel_edie and `fix_from_bestxyz` make.

    Returns
    -------
    Fix or None
        None for another length, and for a status or a type without a name, which novatel_edie has
        to judge.
    """
    if len(payload) != _BESTXYZ.size:
        return None
    fields = _BESTXYZ.unpack(payload)
    is_named = fields[0] in _NAMED_STATUSES and fields[1] in _NAMED_TYPES
    if not is_named or fields[8] not in _NAMED_STATUSES or fields[9] not in _NAMED_TYPES:
        return None
    return _make_fix(time, fields[:2], fields[2:8], fields[8:10], fields[10:16], fields[16:])


def _make_fix(
    time: GpsTime,
    kind: tuple[int, int],
    position: _SixNumbers,
    velocity_kind: tuple[int, int],
    velocity: _SixNumbers,
    rest: tuple[float, int, int],
) -> Fix:
    """Return the fix of the fields of BESTXYZ.

    Parameters
    ----------
    kind, velocity_kind
        Solution status and type.
    position, velocity
        Three coordinates and their standard deviations, m and m/s.
    rest
        Latency of the velocity, s; satellites tracked and used.
    """
    solution_status, solution_type = kind
    velocity_status, velocity_type = velocity_kind
    is_computed = solution_status == _SOLUTION_COMPUTED
    status = _STATUS_BY_TYPE.get(solution_type, f.STATUS_SINGLE) if is_computed else f.STATUS_NONE
    has_position = status != f.STATUS_NONE
    has_velocity = has_position and velocity_status == _SOLUTION_COMPUTED and velocity_type != 0
    latency, satellites_tracked, satellites_used = rest
    return Fix(
        time=time,
        status=status,
        receiver_solution_type=solution_type,
        position=position[:3] if has_position else _NAN3,
        velocity=velocity[:3] if has_velocity else _NAN3,
        position_sigma=position[3:] if has_position else _NAN3,
        velocity_sigma=velocity[3:] if has_velocity else _NAN3,
        velocity_latency=latency,
        satellites_tracked=satellites_tracked,
        satellites_used=satellites_used,
        clock_offset=math.nan,
        clock_offset_sigma=math.nan,
    )


def receiver_time(message: Any, time: GpsTime) -> ReceiverTime:
    """Convert TIME."""
    return ReceiverTime(
        time=time,
        is_valid=int(message.clock_model_status) == _CLOCK_MODEL_VALID,
        clock_offset=message.offset,
        clock_offset_sigma=message.offset_std,
        utc_offset=message.utc_offset,
    )


def receiver_time_from_payload(payload: bytes, time: GpsTime) -> ReceiverTime | None:
    """Convert the payload of a binary TIME to what novatel_edie and `receiver_time` make.

    Returns
    -------
    ReceiverTime or None
        None for another length, and for a clock model without a name, which novatel_edie has to
        judge.
    """
    if len(payload) != _TIME.size:
        return None
    clock_model, offset, offset_sigma, utc_offset = _TIME.unpack(payload)
    if clock_model not in _NAMED_CLOCK_MODELS:
        return None
    return ReceiverTime(time, clock_model == _CLOCK_MODEL_VALID, offset, offset_sigma, utc_offset)


def _common_elements(message: Any) -> dict[str, float]:
    """Return the elements that GPSEPHEM and the Galileo logs name alike."""
    return {
        "toe": float(message.toe),
        "toc": float(message.toc),
        "af0": message.af0,
        "af1": message.af1,
        "af2": message.af2,
        "eccentricity": message.ecc,
        "inclination": message.i0,
        "inclination_rate": message.i_dot,
        "longitude_of_ascending_node": message.omega0,
        "right_ascension_rate": message.omega_dot,
        "argument_of_perigee": message.omega,
        "mean_anomaly": message.m0,
        "mean_motion_difference": message.delta_n,
        "cuc": message.cuc,
        "cus": message.cus,
        "crc": message.crc,
        "crs": message.crs,
        "cic": message.cic,
        "cis": message.cis,
    }


def _galileo_health(message: Any) -> int:
    """Return health and data-validity bits at their places in RINEX 3 (table A8)."""
    if hasattr(message, "health"):
        return int(message.health)
    return int(
        (getattr(message, "e5b_health", 0) & 3) << 7
        | (getattr(message, "e5b_dvs", 0) & 1) << 6
        | (getattr(message, "e5a_health", 0) & 3) << 4
        | (getattr(message, "e5a_dvs", 0) & 1) << 3
        | (getattr(message, "e1b_health", 0) & 3) << 1
        | (getattr(message, "e1b_dvs", 0) & 1)
    )


def _field(message: Any, *names: str) -> Any:
    """Return the first field that the definition of the message has."""
    for name in names:
        if hasattr(message, name):
            return getattr(message, name)
    raise ValueError(f"{message.name}: no field {' or '.join(names)}")
