"""GPS, UTC and TT as exact integer nanoseconds.

A point in time is a `GpsTime`: nanoseconds since 1980-01-06 00:00:00 in the uniform GPS time
scale. UTC (and with it the Unix time of ROS header stamps) is GPS less the leap seconds since
1980; TT is GPS plus 51.184 s.
"""

from __future__ import annotations

import bisect
import datetime
import functools
import re
from dataclasses import dataclass
from typing import overload

import brahe

from vtff_dynamics.constants import (
    NANOSECONDS_PER_SECOND,
    SECONDS_PER_DAY,
    SECONDS_PER_WEEK,
    TT_MINUS_GPS_NANOSECONDS,
    UNIX_TIME_OF_GPS_EPOCH,
)

__all__ = ["TIME_SCALES", "GpsTime", "leap_seconds", "leap_seconds_at_unix", "parse_epoch"]

TIME_SCALES = ("GPS", "UTC", "TT")
"""Names of the time scales that `GpsTime.isoformat` writes and `parse_epoch` reads."""

# Days on which 00:00:00 UTC came one second later than 24 hours before (IERS Bulletin C);
# each adds one second to GPS - UTC. No leap second has been announced after the last one.
_LEAP_SECOND_DATES = (
    "1981-07-01",
    "1982-07-01",
    "1983-07-01",
    "1985-07-01",
    "1988-01-01",
    "1990-01-01",
    "1991-01-01",
    "1992-07-01",
    "1993-07-01",
    "1994-07-01",
    "1996-01-01",
    "1997-07-01",
    "1999-01-01",
    "2006-01-01",
    "2009-01-01",
    "2012-07-01",
    "2015-07-01",
    "2017-01-01",
)
_GPS_EPOCH_ORDINAL = datetime.date(1980, 1, 6).toordinal()
_NANOSECONDS_PER_DAY = SECONDS_PER_DAY * NANOSECONDS_PER_SECOND
_NANOSECONDS_PER_WEEK = SECONDS_PER_WEEK * NANOSECONDS_PER_SECOND

# Nanoseconds since 1980-01-06 00:00:00 UTC on a clock without leap seconds (Unix time shifted).
_LEAPS_UTC = [
    (datetime.date.fromisoformat(text).toordinal() - _GPS_EPOCH_ORDINAL) * _NANOSECONDS_PER_DAY
    for text in _LEAP_SECOND_DATES
]
# GPS time at which each inserted second 23:59:60 begins, and at which the new offset holds.
_LEAPS_GPS_BEGIN = [utc + count * NANOSECONDS_PER_SECOND for count, utc in enumerate(_LEAPS_UTC)]
_LEAPS_GPS = [begin + NANOSECONDS_PER_SECOND for begin in _LEAPS_GPS_BEGIN]

_EPOCH_PATTERN = re.compile(
    r"(?P<date>\d{4}-\d{2}-\d{2})[T ]"
    r"(?P<hour>\d{2}):(?P<minute>\d{2}):(?P<second>\d{2})(?:\.(?P<fraction>\d{1,9}))?"
    r" ?(?P<scale>GPS|UTC|TT|Z)"
)


@dataclass(frozen=True, order=True)
class GpsTime:
    """A point in time on the GPS time scale.

    Parameters
    ----------
    nanoseconds : int
        Nanoseconds since 1980-01-06 00:00:00 GPS; may be negative.

    Notes
    -----
    Times are hashable and ordered. ``time + seconds`` gives a time, ``time - time`` seconds;
    float seconds are rounded to the nearest nanosecond, int seconds are exact.
    """

    nanoseconds: int

    def __post_init__(self) -> None:
        """Refuse anything but an integer, which would lose nanoseconds silently."""
        if not isinstance(self.nanoseconds, int) or isinstance(self.nanoseconds, bool):
            raise TypeError(
                f"nanoseconds: an int is required, got {type(self.nanoseconds).__name__}"
            )

    @classmethod
    def from_week_tow(cls, week: int, time_of_week: float) -> GpsTime:
        """Return the time at a full GPS week number and seconds of that week.

        Parameters
        ----------
        week : int
            Weeks since 1980-01-06, counted through all rollovers (not modulo 1024).
        time_of_week : float
            Seconds since the start of the week, rounded to the nearest nanosecond.
        """
        return cls(int(week) * _NANOSECONDS_PER_WEEK + _nanoseconds(time_of_week))

    @classmethod
    def from_unix_nanoseconds(cls, unix_nanoseconds: int) -> GpsTime:
        """Return the time at a Unix time (UTC without its leap seconds), as in ROS stamps.

        Raises
        ------
        TypeError
            If `unix_nanoseconds` is not an integer.
        """
        if not isinstance(unix_nanoseconds, int):
            raise TypeError(
                f"unix_nanoseconds: an int is required, got {type(unix_nanoseconds).__name__}"
            )
        utc = unix_nanoseconds - UNIX_TIME_OF_GPS_EPOCH * NANOSECONDS_PER_SECOND
        return cls(utc + bisect.bisect_right(_LEAPS_UTC, utc) * NANOSECONDS_PER_SECOND)

    @property
    def week(self) -> int:
        """Full GPS week number since 1980-01-06 (not modulo 1024)."""
        return self.nanoseconds // _NANOSECONDS_PER_WEEK

    @property
    def time_of_week_nanoseconds(self) -> int:
        """Nanoseconds since the start of the GPS week."""
        return self.nanoseconds % _NANOSECONDS_PER_WEEK

    @property
    def time_of_week(self) -> float:
        """Seconds since the start of the GPS week."""
        return self.time_of_week_nanoseconds / NANOSECONDS_PER_SECOND

    def to_unix_nanoseconds(self) -> int:
        """Return the Unix time in nanoseconds.

        Unix time has no numbers for an inserted leap second: during 23:59:60 the numbers of the
        second that follows are returned (POSIX.1), so that only there it is not invertible.
        """
        utc = self.nanoseconds - self._leap_seconds_begun() * NANOSECONDS_PER_SECOND
        if self._in_leap_second():
            utc += NANOSECONDS_PER_SECOND
        return utc + UNIX_TIME_OF_GPS_EPOCH * NANOSECONDS_PER_SECOND

    def to_brahe_epoch(self) -> brahe.Epoch:
        """Return the same time as a brahe epoch, exact to 0.1 ns.

        The readings of a brahe epoch (`unix_timestamp`, `gps_date`) are good to some microseconds.
        """
        return brahe.Epoch.from_gps_date(self.week, self.time_of_week)

    def julian_date_tt(self) -> tuple[float, float]:
        """Return the Julian date in TT as whole days and a fraction in [0, 1)."""
        days, rest = divmod(
            self.nanoseconds + TT_MINUS_GPS_NANOSECONDS + _NANOSECONDS_PER_DAY // 2,
            _NANOSECONDS_PER_DAY,
        )
        # 1980-01-06 00:00 is JD 2444244.5; the half day is in the dividend above.
        return float(days + 2444244), rest / _NANOSECONDS_PER_DAY

    def isoformat(self, scale: str = "GPS") -> str:
        """Return for example ``2016-03-21T01:00:00 GPS``; `parse_epoch` is the inverse.

        Parameters
        ----------
        scale : str
            ``GPS``, ``UTC`` or ``TT``. A fraction of the second is written only if not zero.

        Raises
        ------
        ValueError
            If the scale is unknown, or if the year does not lie within 1 to 9999.
        """
        if scale == "GPS":
            shifted = self.nanoseconds
        elif scale == "TT":
            shifted = self.nanoseconds + TT_MINUS_GPS_NANOSECONDS
        elif scale == "UTC":
            shifted = self.nanoseconds - self._leap_seconds_begun() * NANOSECONDS_PER_SECOND
        else:
            raise ValueError(f"time scale {scale!r}: must be one of {', '.join(TIME_SCALES)}")
        in_leap_second = scale == "UTC" and self._in_leap_second()
        days, rest = divmod(shifted, _NANOSECONDS_PER_DAY)
        date = datetime.date.fromordinal(days + _GPS_EPOCH_ORDINAL)
        whole, fraction = divmod(rest, NANOSECONDS_PER_SECOND)
        minutes, second = divmod(whole, 60)
        hour, minute = divmod(minutes, 60)
        text = f"{date.isoformat()}T{hour:02d}:{minute:02d}:{second + in_leap_second:02d}"
        if fraction:
            text += f".{fraction:09d}".rstrip("0")
        return f"{text} {scale}"

    def __str__(self) -> str:
        """Return the ISO text in GPS time."""
        return self.isoformat()

    def __add__(self, seconds: float) -> GpsTime:
        """Return the time `seconds` later."""
        return GpsTime(self.nanoseconds + _nanoseconds(seconds))

    __radd__ = __add__

    @overload
    def __sub__(self, other: GpsTime) -> float: ...

    @overload
    def __sub__(self, other: float) -> GpsTime: ...

    def __sub__(self, other: GpsTime | float) -> GpsTime | float:
        """Return the seconds since another time, or the time that many seconds earlier."""
        if isinstance(other, GpsTime):
            return (self.nanoseconds - other.nanoseconds) / NANOSECONDS_PER_SECOND
        return GpsTime(self.nanoseconds - _nanoseconds(other))

    def _leap_seconds_begun(self) -> int:
        """Return the number of leap seconds whose inserted second has begun."""
        return bisect.bisect_right(_LEAPS_GPS_BEGIN, self.nanoseconds)

    def _in_leap_second(self) -> bool:
        """Return whether this is within an inserted second 23:59:60 UTC."""
        return self._leap_seconds_begun() != bisect.bisect_right(_LEAPS_GPS, self.nanoseconds)


def leap_seconds(time: GpsTime) -> int:
    """Return GPS - UTC in whole seconds (IERS Bulletin C).

    An inserted second 23:59:60 still counts with the old value.
    """
    return bisect.bisect_right(_LEAPS_GPS, time.nanoseconds)


def leap_seconds_at_unix(unix_nanoseconds: int) -> int:
    """Return GPS - UTC in whole seconds at a Unix time in nanoseconds."""
    return bisect.bisect_right(
        _LEAPS_UTC, unix_nanoseconds - UNIX_TIME_OF_GPS_EPOCH * NANOSECONDS_PER_SECOND
    )


@functools.lru_cache(maxsize=64)
def parse_epoch(text: str) -> GpsTime:
    """Return the time written as ``YYYY-MM-DDThh:mm:ss[.fraction] GPS``.

    Parameters
    ----------
    text : str
        ISO 8601 date and time with up to nine decimals and a time scale: ``GPS``, ``UTC`` (or
        the suffix ``Z``) or ``TT``. The scale is required. In UTC an inserted second 23:59:60 is
        understood on the days that have one.

    Raises
    ------
    ValueError
        If the text is not such an epoch; the message repeats the text.

    Examples
    --------
    >>> (parse_epoch("2016-12-31T23:59:60 UTC") - parse_epoch("2017-01-01T00:00:00 GPS"))
    17.0
    """
    match = _EPOCH_PATTERN.fullmatch(text.strip())
    if match is None:
        raise ValueError(
            f"epoch {text!r}: expected YYYY-MM-DDThh:mm:ss[.fraction] followed by GPS, UTC or TT"
        )
    try:
        days = datetime.date.fromisoformat(match["date"]).toordinal() - _GPS_EPOCH_ORDINAL
    except ValueError as error:
        raise ValueError(f"epoch {text!r}: {error}") from None
    hour, minute, second = int(match["hour"]), int(match["minute"]), int(match["second"])
    is_utc = match["scale"] in ("UTC", "Z")
    end_of_day_utc = (days + 1) * _NANOSECONDS_PER_DAY
    is_leap_second = is_utc and (hour, minute, second) == (23, 59, 60)
    if is_leap_second and end_of_day_utc not in _LEAPS_UTC:
        raise ValueError(f"epoch {text!r}: no leap second was inserted at the end of this day")
    if hour > 23 or minute > 59 or (second > 59 and not is_leap_second):
        raise ValueError(f"epoch {text!r}: hour, minute or second out of range")
    nanoseconds = (
        days * _NANOSECONDS_PER_DAY
        + ((hour * 60 + minute) * 60 + second) * NANOSECONDS_PER_SECOND
        + int((match["fraction"] or "").ljust(9, "0"))
    )
    if is_leap_second:
        leaps = _LEAPS_UTC.index(end_of_day_utc)
    elif is_utc:
        leaps = bisect.bisect_right(_LEAPS_UTC, nanoseconds)
    else:
        leaps = 0
    nanoseconds += leaps * NANOSECONDS_PER_SECOND
    return GpsTime(nanoseconds - (TT_MINUS_GPS_NANOSECONDS if match["scale"] == "TT" else 0))


def _nanoseconds(seconds: float) -> int:
    """Return seconds as integer nanoseconds; exact for int, to the nearest for float."""
    if isinstance(seconds, int):
        return seconds * NANOSECONDS_PER_SECOND
    # Whole seconds are converted exactly first, so that large times lose no digits.
    whole = int(seconds // 1.0)
    return whole * NANOSECONDS_PER_SECOND + round((seconds - whole) * NANOSECONDS_PER_SECOND)
