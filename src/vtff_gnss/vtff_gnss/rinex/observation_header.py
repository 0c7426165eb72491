"""Header of RINEX observation files (RINEX 2.11 and 2.20, 3.05, 4.01; IGS/RTCM-SC104)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from vtff_dynamics.frames.geodetic import rotation_itrf_to_enu
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.constants import SYSTEM_LETTERS
from vtff_gnss.rinex.calendar_time import TIME_SYSTEM_OF_LETTER, RinexClock
from vtff_gnss.rinex.errors import RinexError
from vtff_gnss.rinex.navigation_records import Line, read_number

__all__ = ["LABEL_COLUMN", "RinexObservationHeader", "read_header", "read_header_record"]

LABEL_COLUMN = 60
_MAX_TYPES = 999
_DATE_WORDS = 6
# Without these the values of a file are something else; all other lines are optional.
_REQUIRED_LABELS = (
    "SYS / # / OBS TYPES",
    "# / TYPES OF OBSERV",
    "SYS / SCALE FACTOR",
    "WAVELENGTH FACT L1/2",
)


@dataclass
class RinexObservationHeader:
    """Header of an observation file; fields that the header lacks are None or empty.

    Parameters
    ----------
    version : float
        RINEX version, 2.00 to 4.99.
    satellite_system : str
        Letter of the file, ``"M"`` for several systems.
    marker_name, marker_number, marker_type : str
        The receiver's place.
    receiver, antenna : tuple of str
        Number, type and version; number and type.
    approximate_position : tuple of 3 float or None
        Marker, ITRF, m.
    antenna_delta_hen : tuple of 3 float
        Antenna reference point above the marker: height, east, north, m.
    antenna_delta_xyz : tuple of 3 float or None
        The same for a vehicle, in its own axes, m.
    interval : float or None
        s between epochs.
    observation_types : dict of str to tuple of str
        By system letter, as in the file; RINEX 2 has one list for all systems, under ``""``.
    time_system : str
        System of the time tags in the file (GPS, GLO, GAL, BDT, QZS, IRN, UTC); all times that are
        returned are GPS times.
    first_time, last_time : GpsTime or None
        As stated.
    clock_offset_applied : bool
        Whether epochs and observations are corrected for the receiver clock offsets given.
    glonass_channels : dict of int to int
        Slot to frequency channel.
    phase_shifts : dict of str to float
        ``"G L2X"`` to cycles that the writer has added; nothing is undone.
    scale_factors : dict of tuple of str to float
        (system letter, type) to the factor that the values of the file are divided by; type
        ``""`` stands for all of the system.
    wavelength_factors : tuple of 2 int
        RINEX 2: 2 for squared carriers, whose ambiguities are half cycles.
    leap_seconds : int or None
        GPS - UTC, s.
    comments : tuple of str
        Text of the comment lines.
    remarks : tuple of str
        Optional lines that could not be read and were passed over, one sentence each.
    """

    version: float
    satellite_system: str
    marker_name: str = ""
    marker_number: str = ""
    marker_type: str = ""
    receiver: tuple[str, ...] = ()
    antenna: tuple[str, ...] = ()
    approximate_position: tuple[float, float, float] | None = None
    antenna_delta_hen: tuple[float, float, float] = (0.0, 0.0, 0.0)
    antenna_delta_xyz: tuple[float, float, float] | None = None
    interval: float | None = None
    observation_types: dict[str, tuple[str, ...]] = field(default_factory=dict)
    time_system: str = "GPS"
    first_time: GpsTime | None = None
    last_time: GpsTime | None = None
    clock_offset_applied: bool = False
    glonass_channels: dict[int, int] = field(default_factory=dict)
    phase_shifts: dict[str, float] = field(default_factory=dict)
    scale_factors: dict[tuple[str, str], float] = field(default_factory=dict)
    wavelength_factors: tuple[int, int] = (1, 1)
    leap_seconds: int | None = None
    comments: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    def antenna_position(self) -> tuple[float, float, float] | None:
        """Return the antenna reference point, ITRF, m: the marker and the antenna offset from it.

        The offset in axes of a vehicle (DELTA X/Y/Z) is left out.
        """
        if self.approximate_position is None:
            return None
        height, east, north = self.antenna_delta_hen
        marker = np.array(self.approximate_position)
        x, y, z = (marker + rotation_itrf_to_enu(marker).T @ (east, north, height)).tolist()
        return x, y, z


def read_header(lines: Iterator[Line]) -> RinexObservationHeader:
    """Read all lines up to END OF HEADER.

    Raises
    ------
    RinexError
        If this is no observation file of a version that is known, or if a field is malformed.
    """
    first = next(lines)
    if first.text[LABEL_COLUMN:].strip() != "RINEX VERSION / TYPE":
        raise first.error("not a RINEX file: no RINEX VERSION / TYPE")
    version = read_number(first, "version", 0, 9)
    if not 2.0 <= version < 5.0:
        raise first.error(f"RINEX version {version:g} is not supported (2, 3 and 4 are)")
    if first.text[20] != "O":
        raise first.error(f"file type {first.text[20]!r}: 'O' (observations) is required")
    letter = first.text[40].strip() or "G"
    header = RinexObservationHeader(version, letter)
    header.time_system = TIME_SYSTEM_OF_LETTER.get(letter, "GPS")
    records: list[Line] = []
    for line in lines:
        if line.text[LABEL_COLUMN:].strip() == "END OF HEADER":
            break
        records.append(line)
    else:
        raise RinexError(f"{first.path}: END OF HEADER is missing")
    # The time system stands in a record that may follow those that need it.
    for record in records:
        if record.text[LABEL_COLUMN:].strip() == "TIME OF FIRST OBS":
            header.time_system = _stated_time_system(record) or header.time_system
            _clock(header, record)
    source = iter(records)
    for record in source:
        read_header_record(header, record, source)
    if not header.observation_types:
        raise RinexError(f"{first.path}: the header lists no observation types")
    return header


def read_header_record(
    header: RinexObservationHeader, line: Line, following: Iterator[Line]
) -> None:
    """Take one header line, also one within the observations, and its continuation lines.

    Raises
    ------
    RinexError
        If a field is malformed without which the observations cannot be understood. Other
        malformed lines become remarks; labels that do not matter are passed over.
    """
    label = line.text[LABEL_COLUMN:].strip()
    reader = _READERS.get(label)
    if reader is None:
        return
    try:
        reader(header, line, following)
    except RinexError as error:
        if label in _REQUIRED_LABELS:
            raise
        header.remarks = (*header.remarks, f"header line is not used: {error}")


def _stated_time_system(line: Line) -> str:
    """Return the time system in a line TIME OF FIRST OBS, wherever it stands behind the date."""
    words = line.text[43:LABEL_COLUMN].split()
    letters = [word for word in words if word.isalpha()]
    return letters[0] if letters else ""


def _clock(header: RinexObservationHeader, line: Line) -> RinexClock:
    try:
        return RinexClock(header.time_system)
    except ValueError as error:
        raise line.error(f"TIME OF FIRST OBS: {error}") from None


def _three(line: Line, name: str) -> tuple[float, float, float]:
    x, y, z = (read_number(line, name, 14 * i, 14) for i in range(3))
    return x, y, z


def _integer(line: Line, name: str, column: int, width: int) -> int:
    value = read_number(line, name, column, width)
    if value != int(value):
        raise line.error(f"{name}: {value:g} is not an integer")
    return int(value)


def _read_marker_name(header: RinexObservationHeader, line: Line, _: Iterator[Line]) -> None:
    header.marker_name = line.text[:60].strip()


def _read_marker_number(header: RinexObservationHeader, line: Line, _: Iterator[Line]) -> None:
    header.marker_number = line.text[:20].strip()


def _read_marker_type(header: RinexObservationHeader, line: Line, _: Iterator[Line]) -> None:
    header.marker_type = line.text[:20].strip()


def _read_receiver(header: RinexObservationHeader, line: Line, _: Iterator[Line]) -> None:
    header.receiver = tuple(line.text[20 * i : 20 * i + 20].strip() for i in range(3))


def _read_antenna(header: RinexObservationHeader, line: Line, _: Iterator[Line]) -> None:
    header.antenna = tuple(line.text[20 * i : 20 * i + 20].strip() for i in range(2))


def _read_position(header: RinexObservationHeader, line: Line, _: Iterator[Line]) -> None:
    # Blank, or zeros where the receiver did not know it.
    if line.text[:42].strip():
        position = _three(line, "APPROX POSITION XYZ")
        header.approximate_position = position if any(position) else None


def _read_delta_hen(header: RinexObservationHeader, line: Line, _: Iterator[Line]) -> None:
    header.antenna_delta_hen = _three(line, "ANTENNA: DELTA H/E/N")


def _read_delta_xyz(header: RinexObservationHeader, line: Line, _: Iterator[Line]) -> None:
    header.antenna_delta_xyz = _three(line, "ANTENNA: DELTA X/Y/Z")


def _read_interval(header: RinexObservationHeader, line: Line, _: Iterator[Line]) -> None:
    interval = read_number(line, "INTERVAL", 0, 10)
    header.interval = interval if interval > 0.0 else None


def _read_types_3(header: RinexObservationHeader, line: Line, following: Iterator[Line]) -> None:
    label = "SYS / # / OBS TYPES"
    if header.version < 3.0:
        raise line.error(f"{label}: not in RINEX {header.version:g}")
    letter = line.text[0]
    if letter not in SYSTEM_LETTERS:
        raise line.error(f"{label}: satellite system {letter!r} is unknown")
    count = _integer(line, label, 3, 3)
    types = _type_names(line, following, label, count, [(7 + 4 * i, 3) for i in range(13)])
    if any(len(name) != 3 for name in types):
        raise line.error(f"{label}: types of three characters are required")
    header.observation_types[letter] = types


def _read_types_2(header: RinexObservationHeader, line: Line, following: Iterator[Line]) -> None:
    label = "# / TYPES OF OBSERV"
    if header.version >= 3.0:
        raise line.error(f"{label}: not in RINEX {header.version:g}")
    count = _integer(line, label, 0, 6)
    types = _type_names(line, following, label, count, [(10 + 6 * i, 2) for i in range(9)])
    if any(len(name) != 2 for name in types):
        raise line.error(f"{label}: types of two characters are required")
    header.observation_types[""] = types


def _type_names(
    line: Line, following: Iterator[Line], label: str, count: int, places: list[tuple[int, int]]
) -> tuple[str, ...]:
    if not 0 <= count <= _MAX_TYPES:
        raise line.error(f"{label}: {count} types")
    names: list[str] = []
    current: Line | None = line
    while len(names) < count:
        if current is None or current.text[LABEL_COLUMN:].strip() != label:
            raise (current or line).error(f"{label}: {len(names)} of {count} types are there")
        for column, width in places[: count - len(names)]:
            names.append(current.text[column : column + width].strip())
        if len(names) < count:
            current = next(following, None)
    return tuple(names)


def _read_time(header: RinexObservationHeader, line: Line, _: Iterator[Line]) -> None:
    label = line.text[LABEL_COLUMN:].strip()
    if not line.text[:43].strip():
        return
    # Archives hold seconds with any number of digits, in fields of any width.
    words = [word for word in line.text[:48].split() if not word.isalpha()]
    try:
        if len(words) != _DATE_WORDS:
            raise ValueError("year, month, day, hour, minute and second expected")
        minute = " ".join(words[:-1]).encode("ascii", "replace")
        second = f"{float(words[-1]):11.7f}".encode("ascii")
        nanoseconds = _clock(header, line).nanoseconds(minute, second)
    except ValueError as error:
        if isinstance(error, RinexError):
            raise
        raise line.error(f"{label}: {line.text[:43].strip()!r}: {error}") from None
    if label == "TIME OF FIRST OBS":
        header.first_time = GpsTime(nanoseconds)
    else:
        header.last_time = GpsTime(nanoseconds)


def _read_clock_applied(header: RinexObservationHeader, line: Line, _: Iterator[Line]) -> None:
    header.clock_offset_applied = line.text[:6].strip() == "1"


def _read_glonass(header: RinexObservationHeader, line: Line, _: Iterator[Line]) -> None:
    for column in range(4, 60, 7):
        entry = line.text[column : column + 6]
        if entry.strip():
            slot = _integer(line, "GLONASS SLOT / FRQ # slot", column + 1, 2)
            channel = _integer(line, f"GLONASS SLOT / FRQ # of R{slot:02d}", column + 3, 3)
            if not -7 <= channel <= 6:
                raise line.error(f"GLONASS SLOT / FRQ #: channel {channel} of R{slot:02d}")
            header.glonass_channels[slot] = channel


def _read_phase_shift(header: RinexObservationHeader, line: Line, _: Iterator[Line]) -> None:
    signal = line.text[:5].rstrip()
    if len(signal) == 5:
        is_known = line.text[6:14].strip()
        shift = read_number(line, "SYS / PHASE SHIFT", 6, 8) if is_known else 0.0
        header.phase_shifts[signal] = shift


def _read_scale_factor(
    header: RinexObservationHeader, line: Line, following: Iterator[Line]
) -> None:
    label = "SYS / SCALE FACTOR"
    letter, factor = line.text[0], read_number(line, label, 2, 4)
    if factor <= 0.0:
        raise line.error(f"{label}: {factor:g}")
    count = _integer(line, label, 8, 2) if line.text[8:10].strip() else 0
    if count == 0:
        header.scale_factors[letter, ""] = factor
        return
    places = [(11 + 4 * i, 3) for i in range(12)]
    for name in _type_names(line, following, label, count, places):
        header.scale_factors[letter, name] = factor


def _read_wavelength(header: RinexObservationHeader, line: Line, _: Iterator[Line]) -> None:
    # Lines with a count of satellites are exceptions to the first one and too rare to matter.
    if not line.text[12:18].strip().strip("0") and line.text[:12].strip():
        first = _integer(line, "WAVELENGTH FACT L1/2", 0, 6)
        second = _integer(line, "WAVELENGTH FACT L1/2", 6, 6) if line.text[6:12].strip() else 1
        header.wavelength_factors = (first, second)


def _read_leap_seconds(header: RinexObservationHeader, line: Line, _: Iterator[Line]) -> None:
    # With BDS as reference the number counts from BDT, as RINEX 3.04 defined.
    if line.text[24:27] != "BDS":
        header.leap_seconds = _integer(line, "LEAP SECONDS", 0, 6)


def _read_comment(header: RinexObservationHeader, line: Line, _: Iterator[Line]) -> None:
    header.comments = (*header.comments, line.text[:LABEL_COLUMN].rstrip())


_READERS: dict[str, Callable[[RinexObservationHeader, Line, Iterator[Line]], None]] = {
    "MARKER NAME": _read_marker_name,
    "MARKER NUMBER": _read_marker_number,
    "MARKER TYPE": _read_marker_type,
    "REC # / TYPE / VERS": _read_receiver,
    "ANT # / TYPE": _read_antenna,
    "APPROX POSITION XYZ": _read_position,
    "ANTENNA: DELTA H/E/N": _read_delta_hen,
    "ANTENNA: DELTA X/Y/Z": _read_delta_xyz,
    "INTERVAL": _read_interval,
    "SYS / # / OBS TYPES": _read_types_3,
    "# / TYPES OF OBSERV": _read_types_2,
    "TIME OF FIRST OBS": _read_time,
    "TIME OF LAST OBS": _read_time,
    "RCV CLOCK OFFS APPL": _read_clock_applied,
    "GLONASS SLOT / FRQ #": _read_glonass,
    "SYS / PHASE SHIFT": _read_phase_shift,
    "SYS / SCALE FACTOR": _read_scale_factor,
    "WAVELENGTH FACT L1/2": _read_wavelength,
    "LEAP SECONDS": _read_leap_seconds,
    "COMMENT": _read_comment,
}
