"""Writer of RINEX 3.05 observation files (IGS/RTCM-SC104)."""

from __future__ import annotations

import os
import pathlib
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from vtff_gnss import constants as c
from vtff_gnss.observation_table import ObservationTable, signal_keys
from vtff_gnss.observations import ObservationEpoch
from vtff_gnss.rinex.write.header import first_lines, header_line, time_fields

__all__ = ["format_rinex_observation", "write_rinex_observation"]

_QUANTITIES = "CLDS"
_BLANK = " " * 16
# What F14.3 can hold.
_LARGEST, _SMALLEST = 9999999999.999, -999999999.999
_TYPES_PER_LINE = 13
_SLOTS_PER_LINE = 8
_STRENGTH_STEP_DBHZ = 6.0

_Signal = tuple[int, int, int]


def write_rinex_observation(
    path: str | os.PathLike[str],
    observations: ObservationTable | Iterable[ObservationEpoch],
    **settings: Any,
) -> None:
    """Write observations as RINEX 3.05; settings and errors are those of the text.

    See `format_rinex_observation`.
    """
    content = format_rinex_observation(observations, **settings)
    pathlib.Path(path).write_text(content, encoding="ascii", newline="\n")


def format_rinex_observation(
    observations: ObservationTable | Iterable[ObservationEpoch],
    marker_name: str = "",
    approximate_position: tuple[float, float, float] = (0.0, 0.0, 0.0),
    marker_type: str = "",
    receiver: tuple[str, str, str] = ("", "", ""),
    antenna: tuple[str, str] = ("", ""),
    interval: float | None = None,
    comments: tuple[str, ...] = (),
    created: str = "",
) -> str:
    """Return observations as the text of a RINEX 3.05 file.

    Parameters
    ----------
    observations : ObservationTable or iterable of ObservationEpoch
        In the order of time.
    marker_name, marker_type : str
        At most 60 and 20 characters; type ``"SPACEBORNE"`` for a spacecraft.
    approximate_position : tuple of 3 float
        ITRF, m; zeros where unknown or moving.
    receiver, antenna : tuple of str
        Number, type and version; number and type.
    interval : float, optional
        s; default: the median step.
    comments : tuple of str
        Lines of at most 60 characters.
    created : str
        Date for the header; see `first_lines`.

    Raises
    ------
    ValueError
        If there is no epoch, or if a text does not fit.

    Notes
    -----
    - Values whose ``FLAG_*_VALID`` is absent, NaN, or that do not fit the format are left blank;
      without valid phase the Doppler shift too. Sigmas, lock times and receiver status have no
      place in RINEX.
    - Resolution: 1 mm, 0.001 cycle, 0.001 Hz, 0.001 dB-Hz, 100 ns.
    - ``FLAG_LOCK_LOST`` and a change of ``FLAG_HALF_CYCLE_ADDED`` set bit 0 of the loss-of-lock
      digit; the absence of ``FLAG_PARITY_KNOWN`` sets bit 1.
    - Phases are written as the receiver gives them; the phase shift records say so.
    """
    table = observations
    if not isinstance(table, ObservationTable):
        table = ObservationTable.from_epochs(table)
    if not len(table):
        raise ValueError("observations: there is no epoch to write")
    if interval is None and len(table) > 1:
        interval = float(np.median(np.diff(table.time_nanoseconds))) * 1e-9
    layout = _Layout(table)
    systems = sorted(layout.types, key=c.SYSTEM_LETTERS.index)
    file_system = systems[0] if len(systems) == 1 else "M"
    position = "".join(f"{x:14.4f}" for x in approximate_position)
    lines = [
        first_lines("OBSERVATION DATA", file_system, created),
        *(header_line(comment, "COMMENT") for comment in comments),
        header_line(marker_name, "MARKER NAME"),
        header_line(f"{marker_type:<20}", "MARKER TYPE"),
        header_line("", "OBSERVER / AGENCY"),
        header_line("".join(f"{text:<20.20}" for text in receiver), "REC # / TYPE / VERS"),
        header_line("".join(f"{text:<20.20}" for text in antenna), "ANT # / TYPE"),
        header_line(position, "APPROX POSITION XYZ"),
        header_line(f"{0.0:14.4f}" * 3, "ANTENNA: DELTA H/E/N"),
        *(line for letter in systems for line in _type_lines(letter, layout.types[letter])),
        header_line("DBHZ", "SIGNAL STRENGTH UNIT"),
    ]
    lines += _description_lines(table, systems, interval)
    lines += _epoch_lines(table, layout)
    return "".join(lines)


def _description_lines(
    table: ObservationTable, systems: list[str], interval: float | None
) -> Iterator[str]:
    """Return the header lines that the observations themselves determine, and the last one."""
    if interval is not None:
        yield header_line(f"{interval:10.3f}", "INTERVAL")
    for index, label in ((0, "TIME OF FIRST OBS"), (len(table) - 1, "TIME OF LAST OBS")):
        *date, second = time_fields(table.time(index))
        text = "".join(f"{number:6d}" for number in date) + f"{second:13.7f}{'':5}GPS"
        yield header_line(text, label)
    for letter in systems:
        yield header_line(letter, "SYS / PHASE SHIFT")
    if "R" in systems:
        yield from _glonass_lines(table)
    yield header_line("", "END OF HEADER")


class _Layout:
    """Which signals and quantities a table has, and the text of every row."""

    def __init__(self, table: ObservationTable) -> None:
        columns = table.columns
        texts = _quantity_texts(table)
        keys = signal_keys({**columns, "prn": np.zeros_like(columns["prn"])})
        signals, member = np.unique(keys, return_inverse=True)
        self.types: dict[str, list[str]] = {}
        self.first_column: dict[int, int] = {}
        self.width: dict[str, int] = {}
        self.cells: list[str] = [""] * len(keys)
        for index, signal in enumerate(signals.tolist()):
            rows = np.flatnonzero(member == index)
            first = rows[0]
            letter = c.SYSTEM_LETTERS[columns["system"][first]]
            name = f"{columns['band'][first]}{chr(columns['attribute'][first])}"
            used = [q for q in _QUANTITIES if any(texts[q][row] != _BLANK for row in rows)]
            listed = self.types.setdefault(letter, [])
            self.first_column[signal] = len(listed)
            listed += [quantity + name for quantity in used]
            for row in rows.tolist():
                self.cells[row] = "".join(texts[quantity][row] for quantity in used)
        self.signal = keys.tolist()


def _quantity_texts(table: ObservationTable) -> dict[str, list[str]]:
    """Return the 16 characters of each value: F14.3, loss of lock, signal strength."""
    columns = table.columns
    flags = columns["flags"]
    has_phase = (flags & c.FLAG_PHASE_VALID) != 0
    lock = _loss_of_lock(columns, flags) * has_phase
    cn0 = columns["cn0_dbhz"].astype(np.float64)
    strength = np.nan_to_num(np.clip(cn0 // _STRENGTH_STEP_DBHZ, 1, 9)).astype(int)
    digits = [
        f"{lost or ' '}{strong or ' '}"
        for lost, strong in zip(lock.tolist(), strength.tolist(), strict=True)
    ]
    plain = ["  "] * len(digits)
    return {
        "C": _texts(columns["pseudorange"], (flags & c.FLAG_CODE_VALID) != 0, plain),
        "L": _texts(columns["carrier_phase_cycles"], has_phase, digits),
        "D": _texts(columns["doppler_hz"], has_phase, plain),
        "S": _texts(cn0, np.ones_like(has_phase), plain),
    }


def _texts(
    values: npt.NDArray[np.floating], is_valid: npt.NDArray[np.bool_], digits: list[str]
) -> list[str]:
    values = values.astype(np.float64)
    fits = is_valid & (values < _LARGEST) & (values > _SMALLEST)
    return [
        f"{value:14.3f}{two}" if good else _BLANK
        for value, good, two in zip(values.tolist(), fits.tolist(), digits, strict=True)
    ]


def _loss_of_lock(
    columns: dict[str, npt.NDArray[np.generic]], flags: npt.NDArray[np.uint16]
) -> npt.NDArray[np.intp]:
    """Return the loss-of-lock digit of every row."""
    order = np.argsort(signal_keys(columns), kind="stable")
    keys = signal_keys(columns)[order]
    added = (flags[order] & c.FLAG_HALF_CYCLE_ADDED) != 0
    is_changed = np.zeros(len(keys), dtype=np.bool_)
    is_changed[order[1:]] = (keys[1:] == keys[:-1]) & (added[1:] != added[:-1])
    is_lost = ((flags & c.FLAG_LOCK_LOST) != 0) | is_changed
    is_half = (flags & c.FLAG_PARITY_KNOWN) == 0
    return np.asarray(is_lost * 1 + is_half * 2, dtype=np.intp)


def _type_lines(letter: str, types: list[str]) -> Iterator[str]:
    for start in range(0, len(types), _TYPES_PER_LINE):
        head = f"{letter}{len(types):5d}" if start == 0 else " " * 6
        names = "".join(f" {name}" for name in types[start : start + _TYPES_PER_LINE])
        yield header_line(head + names, "SYS / # / OBS TYPES")


def _glonass_lines(table: ObservationTable) -> Iterator[str]:
    """Return the frequency channels, as far as known; both records are mandatory."""
    columns = table.columns
    chosen = (columns["system"] == c.SYSTEM_GLONASS) & (
        columns["glonass_channel"] != c.GLONASS_CHANNEL_UNKNOWN
    )
    pairs = zip(columns["prn"][chosen].tolist(), columns["glonass_channel"][chosen].tolist(),
                strict=True)  # fmt: skip
    channels = sorted(dict(pairs).items())
    for start in range(0, max(len(channels), 1), _SLOTS_PER_LINE):
        head = f"{len(channels):3d} " if start == 0 else " " * 4
        entries = channels[start : start + _SLOTS_PER_LINE]
        text = head + "".join(f"R{slot:02d} {channel:2d} " for slot, channel in entries)
        yield header_line(text, "GLONASS SLOT / FRQ #")
    yield header_line("", "GLONASS COD/PHS/BIS")


def _epoch_lines(table: ObservationTable, layout: _Layout) -> Iterator[str]:
    system, prn = table.columns["system"].tolist(), table.columns["prn"].tolist()
    first_row = table.first_row.tolist()
    for index in range(len(table)):
        satellites: dict[tuple[int, int], list[int]] = {}
        for row in range(first_row[index], first_row[index + 1]):
            if layout.cells[row].strip():
                satellites.setdefault((system[row], prn[row]), []).append(row)
        year, month, day, hour, minute, second = time_fields(table.time(index))
        offset = table.receiver_clock_offset[index]
        clock = "" if np.isnan(offset) else f"{'':6}{offset:15.12f}"
        yield (
            f"> {year:04d} {month:02d} {day:02d} {hour:02d} {minute:02d}{second:11.7f}"
            f"  0{len(satellites):3d}{clock}\n"
        )
        for satellite, rows in sorted(satellites.items()):
            line = f"{c.SYSTEM_LETTERS[satellite[0]]}{satellite[1]:02d}"
            for row in sorted(rows, key=lambda row: layout.first_column[layout.signal[row]]):
                start = 3 + 16 * layout.first_column[layout.signal[row]]
                line = line.ljust(start) + layout.cells[row]
            yield line.rstrip() + "\n"
