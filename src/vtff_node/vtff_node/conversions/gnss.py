"""Conversions between the observations, ephemerides, fixes and logs of vtff_gnss and messages."""

from __future__ import annotations

import array
import dataclasses
import math
from typing import Any

import numpy as np
import numpy.typing as npt

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.ephemeris import BroadcastEphemeris, GlonassEphemeris
from vtff_gnss.fix import Fix
from vtff_gnss.novatel import IsmScintillation, IsmSlantTec, RawLog
from vtff_gnss.observations import OBSERVATION_COLUMNS, ObservationEpoch
from vtff_msgs.msg import GlonassEphemeris as GlonassEphemerisMessage
from vtff_msgs.msg import (
    GnssEphemeris,
    GnssFix,
    GnssObservations,
    ReceiverLog,
    Scintillation,
    SlantTec,
)
from vtff_node.stamps import to_nanoseconds, to_stamp

#: Frame of ephemerides and solutions: Earth-fixed, ITRF or WGS 84.
EARTH_FRAME = "earth"

#: Interval of the reduced logs of a GPStation-6, s, and the rate of the samples in them.
ISM_WINDOW = 60.0
ISM_SAMPLE_RATE_HZ = 50.0

#: Fields that have the same name in the dataclass and in the message.
_EPHEMERIS_FIELDS = tuple(
    field.name for field in dataclasses.fields(BroadcastEphemeris) if field.name != "time"
)
_GLONASS_FIELDS = tuple(
    field.name
    for field in dataclasses.fields(GlonassEphemeris)
    if field.name not in ("time", "time_of_ephemeris")
)
_FIX_FIELDS = tuple(field.name for field in dataclasses.fields(Fix) if field.name != "time")
_VECTOR_FIELDS = ("position", "velocity", "position_sigma", "velocity_sigma")


def observations_to_message(epoch: ObservationEpoch, frame_id: str) -> GnssObservations:
    """Return the message of one receiver epoch; columns are copied without a loop.

    Raises
    ------
    ValueError
        If the columns are not all of one length, or the time does not fit a stamp.
    TypeError
        If a column has another element type than the message, which ROS would not notice.
    """
    message = GnssObservations(
        gps_week=epoch.gps_week,
        gps_time_of_week=epoch.gps_time_of_week,
        time_status=epoch.time_status,
        receiver_status=epoch.receiver_status,
    )
    message.header.stamp = to_stamp(epoch.time.to_unix_nanoseconds())
    message.header.frame_id = frame_id
    columns = epoch.columns()
    _check_lengths(columns)
    for name, column in columns.items():
        if column.dtype != OBSERVATION_COLUMNS[name]:
            expected = np.dtype(OBSERVATION_COLUMNS[name])
            raise TypeError(f"observation column '{name}' is {column.dtype}; it must be {expected}")
        setattr(message, name, column_to_array(column.dtype.char, column))
    return message


def observations_from_message(message: GnssObservations, log_name: str = "") -> ObservationEpoch:
    """Return the columns of a message as numpy arrays that own their values.

    The time comes from week and second of week: the stamp repeats itself in a leap second.

    Raises
    ------
    ValueError
        If the arrays of the message are not all of one length.
    """
    columns: dict[str, Any] = {
        name: np.array(getattr(message, name), dtype=kind)
        for name, kind in OBSERVATION_COLUMNS.items()
    }
    _check_lengths(columns)
    return ObservationEpoch(
        time=GpsTime.from_week_tow(message.gps_week, message.gps_time_of_week),
        time_status=message.time_status,
        receiver_status=message.receiver_status,
        log_name=log_name,
        **columns,
    )


def ephemeris_to_message(ephemeris: BroadcastEphemeris) -> GnssEphemeris:
    """Return the message of a broadcast ephemeris."""
    message = GnssEphemeris(**{name: getattr(ephemeris, name) for name in _EPHEMERIS_FIELDS})
    message.header.stamp = to_stamp(ephemeris.time.to_unix_nanoseconds())
    message.header.frame_id = EARTH_FRAME
    return message


def ephemeris_from_message(message: GnssEphemeris) -> BroadcastEphemeris:
    """Return the ephemeris of a message; its time of reception is the stamp of the message."""
    return BroadcastEphemeris(
        time=GpsTime.from_unix_nanoseconds(to_nanoseconds(message.header.stamp)),
        **{name: getattr(message, name) for name in _EPHEMERIS_FIELDS},
    )


def glonass_ephemeris_to_message(ephemeris: GlonassEphemeris) -> GlonassEphemerisMessage:
    """Return the message of a GLONASS ephemeris."""
    message = GlonassEphemerisMessage(
        gps_week=ephemeris.time_of_ephemeris.week,
        toe=ephemeris.time_of_ephemeris.time_of_week,
        **{name: getattr(ephemeris, name) for name in _GLONASS_FIELDS},
    )
    message.header.stamp = to_stamp(ephemeris.time.to_unix_nanoseconds())
    message.header.frame_id = EARTH_FRAME
    return message


def glonass_ephemeris_from_message(message: GlonassEphemerisMessage) -> GlonassEphemeris:
    """Return the GLONASS ephemeris of a message."""
    fields = {name: getattr(message, name) for name in _GLONASS_FIELDS}
    for name in ("position", "velocity", "acceleration"):
        fields[name] = tuple(fields[name].tolist())
    return GlonassEphemeris(
        time=GpsTime.from_unix_nanoseconds(to_nanoseconds(message.header.stamp)),
        time_of_ephemeris=GpsTime.from_week_tow(message.gps_week, message.toe),
        **fields,
    )


def fix_to_message(fix: Fix) -> GnssFix:
    """Return the message of the receiver's own solution."""
    message = GnssFix(
        gps_week=fix.gps_week,
        gps_time_of_week=fix.gps_time_of_week,
        **{name: getattr(fix, name) for name in _FIX_FIELDS},
    )
    message.header.stamp = to_stamp(fix.time.to_unix_nanoseconds())
    message.header.frame_id = EARTH_FRAME
    return message


def fix_from_message(message: GnssFix) -> Fix:
    """Return the receiver's own solution of a message."""
    values = {name: getattr(message, name) for name in _FIX_FIELDS}
    values.update({name: tuple(float(x) for x in values[name]) for name in _VECTOR_FIELDS})
    return Fix(
        time=GpsTime.from_week_tow(message.gps_week, message.gps_time_of_week),
        **values,
    )


def raw_log_to_message(log: RawLog, frame_id: str) -> ReceiverLog:
    """Return the message of a raw log; a log without a time gets a zero stamp."""
    message = ReceiverLog(name=log.name, log_id=log.log_id, data=array.array("B", log.content))
    if log.time is not None:
        message.header.stamp = to_stamp(log.time.to_unix_nanoseconds())
    message.header.frame_id = frame_id
    return message


def raw_log_from_message(message: ReceiverLog) -> RawLog:
    """Return the raw log of a message; a zero stamp means a log without a time."""
    unix_nanoseconds = to_nanoseconds(message.header.stamp)
    return RawLog(
        time=GpsTime.from_unix_nanoseconds(unix_nanoseconds) if unix_nanoseconds else None,
        name=message.name,
        log_id=message.log_id,
        content=bytes(message.data),
    )


def ism_slant_tec_to_message(slant_tec: IsmSlantTec, frame_id: str) -> SlantTec:
    """Return the message of the slant TEC that a GPStation-6 formed.

    Fields that the receiver does not report are NaN.
    """
    unknown = np.full(len(slant_tec.prn), math.nan)
    message = SlantTec(
        system=column_to_array("B", slant_tec.system),
        prn=column_to_array("B", slant_tec.prn),
        band_first=column_to_array("B", slant_tec.band_first),
        band_second=column_to_array("B", slant_tec.band_second),
        stec_tecu=column_to_array("d", slant_tec.stec_tecu),
        stec_sigma_tecu=column_to_array("f", unknown),
        stec_code_tecu=column_to_array("d", unknown),
        vtec_tecu=column_to_array("f", unknown),
        elevation=column_to_array("f", slant_tec.elevation),
        azimuth=column_to_array("f", slant_tec.azimuth),
        pierce_latitude_deg=column_to_array("f", unknown),
        pierce_longitude_deg=column_to_array("f", unknown),
        arc=column_to_array("I", np.zeros(len(unknown))),
        rejected=column_to_array("H", np.zeros(len(unknown))),
    )
    message.header.stamp = to_stamp(slant_tec.time.to_unix_nanoseconds())
    message.header.frame_id = frame_id
    return message


def ism_scintillation_to_message(indices: IsmScintillation, frame_id: str) -> Scintillation:
    """Return the message of the indices that a GPStation-6 formed over 60 s of 50 Hz samples.

    `s4` is the total S4; `s4_corrected` has the thermal noise removed:
    sqrt(max(S4^2 - correction^2, 0)) (GPStation-6 manual). Fields that the receiver does not report
    are NaN.
    """
    unknown = np.full(len(indices.prn), math.nan)
    excess = np.square(indices.s4_total) - np.square(indices.s4_correction)
    message = Scintillation(
        window=ISM_WINDOW,
        sample_rate_hz=ISM_SAMPLE_RATE_HZ,
        phase_cutoff_hz=math.nan,
        roti_interval=math.nan,
        system=column_to_array("B", indices.system),
        prn=column_to_array("B", indices.prn),
        band=column_to_array("B", indices.band),
        attribute=column_to_array("B", indices.attribute),
        s4=column_to_array("f", indices.s4_total),
        s4_corrected=column_to_array("f", np.sqrt(np.maximum(excess, 0.0))),
        s4_pseudo=column_to_array("f", unknown),
        sigma_phi=column_to_array("f", indices.sigma_phi[:, -1]),
        roti_tecu_per_minute=column_to_array("f", unknown),
        cn0_dbhz=column_to_array("f", indices.cn0_dbhz),
        elevation=column_to_array("f", indices.elevation),
        azimuth=column_to_array("f", indices.azimuth),
        samples=column_to_array("I", np.full(len(unknown), ISM_WINDOW * ISM_SAMPLE_RATE_HZ)),
    )
    message.header.stamp = to_stamp(indices.time.to_unix_nanoseconds())
    message.header.frame_id = frame_id
    return message


def column_to_array(kind: str, column: npt.ArrayLike) -> array.array[Any]:
    """Return numbers as an array of a message, of elements with a type code of `array`."""
    return array.array(kind, np.asarray(column).astype(kind).tobytes())


def _check_lengths(columns: dict[str, npt.NDArray[Any]]) -> None:
    count = len(columns["prn"])
    for name, column in columns.items():
        if column.shape != (count,):
            raise ValueError(
                f"observation column '{name}' has shape {column.shape}; 'prn' has {count} elements"
            )
