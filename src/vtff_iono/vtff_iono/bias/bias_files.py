"""Readers of bias files: Bias-SINEX and the DCB files of CODE.

References
----------
Schaer (2018), SINEX_BIAS - Solution (Software/technique) INdependent EXchange Format for GNSS
Biases, version 1.00. The DCB files of CODE (P1P2yymm.DCB, P1C1yymm.DCB, ...) have no standard;
their title line contains the pair of signals and the month.
"""

from __future__ import annotations

import calendar
import datetime
import functools
import math
import pathlib
import re

from vtff_dynamics.constants import SECONDS_PER_DAY
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.constants import SYSTEM_GLONASS, SYSTEM_GPS, SYSTEM_LETTERS
from vtff_gnss.rinex.compressed_file import read_decompressed
from vtff_gnss.rinex.errors import RinexError
from vtff_iono.bias.code_biases import BiasFileError, CodeBias, CodeBiasTable

__all__ = ["read_code_biases"]

_GPS_EPOCH = datetime.date(1980, 1, 6)
# What an open end of a validity is taken as.
_EARLIEST, _LATEST = GpsTime(0), GpsTime.from_week_tow(100_000, 0.0)
_SECONDS_PER_NANOSECOND = 1e-9
# Fields of a line of BIAS/SOLUTION.
_SATELLITE, _STATION = slice(11, 14), slice(15, 24)
_FIRST, _SECOND = slice(25, 29), slice(30, 34)
_START, _END = slice(35, 49), slice(50, 64)
_UNIT, _VALUE, _SIGMA = slice(65, 69), slice(70, 91), slice(92, 103)
_DCB_TITLE = re.compile(
    r"DIFFERENTIAL \((?P<first>\w\d)-(?P<second>\w\d)\) CODE BIASES", re.IGNORECASE
)
_DCB_MONTH = re.compile(r"YEAR-MONTH:\s*(?P<year>\d{2})-(?P<month>\d{2})")
# "ENDING DAY 203, 2010" and "ENDING D203, 2010".
_DCB_DAY = re.compile(r"ENDING D(?:AY\s+)?(?P<day>\d{1,3}),\s*(?P<year>\d{4})", re.IGNORECASE)
_DCB_DAYS = 30
_DCB_SIGNALS = {
    SYSTEM_GPS: {"P1": "C1W", "P2": "C2W", "C1": "C1C", "C2": "C2X"},
    SYSTEM_GLONASS: {"P1": "C1P", "P2": "C2P", "C1": "C1C", "C2": "C2C"},
}


def read_code_biases(path: str | pathlib.Path) -> CodeBiasTable:
    """Read a Bias-SINEX file (``.BIA``) or a DCB file of CODE, compressed or not.

    From Bias-SINEX the differential (DSB) and absolute (OSB) code biases in ns are read; phase
    biases are ignored.

    Raises
    ------
    BiasFileError
        If the file is neither, is cut off, or has a malformed line; the message is
        ``file:line: field: reason``.
    OSError
        If the file cannot be read.
    """
    path = pathlib.Path(path)
    try:
        raw = read_decompressed(path)
    except RinexError as error:
        raise BiasFileError(str(error)) from None
    lines = raw.decode("ascii", errors="replace").splitlines()
    if lines and lines[0].startswith("%=BIA"):
        return CodeBiasTable(_read_bias_sinex(path, lines), str(path))
    if any(_DCB_TITLE.search(line) for line in lines[:8]):
        return CodeBiasTable(_read_dcb_file(path, lines), str(path))
    raise BiasFileError(
        f"{path}: neither a Bias-SINEX file (first line %=BIA) nor a DCB file of CODE "
        "(title DIFFERENTIAL (P1-P2) CODE BIASES)"
    )


def _read_bias_sinex(path: pathlib.Path, lines: list[str]) -> list[CodeBias]:
    starts = [n for n, line in enumerate(lines) if line.startswith("+BIAS/SOLUTION")]
    ends = [n for n, line in enumerate(lines) if line.startswith("-BIAS/SOLUTION")]
    if not starts or not ends:
        fault = "is not closed: the file is cut off" if starts else "is missing"
        raise BiasFileError(f"{path}: block BIAS/SOLUTION {fault}")
    biases = [
        _sinex_bias(f"{path}:{number + 1}", lines[number])
        for number in range(starts[0] + 1, ends[0])
        if lines[number][1:4] in ("DSB", "OSB")
    ]
    return [bias for bias in biases if bias is not None]


def _sinex_bias(line_name: str, line: str) -> CodeBias | None:
    """Return the bias of a line of BIAS/SOLUTION; None for a phase bias or a bias in cycles."""
    first, second = line[_FIRST].strip(), line[_SECOND].strip()
    is_code = first.startswith("C") and second[:1] in ("C", "")
    if not is_code or line[_UNIT].strip() != "ns":
        return None
    satellite, station = line[_SATELLITE].strip(), line[_STATION].strip()
    # A station's line has only the letter of the system in the column of the satellites.
    letter, prn = satellite[:1], satellite[1:].strip()
    if not letter or letter not in SYSTEM_LETTERS:
        raise BiasFileError(f"{line_name}: satellite {satellite!r}: unknown system")
    if not prn and not station:
        raise BiasFileError(f"{line_name}: names neither a satellite nor a station")
    start, end, sigma = line[_START].strip(), line[_END].strip(), line[_SIGMA].strip()
    return CodeBias(
        system=SYSTEM_LETTERS.index(letter),
        prn=0 if station else int(_number(line_name, "satellite", prn)),
        station=station,
        first=first,
        second=second,
        start=_sinex_time(line_name, "BIAS_START", start, _EARLIEST),
        end=_sinex_time(line_name, "BIAS_END", end, _LATEST),
        value=_number(line_name, "ESTIMATED_VALUE", line[_VALUE]) * _SECONDS_PER_NANOSECOND,
        sigma=_number(line_name, "STD_DEV", sigma or "0") * _SECONDS_PER_NANOSECOND,
    )


def _sinex_time(line_name: str, name: str, text: str, absent: GpsTime) -> GpsTime:
    """Return the time of a field; zeros mean an open end."""
    try:
        return _parse_sinex_time(text) or absent
    except (ValueError, OverflowError) as error:
        raise BiasFileError(f"{line_name}: {name} {text!r}: {error}") from None


@functools.lru_cache(maxsize=64)
def _parse_sinex_time(text: str) -> GpsTime | None:
    """Return the time written as year:day:second; None for zeros.

    Raises
    ------
    ValueError, OverflowError
        If it is no time.
    """
    match = re.fullmatch(r"(\d{4}):(\d{3}):(\d{5})", text)
    if match is None:
        raise ValueError("expected YYYY:DDD:SSSSS")
    year, day, second = (int(digits) for digits in match.groups())
    if year == 0:
        return None
    return _midnight(datetime.date(year, 1, 1) + datetime.timedelta(days=day - 1)) + second


def _read_dcb_file(path: pathlib.Path, lines: list[str]) -> list[CodeBias]:
    title = next(match for match in map(_DCB_TITLE.search, lines) if match)
    start, end = _dcb_validity(path, lines)
    biases = []
    for number, line in enumerate(lines, start=1):
        letter = line[:1]
        if letter not in ("G", "R") or not re.match(r"[GR](\d\d| )", line):
            continue
        line_name = f"{path}:{number}"
        system = SYSTEM_LETTERS.index(letter)
        signals = _DCB_SIGNALS[system]
        prn, station = line[1:3].strip(), line[6:22].split()
        try:
            first, second = (signals[title[name].upper()] for name in ("first", "second"))
        except KeyError as error:
            raise BiasFileError(f"{path}: title: unknown signal {error}") from None
        biases.append(
            CodeBias(
                system=system,
                prn=int(prn) if prn else 0,
                station="" if prn else (station or [""])[0],
                first=first,
                second=second,
                start=start,
                end=end,
                value=_number(line_name, "VALUE", line[26:35]) * _SECONDS_PER_NANOSECOND,
                sigma=_number(line_name, "RMS", line[38:47] or "0") * _SECONDS_PER_NANOSECOND,
            )
        )
    if not biases:
        raise BiasFileError(f"{path}: holds no bias: the file is cut off")
    return biases


def _dcb_validity(path: pathlib.Path, lines: list[str]) -> tuple[GpsTime, GpsTime]:
    """Return the first and last time for which the biases of a DCB file are valid."""
    text = "\n".join(lines[:8])
    month, day = _DCB_MONTH.search(text), _DCB_DAY.search(text)
    if month is not None:
        # Two-digit years as in RINEX 2: 80 to 99 are of the last century.
        year = int(month["year"])
        year += 1900 if year >= 80 else 2000
        if not 1 <= int(month["month"]) <= 12:
            raise BiasFileError(f"{path}: title: month {month['month']}")
        first = datetime.date(year, int(month["month"]), 1)
        days = calendar.monthrange(first.year, first.month)[1]
    elif day is not None:
        last = datetime.date(int(day["year"]), 1, 1) + datetime.timedelta(days=int(day["day"]))
        days = _DCB_DAYS
        first = last - datetime.timedelta(days=days)
    else:
        raise BiasFileError(f"{path}: title: has neither YEAR-MONTH nor ENDING DAY")
    start = _midnight(first)
    return start, start + days * SECONDS_PER_DAY


def _midnight(date: datetime.date) -> GpsTime:
    return GpsTime.from_week_tow(0, 0) + (date - _GPS_EPOCH).days * SECONDS_PER_DAY


def _number(line_name: str, name: str, text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        raise BiasFileError(f"{line_name}: {name} {text.strip()!r}: not a number") from None
    if not math.isfinite(number):
        raise BiasFileError(f"{line_name}: {name} {text.strip()!r}: not finite")
    return number
