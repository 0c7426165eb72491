"""Writer of RINEX 3.05 navigation files of GPS and Galileo (IGS/RTCM-SC104)."""

from __future__ import annotations

import math
import os
import pathlib
from collections.abc import Iterable

from vtff_dynamics.constants import SECONDS_PER_WEEK
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss import constants as c
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.ionosphere_parameters import KlobucharParameters, NeQuickParameters
from vtff_gnss.rinex.calendar_time import calendar_fields
from vtff_gnss.rinex.write.header import first_lines, header_line
from vtff_gnss.signals import satellite_name

__all__ = ["format_rinex_navigation", "write_rinex_navigation"]

# Smaller exponents than E-99 do not fit the format.
_SMALLEST = 1e-99
_ACCURACY_NO_PREDICTION = {c.SYSTEM_GPS: 8192.0, c.SYSTEM_GALILEO: -1.0}
_TRANSMISSION_UNKNOWN = 0.9999e9
# Galileo data source (RINEX 3.05, table A8): I/NAV from E1-B and E5b-I with the clock of E5b, E1;
# F/NAV from E5a-I with the clock of E5a, E1.
_GALILEO_DATA_SOURCE = {
    c.EPHEMERIS_SOURCE_INAV: 1 << 0 | 1 << 2 | 1 << 9,
    c.EPHEMERIS_SOURCE_FNAV: 1 << 1 | 1 << 8,
}


def write_rinex_navigation(
    path: str | os.PathLike[str],
    ephemerides: Iterable[BroadcastEphemeris],
    klobuchar: KlobucharParameters | None = None,
    nequick: NeQuickParameters | None = None,
    leap_seconds: int | None = None,
    created: str = "",
) -> None:
    """Write broadcast ephemerides as RINEX 3.05, in the order of clock epochs.

    Parameters
    ----------
    path : path-like
    ephemerides : iterable of BroadcastEphemeris
        GPS LNAV and Galileo I/NAV and F/NAV.
    klobuchar, nequick : optional
        Ionosphere parameters of the header.
    leap_seconds : int, optional
        GPS - UTC, s.
    created : str
        Date for the header; see `first_lines`.

    Raises
    ------
    ValueError
        If an ephemeris belongs to another system, or is CNAV.

    Notes
    -----
    Numbers have 13 significant digits. The semi-major axis is written as its square root.
    """
    content = format_rinex_navigation(ephemerides, klobuchar, nequick, leap_seconds, created)
    pathlib.Path(path).write_text(content, encoding="ascii", newline="\n")


def format_rinex_navigation(
    ephemerides: Iterable[BroadcastEphemeris],
    klobuchar: KlobucharParameters | None = None,
    nequick: NeQuickParameters | None = None,
    leap_seconds: int | None = None,
    created: str = "",
) -> str:
    """Return the text of the file; see `write_rinex_navigation`."""
    listed = sorted(ephemerides, key=lambda e: (e.time_of_clock, e.system, e.prn, e.source, e.time))
    letters = {c.SYSTEM_LETTERS[ephemeris.system] for ephemeris in listed}
    descriptions = {"G": "G: GPS", "E": "E: GALILEO"}
    only = descriptions.get(letters.pop(), "M: MIXED") if len(letters) == 1 else "M: MIXED"
    lines = [first_lines("N: GNSS NAV DATA", only, created)]
    if klobuchar is not None:
        for name, values in (("GPSA", klobuchar.alpha), ("GPSB", klobuchar.beta)):
            lines.append(_ionosphere_line(name, values))
    if nequick is not None:
        lines.append(_ionosphere_line("GAL", (*nequick.effective_ionisation, 0.0)))
    if leap_seconds is not None:
        lines.append(header_line(f"{leap_seconds:6d}", "LEAP SECONDS"))
    lines.append(header_line("", "END OF HEADER"))
    lines += [_record(ephemeris) for ephemeris in listed]
    return "".join(lines)


def _ionosphere_line(name: str, values: tuple[float, ...]) -> str:
    numbers = "".join(f"{value:12.4E}" for value in values).replace("E", "D")
    return header_line(f"{name:<5}{numbers}", "IONOSPHERIC CORR")


def _record(e: BroadcastEphemeris) -> str:
    """Return the eight lines of an ephemeris."""
    is_gps = e.system == c.SYSTEM_GPS and e.source == c.EPHEMERIS_SOURCE_LNAV
    if not is_gps and not (e.system == c.SYSTEM_GALILEO and e.source in _GALILEO_DATA_SOURCE):
        raise ValueError(
            f"ephemeris of {satellite_name(e.system, e.prn)}, source {e.source}: only GPS LNAV "
            "and Galileo I/NAV and F/NAV can be written"
        )
    accuracy = _ACCURACY_NO_PREDICTION[e.system] if math.isnan(e.accuracy) else e.accuracy
    rows: list[tuple[float, ...]] = [
        (e.issue_of_data_ephemeris, e.crs, e.mean_motion_difference, e.mean_anomaly),
        (e.cuc, e.eccentricity, e.cus, math.sqrt(e.semi_major_axis)),
        (e.toe, e.cic, e.longitude_of_ascending_node, e.cis),
        (e.inclination, e.crc, e.argument_of_perigee, e.right_ascension_rate),
    ]
    if is_gps:
        rows += [
            # Codes on L2 and the P data flag are not kept: C/A, data on.
            (e.inclination_rate, 0.0, e.gps_week, 0.0),
            (accuracy, e.health, e.group_delay, e.issue_of_data_clock),
            (_transmission_time(e), e.fit_interval / 3600.0),
        ]
    else:
        rows += [
            (e.inclination_rate, _GALILEO_DATA_SOURCE[e.source], e.gps_week),
            (accuracy, e.health, e.group_delay, e.group_delay_secondary),
            (_transmission_time(e),),
        ]
    year, month, day, hour, minute, second, _ = calendar_fields(e.time_of_clock)
    date = f"{year:04d} {month:02d} {day:02d} {hour:02d} {minute:02d} {second:02d}"
    first = f"{satellite_name(e.system, e.prn)} {date}"
    lines = [first + "".join(_number(value) for value in (e.af0, e.af1, e.af2))]
    lines += ["    " + "".join(_number(value) for value in row) for row in rows]
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    if abs(value) < _SMALLEST:
        value = 0.0
    return f"{value:19.12E}".replace("E", "D")


def _transmission_time(e: BroadcastEphemeris) -> float:
    """Return s of the week of `toe`, negative before and beyond 604800 after it."""
    seconds = e.time - GpsTime.from_week_tow(e.gps_week, 0.0)
    return seconds if abs(seconds) < SECONDS_PER_WEEK else _TRANSMISSION_UNKNOWN
