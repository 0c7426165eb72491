"""Header lines common to the RINEX files that are written."""

from __future__ import annotations

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.rinex.calendar_time import calendar_fields

__all__ = ["PROGRAM", "WRITTEN_VERSION", "first_lines", "header_line", "time_fields"]

WRITTEN_VERSION = 3.05
"""RINEX version that is written."""

PROGRAM = "vtff"
"""Name of the program in the files."""

_UNIT_100_NANOSECONDS = 100


def header_line(text: str, label: str) -> str:
    """Return a line: 60 characters of text, 20 of label.

    Raises
    ------
    ValueError
        If the text is longer, or not printable ASCII.
    """
    if len(text) > 60 or not (text.isascii() and text.isprintable()):
        raise ValueError(f"{label}: {text!r} is not a text of at most 60 ASCII characters")
    return f"{text:<60}{label:<20}\n"


def first_lines(kind: str, system: str, created: str) -> str:
    """Return the first two lines.

    Parameters
    ----------
    kind : str
        ``"OBSERVATION DATA"`` or ``"N: GNSS NAV DATA"``.
    system : str
        Letter of the file.
    created : str
        Date as RINEX has it, ``"20240110 000000 UTC"``; may be empty, so that equal runs write
        equal files.
    """
    version = f"{WRITTEN_VERSION:9.2f}{'':11}{kind:<20}{system:<20}"
    program = f"{PROGRAM:<20}{'':20}{created:<20}"
    return header_line(version, "RINEX VERSION / TYPE") + header_line(
        program, "PGM / RUN BY / DATE"
    )


def time_fields(time: GpsTime) -> tuple[int, int, int, int, int, float]:
    """Return year to second of a time, rounded to the 100 ns that RINEX can tell."""
    rounded = (time.nanoseconds + _UNIT_100_NANOSECONDS // 2) // _UNIT_100_NANOSECONDS
    year, month, day, hour, minute, second, nanosecond = calendar_fields(
        GpsTime(rounded * _UNIT_100_NANOSECONDS)
    )
    return year, month, day, hour, minute, second + nanosecond * 1e-9
