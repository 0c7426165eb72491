"""Ephemeris records of RINEX navigation files: fixed columns to `BroadcastEphemeris`."""

from __future__ import annotations

import datetime
import functools
import math
import pathlib
from typing import NamedTuple

from vtff_dynamics.constants import (
    NANOSECONDS_PER_SECOND,
    SECONDS_PER_DAY,
    SECONDS_PER_WEEK,
)
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss import constants as c
from vtff_gnss.ephemeris import (
    DEFAULT_FIT_INTERVAL,
    BroadcastEphemeris,
    lnav_fit_interval,
    nearest_time_of_week,
)
from vtff_gnss.rinex.calendar_time import full_year
from vtff_gnss.rinex.errors import RinexError

__all__ = ["Line", "read_ephemeris", "read_number"]

_GPS_EPOCH_ORDINAL = datetime.date(1980, 1, 6).toordinal()
_FIELD_WIDTH = 19
# GPS URA of index 15, "no accuracy prediction": 2^13 m (IS-GPS-200, 20.3.3.3.1.3).
_ACCURACY_NO_PREDICTION = 8192.0
# Bits of the Galileo data source (RINEX 3.05, table A8).
_SOURCE_FNAV_BITS = 1 << 1 | 1 << 8

# Fields of the first line after the epoch.
_CLOCK_FIELDS = ("af0", "af1", "af2")
# Fields of the lines after the first (RINEX 3.05, tables A6 and A8; RINEX 2.11, table A4); None
# for those that are not needed. A question mark allows the field to be blank.
_ORBIT_FIELDS: tuple[tuple[str | None, ...], ...] = (
    ("issue_of_data_ephemeris", "crs", "mean_motion_difference", "mean_anomaly"),
    ("cuc", "eccentricity", "cus", "square_root_of_semi_major_axis"),
    ("toe", "cic", "longitude_of_ascending_node", "cis"),
    ("inclination", "crc", "argument_of_perigee", "right_ascension_rate"),
)
_GPS_FIELDS: tuple[tuple[str | None, ...], ...] = (
    *_ORBIT_FIELDS,
    ("inclination_rate", None, None, None),
    ("accuracy", "health", "group_delay", "issue_of_data_clock"),
    ("transmission_time?", "fit_interval?", None, None),
)
_GALILEO_FIELDS: tuple[tuple[str | None, ...], ...] = (
    *_ORBIT_FIELDS,
    ("inclination_rate", "data_source?", None, None),
    ("accuracy", "health", "group_delay", "group_delay_secondary"),
    ("transmission_time?", None, None, None),
)


# Those that an ephemeris holds as they are.
_ELEMENTS = tuple(
    name
    for row in _ORBIT_FIELDS
    for name in row
    if name is not None and name in BroadcastEphemeris.__dataclass_fields__
)


class Line(NamedTuple):
    """One line of a file, with its place for error messages."""

    path: pathlib.Path | str
    number: int
    text: str

    def error(self, reason: str) -> RinexError:
        """Return an error about this line."""
        return RinexError(f"{self.path}:{self.number}: {reason}")


def read_number(line: Line, field: str, column: int, width: int) -> float:
    """Return the number in a fixed field; exponents may be written with D.

    Raises
    ------
    RinexError
        If the field is blank or not a finite number.
    """
    text = line.text[column : column + width].strip()
    if not text:
        raise line.error(f"{field}: blank")
    if "D" in text or "d" in text:
        text = text.upper().replace("D", "E")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise line.error(f"{field}: {text!r} is not a number")
    return value


def read_ephemeris(
    record: list[Line], satellite: str, message: str | None, indent: int
) -> BroadcastEphemeris:
    """Read the ephemeris of a GPS or Galileo satellite.

    Parameters
    ----------
    record : list of Line
        The line with the clock epoch and the seven orbit lines.
    satellite : str
        RINEX name, e.g. ``"G05"``.
    message : str or None
        ``"LNAV"``, ``"INAV"`` or ``"FNAV"``; None where the record tells (RINEX 3).
    indent : int
        Column of the first orbit field: 3 in RINEX 2, 4 since RINEX 3.

    Raises
    ------
    RinexError
        If the record is incomplete or a field is malformed.

    Notes
    -----
    The week of `toe` is the week that brings it nearest to the clock epoch, since writers differ
    in what the week field counts around the turn of a week.
    """
    first = record[0]
    is_gps = satellite[0] == "G"
    if not satellite[1:3].strip().isdigit():
        raise first.error(f"satellite {satellite!r}: no number")
    layout = _GPS_FIELDS if is_gps else _GALILEO_FIELDS
    if len(record) <= len(layout):
        raise record[-1].error(f"{satellite}: {len(record)} lines, 8 are required")
    time_of_clock = _epoch(first, satellite, indent)
    value = _fields(record, satellite, layout, indent)
    time_of_ephemeris = nearest_time_of_week(_week_seconds(record, satellite, value), time_of_clock)
    system_values = _gps_values(value) if is_gps else _galileo_values(value, message)
    orbit = {name: value[name] for name in _ELEMENTS}
    orbit["issue_of_data_ephemeris"] = int(value["issue_of_data_ephemeris"])
    # A product is correctly rounded, which ** 2 is not.
    axis_root = value["square_root_of_semi_major_axis"]
    return BroadcastEphemeris(
        time=_transmission_time(value, time_of_ephemeris, time_of_clock),
        prn=int(satellite[1:3]),
        health=int(value["health"]),
        gps_week=time_of_ephemeris.week,
        toc=time_of_clock.time_of_week,
        af0=value["af0"],
        af1=value["af1"],
        af2=value["af2"],
        semi_major_axis=axis_root * axis_root,
        inclination_rate=value["inclination_rate"],
        group_delay=value["group_delay"],
        **orbit,  # type: ignore[arg-type]
        **system_values,  # type: ignore[arg-type]
    )


def _fields(
    record: list[Line], satellite: str, layout: tuple[tuple[str | None, ...], ...], indent: int
) -> dict[str, float]:
    """Return the fields of all lines; optional ones only where they are not blank."""
    value = {}
    for row, column, name, is_optional in _places(layout, indent):
        text = record[row].text[column : column + _FIELD_WIDTH]
        try:
            number = float(text)
        except ValueError:  # blank, an exponent with D, or an error to tell
            number = math.nan
        if not math.isfinite(number):
            if is_optional and not text.strip():
                continue
            number = read_number(record[row], f"{satellite} {name}", column, _FIELD_WIDTH)
        value[name] = number
    return value


@functools.cache
def _places(
    layout: tuple[tuple[str | None, ...], ...], indent: int
) -> tuple[tuple[int, int, str, bool], ...]:
    """Return line, column and name of each field that is needed, and whether it may be blank."""
    clock = [(0, position, name) for position, name in enumerate(_CLOCK_FIELDS, start=1)]
    orbit = [
        (row, position, name)
        for row, names in enumerate(layout, start=1)
        for position, name in enumerate(names)
        if name is not None
    ]
    return tuple(
        (row, indent + _FIELD_WIDTH * position, name.rstrip("?"), name.endswith("?"))
        for row, position, name in [*orbit, *clock]
    )


def _gps_values(value: dict[str, float]) -> dict[str, object]:
    issue_of_data_clock = int(value["issue_of_data_clock"])
    fit = value.get("fit_interval", 0.0)
    accuracy = value["accuracy"]
    return {
        "system": c.SYSTEM_GPS,
        "source": c.EPHEMERIS_SOURCE_LNAV,
        "issue_of_data_clock": issue_of_data_clock,
        "group_delay_secondary": 0.0,
        "accuracy": math.nan if accuracy >= _ACCURACY_NO_PREDICTION else accuracy,
        # Some writers give the broadcast flag (0 or 1) instead of hours.
        "fit_interval": fit * 3600.0
        if fit > 1.0
        else lnav_fit_interval(int(fit), issue_of_data_clock),
    }


def _galileo_values(value: dict[str, float], message: str | None) -> dict[str, object]:
    is_fnav = int(value.get("data_source", 0.0)) & _SOURCE_FNAV_BITS != 0
    if message is not None:
        is_fnav = message == "FNAV"
    accuracy = value["accuracy"]
    return {
        "system": c.SYSTEM_GALILEO,
        "source": c.EPHEMERIS_SOURCE_FNAV if is_fnav else c.EPHEMERIS_SOURCE_INAV,
        "issue_of_data_clock": int(value["issue_of_data_ephemeris"]),
        "group_delay_secondary": value["group_delay_secondary"],
        # Negative: no accuracy prediction available.
        "accuracy": math.nan if accuracy < 0.0 else accuracy,
        "fit_interval": DEFAULT_FIT_INTERVAL,
    }


def _week_seconds(record: list[Line], satellite: str, value: dict[str, float]) -> float:
    toe = value["toe"]
    if not 0.0 <= toe <= SECONDS_PER_WEEK:
        raise record[3].error(f"{satellite} toe: {toe:g} s is not within a week")
    return toe


def _transmission_time(
    value: dict[str, float], time_of_ephemeris: GpsTime, time_of_clock: GpsTime
) -> GpsTime:
    """Return the time of transmission; the clock epoch where the file does not know it.

    Writers may give it beyond the week that the week field tells, and 9.999e8 for unknown.
    """
    transmission = value.get("transmission_time", math.inf)
    if not -SECONDS_PER_WEEK <= transmission <= 2 * SECONDS_PER_WEEK:
        return time_of_clock
    return nearest_time_of_week(transmission % SECONDS_PER_WEEK, time_of_ephemeris)


def _epoch(line: Line, satellite: str, indent: int) -> GpsTime:
    """Return the clock epoch: two digits of the year and tenths of seconds in RINEX 2."""
    # Both layouts end 19 columns after the indent of the orbit lines.
    words = line.text[indent - 1 : indent + _FIELD_WIDTH].split()
    try:
        year, month, day, hour, minute = (int(word) for word in words[:5])
        second = float(words[5])
        days = datetime.date(full_year(year), month, day).toordinal() - _GPS_EPOCH_ORDINAL
    except (ValueError, IndexError):
        text = " ".join(words)
        raise line.error(f"{satellite} epoch: {text!r} is not a date and time") from None
    if len(words) != 6 or not (0 <= hour < 24 and 0 <= minute < 60 and 0.0 <= second < 61.0):
        raise line.error(f"{satellite} epoch: {' '.join(words)!r} is not a date and time")
    seconds = days * SECONDS_PER_DAY + hour * 3600 + minute * 60
    return GpsTime(seconds * NANOSECONDS_PER_SECOND + round(second * NANOSECONDS_PER_SECOND))
