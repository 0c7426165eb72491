"""Calendar dates of RINEX observation files in their time systems, as exact GPS time."""

from __future__ import annotations

import datetime

from vtff_dynamics.constants import (
    NANOSECONDS_PER_SECOND,
    SECONDS_PER_DAY,
    UNIX_TIME_OF_GPS_EPOCH,
)
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.constants import GPS_MINUS_BDT

__all__ = ["TIME_SYSTEM_OF_LETTER", "RinexClock", "calendar_fields", "full_year"]

#: Years whose times in ns since 1980 fit 64 bits.
_YEARS = range(1970, 2262)


def full_year(year: int) -> int:
    """Return a year with four digits; two digits stand for 1980 to 2079.

    Raises
    ------
    ValueError
        If times of the year cannot be counted.
    """
    if 0 <= year < 100:
        year += 1900 if year >= 80 else 2000
    if year not in _YEARS:
        raise ValueError(f"year {year}: {_YEARS[0]} to {_YEARS[-1]} expected")
    return year


TIME_SYSTEM_OF_LETTER = {"G": "GPS", "R": "GLO", "E": "GAL", "C": "BDT", "J": "QZS", "I": "IRN"}
"""Time system of a file of one satellite system that names none (RINEX 3.05, table A2)."""

# GLONASS time is given in UTC; the others but BeiDou time count with GPS time.
_UTC_SYSTEMS = ("GLO", "UTC")
_GPS_SYSTEMS = ("GPS", "GAL", "QZS", "IRN", "SBA")
_GPS_EPOCH_ORDINAL = datetime.date(1980, 1, 6).toordinal()
_FRACTION_DIGITS = 7


class RinexClock:
    """Converts dates of one time system to nanoseconds of GPS time.

    Parameters
    ----------
    time_system : str
        GPS, GAL, QZS, IRN (equal to GPS time), BDT, GLO or UTC.

    Raises
    ------
    ValueError
        If the time system is unknown.
    """

    def __init__(self, time_system: str) -> None:
        if time_system not in (*_UTC_SYSTEMS, *_GPS_SYSTEMS, "BDT"):
            raise ValueError(f"time system {time_system!r} is unknown")
        self.time_system = time_system
        self._minutes: dict[bytes, int] = {}

    def nanoseconds(self, minute: bytes, second: bytes) -> int:
        """Return the time of an epoch.

        Parameters
        ----------
        minute : bytes
            ``b"2024 01 10 00 05"``; the year may have two digits (80 to 79: 1980 to 2079).
        second : bytes
            Format F11.7: ``b" 30.0000000"``.

        Raises
        ------
        ValueError
            If this is not a date and time.
        """
        start = self._minutes.get(minute)
        if start is None:
            start = self._minutes[minute] = self._start_of_minute(minute)
        whole, point, fraction = second[:3], second[3:4], second[4:]
        if point != b"." or len(fraction) != _FRACTION_DIGITS or not fraction.isdigit():
            raise ValueError("seconds are not in format F11.7")
        seconds = int(whole)
        # Only UTC has a second 60.
        if not 0 <= seconds < (61 if self.time_system in _UTC_SYSTEMS else 60):
            raise ValueError(f"second {seconds} does not exist")
        hundreds_of_nanoseconds = int(fraction)
        return start + seconds * NANOSECONDS_PER_SECOND + hundreds_of_nanoseconds * 100

    def _start_of_minute(self, text: bytes) -> int:
        year, month, day, hour, minute = (int(word) for word in text.split())
        year = full_year(year)
        if not (0 <= hour < 24 and 0 <= minute < 60):
            raise ValueError(f"time {hour:02d}:{minute:02d} does not exist")
        days = datetime.date(year, month, day).toordinal() - _GPS_EPOCH_ORDINAL
        seconds = days * SECONDS_PER_DAY + hour * 3600 + minute * 60
        if self.time_system in _UTC_SYSTEMS:
            unix = (seconds + UNIX_TIME_OF_GPS_EPOCH) * NANOSECONDS_PER_SECOND
            return GpsTime.from_unix_nanoseconds(unix).nanoseconds
        if self.time_system == "BDT":
            seconds += GPS_MINUS_BDT
        return seconds * NANOSECONDS_PER_SECOND


def calendar_fields(time: GpsTime) -> tuple[int, int, int, int, int, int, int]:
    """Return year, month, day, hour, minute, second and nanosecond of a time, all in GPS time."""
    seconds, nanosecond = divmod(time.nanoseconds, NANOSECONDS_PER_SECOND)
    days, second_of_day = divmod(seconds, SECONDS_PER_DAY)
    date = datetime.date.fromordinal(days + _GPS_EPOCH_ORDINAL)
    minutes, second = divmod(second_of_day, 60)
    hour, minute = divmod(minutes, 60)
    return date.year, date.month, date.day, hour, minute, second, nanosecond
