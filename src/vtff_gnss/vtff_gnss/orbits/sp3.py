"""Reader of precise orbits and clocks in the formats SP3-a to SP3-d (Hilla 2016)."""

from __future__ import annotations

import math
import pathlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.vectors import FloatArray
from vtff_gnss.rinex.calendar_time import RinexClock
from vtff_gnss.rinex.compressed_file import read_decompressed
from vtff_gnss.rinex.errors import RinexError
from vtff_gnss.rinex.navigation_records import Line

__all__ = ["Sp3File", "is_sp3", "parse_sp3", "read_sp3"]

_VERSIONS = b"abcd"
_METRES_PER_KILOMETRE = 1e3
_SECONDS_PER_MICROSECOND = 1e-6
# A clock that is not known is 999999.999999; the format allows any number of nines after that.
_LARGEST_CLOCK = 999999.0  # microseconds


@dataclass(frozen=True, eq=False)
class Sp3File:
    """Positions and clocks of all satellites of a file, n epochs and m satellites.

    Parameters
    ----------
    name : str
        File, for messages.
    satellites : tuple of str
        Names as in the file: ``"G05"``, ``"L01"`` for a low orbiter.
    time_nanoseconds : ndarray of int64, shape (n,)
        GPS time, increasing.
    position_itrf : ndarray, shape (n, m, 3)
        Centre of mass, m; NaN where it is not known.
    clock_offset : ndarray, shape (n, m)
        Satellite clock less GPS time, s, without the periodic relativistic term; NaN where it is
        not known.
    """

    name: str
    satellites: tuple[str, ...]
    time_nanoseconds: npt.NDArray[np.int64]
    position_itrf: FloatArray
    clock_offset: FloatArray

    def __len__(self) -> int:
        """Return the number of epochs."""
        return len(self.time_nanoseconds)


def is_sp3(content: bytes) -> bool:
    """Return whether (decompressed) bytes begin like an SP3 file."""
    return content[:1] == b"#" and content[1:2] in _VERSIONS and content[2:3] in (b"P", b"V")


def read_sp3(path: str | pathlib.Path) -> Sp3File:
    """Read an SP3 file, compressed or not; see `parse_sp3`.

    Raises
    ------
    RinexError
        If the file is no SP3 file, or damaged; the message is ``file:line: reason``.
    OSError
        If the file cannot be read.
    """
    path = pathlib.Path(path)
    return parse_sp3(read_decompressed(path), path)


def parse_sp3(content: bytes, path: str | pathlib.Path) -> Sp3File:
    """Read the bytes of an SP3 file; velocities and standard deviations are passed over.

    Raises
    ------
    RinexError
        If the file is no SP3 file, or damaged.
    """
    name = str(path)
    if not is_sp3(content):
        raise RinexError(f"{name}:1: not an SP3 file (begins with {content[:16]!r})")
    texts = content.decode("ascii", errors="replace").splitlines()
    lines = [Line(name, number, text) for number, text in enumerate(texts, start=1)]
    clock = _time_system(lines)
    times: list[int] = []
    rows: list[tuple[int, str, tuple[float, ...]]] = []
    for line in lines[1:]:
        mark = line.text[:1]
        if mark == "*":
            time = _epoch(line, clock)
            if times and time <= times[-1]:
                raise line.error("epoch: not after the one before")
            times.append(time)
        elif mark == "P":
            if not times:
                raise line.error("position: no epoch before it")
            rows.append((len(times) - 1, _satellite(line.text[1:4]), _position_and_clock(line)))
        elif line.text.startswith("EOF"):
            break
    else:
        raise RinexError(f"{name}:{len(lines)}: the file ends without EOF: it is cut off")
    if not rows:
        raise RinexError(f"{name}: no position in this file")
    return _to_arrays(name, times, rows)


def _to_arrays(
    name: str, times: Sequence[int], rows: Sequence[tuple[int, str, tuple[float, ...]]]
) -> Sp3File:
    satellites = tuple(sorted({satellite for _, satellite, _ in rows}))
    column = {satellite: index for index, satellite in enumerate(satellites)}
    values = np.full((len(times), len(satellites), 4), np.nan)
    values[[row[0] for row in rows], [column[row[1]] for row in rows]] = [row[2] for row in rows]
    return Sp3File(
        name=name,
        satellites=satellites,
        time_nanoseconds=np.array(times, dtype=np.int64),
        position_itrf=values[..., :3],
        clock_offset=values[..., 3],
    )


def _satellite(field: str) -> str:
    """Return the name of a satellite; version a names GPS satellites by their number alone."""
    return field[:1].replace(" ", "G") + field[1:].replace(" ", "0")


def _time_system(lines: Sequence[Line]) -> RinexClock:
    """Return the clock of the first %c line; files of version a have GPS time."""
    for line in lines:
        if line.text.startswith("%c"):
            system = line.text[9:12].strip().upper()
            if system in ("", "CCC"):
                break
            try:
                return RinexClock(system)
            except ValueError as error:
                raise line.error(str(error)) from None
    return RinexClock("GPS")


def _epoch(line: Line, clock: RinexClock) -> int:
    words = line.text[1:].split()
    try:
        minute = " ".join(words[:5]).encode("ascii", "replace")
        return clock.nanoseconds(minute, f"{float(words[5]):11.7f}".encode("ascii"))
    except (ValueError, IndexError):
        raise line.error(f"epoch: {line.text[1:].strip()!r} is not a date and time") from None


def _position_and_clock(line: Line) -> tuple[float, ...]:
    """Return position in m and clock in s; NaN where the file has none."""
    numbers = []
    for start, field in ((4, "x"), (18, "y"), (32, "z"), (46, "clock")):
        text = line.text[start : start + 14].strip()
        if field == "clock" and not text:
            text = str(_LARGEST_CLOCK)
        try:
            numbers.append(float(text))
        except ValueError:
            raise line.error(f"{line.text[1:4]} {field}: {text!r} is not a number") from None
    has_position, has_clock = any(numbers[:3]), abs(numbers[3]) < _LARGEST_CLOCK
    position = [_METRES_PER_KILOMETRE * number if has_position else math.nan for number in numbers]
    return (*position[:3], _SECONDS_PER_MICROSECOND * numbers[3] if has_clock else math.nan)
