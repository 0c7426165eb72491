"""Reader of RINEX 2, 3 and 4 navigation files (RINEX 2.11, 3.05, 4.01; IGS/RTCM-SC104)."""

from __future__ import annotations

import itertools
import pathlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.ionosphere_parameters import KlobucharParameters, NeQuickParameters
from vtff_gnss.rinex.compressed_file import decompress, read_file
from vtff_gnss.rinex.errors import RinexError
from vtff_gnss.rinex.navigation_records import Line, read_ephemeris, read_number

__all__ = ["RinexNavigation", "parse_rinex_navigation", "read_rinex_navigation"]

_LABEL_COLUMN = 60
# Message types of RINEX 4 that are read, by satellite system; the only ones of RINEX 2 and 3.
_EPHEMERIS_MESSAGES = {"G": ("LNAV",), "E": ("INAV", "FNAV")}


@dataclass(frozen=True)
class RinexNavigation:
    """Content of a navigation file.

    Parameters
    ----------
    version : float
    ephemerides : tuple of BroadcastEphemeris
        GPS LNAV and Galileo I/NAV and F/NAV, in the order of the file.
    klobuchar : KlobucharParameters or None
        The last ones of GPS.
    nequick : NeQuickParameters or None
        The last ones of Galileo.
    leap_seconds : int or None
        GPS - UTC of the header, s.
    skipped_records : dict of str to int
        Number of records not read, by system letter or, in RINEX 4, as ``"C EPH D1"``.
    """

    version: float
    ephemerides: tuple[BroadcastEphemeris, ...]
    klobuchar: KlobucharParameters | None
    nequick: NeQuickParameters | None
    leap_seconds: int | None
    skipped_records: dict[str, int]


class _Content:
    """Content of a navigation file, filled line by line."""

    def __init__(self) -> None:
        self.version = 0.0
        self.ephemerides: list[BroadcastEphemeris] = []
        self.klobuchar: dict[str, tuple[float, ...]] = {}
        self.nequick: tuple[float, float, float] | None = None
        self.leap_seconds: int | None = None
        self.skipped_records: dict[str, int] = {}

    def skip(self, kind: str) -> None:
        self.skipped_records[kind] = self.skipped_records.get(kind, 0) + 1

    def result(self) -> RinexNavigation:
        klobuchar = None
        if len(self.klobuchar) == 2:
            a, b = self.klobuchar["alpha"], self.klobuchar["beta"]
            klobuchar = KlobucharParameters((a[0], a[1], a[2], a[3]), (b[0], b[1], b[2], b[3]))
        return RinexNavigation(
            version=self.version,
            ephemerides=tuple(self.ephemerides),
            klobuchar=klobuchar,
            nequick=None if self.nequick is None else NeQuickParameters(self.nequick),
            leap_seconds=self.leap_seconds,
            skipped_records=dict(sorted(self.skipped_records.items())),
        )


class _Body:
    """Lines after the header.

    Most lines of a file are of no use, so that they become `Line` only where they are read.

    Parameters
    ----------
    path : pathlib.Path
    texts : list of str
        All lines of the file.
    start : int
        Index of the first line after the header.
    """

    def __init__(self, path: pathlib.Path, texts: list[str], start: int) -> None:
        self.texts = texts
        self._path = path
        self._start = start

    def lines(self, indices: range) -> list[Line]:
        """Return the lines with some indices that are not blank."""
        return [
            Line(self._path, index + 1, self.texts[index])
            for index in indices
            if self.texts[index].strip()
        ]

    def records(self, is_start: Callable[[str], bool]) -> Iterator[range]:
        """Yield the indices of the lines of each record.

        A record begins where the predicate holds for the first three characters of a line. Blank
        lines belong to no record.
        """
        texts = self.texts
        heads = [text[:3] for text in texts[self._start :]]
        # Most lines have one of a few heads: the predicate is asked once for each.
        begins = {head: is_start(head) for head in set(heads)}
        starts = [
            index
            for index, head in enumerate(heads, self._start)
            if begins[head] and texts[index].strip()
        ]
        before = self.lines(range(self._start, starts[0] if starts else len(texts)))
        if before:
            raise before[0].error("record: no satellite in the first line after the header")
        for start, end in itertools.pairwise([*starts, len(texts)]):
            yield range(start, end)


def read_rinex_navigation(path: str | pathlib.Path) -> RinexNavigation:
    """Read a navigation file; gzip, bzip2, zip and Unix compress are found by content.

    RINEX 2: GPS files. RINEX 3 and 4: GPS and Galileo of any file; records of other systems and
    message types are counted in `skipped_records`.

    Raises
    ------
    RinexError
        If the file is not a navigation file of these versions, or if a value of a record that is
        read is missing or malformed; the message is ``file:line: satellite field: reason``.
    OSError
        If the file cannot be read.
    """
    path = pathlib.Path(path)
    return parse_rinex_navigation(read_file(path), path)


def parse_rinex_navigation(
    content: bytes, path: str | pathlib.Path, systems: str | None = None
) -> RinexNavigation:
    """Read the bytes of a navigation file; see `read_rinex_navigation`.

    Only ephemerides of `systems` are read, letters as in RINEX; of all systems if it is None.
    """
    path = pathlib.Path(path)
    texts = decompress(content, path).decode("ascii", errors="replace").splitlines()
    found = _Content()
    header = [Line(path, number, text) for number, text in enumerate(_header_texts(texts), start=1)]
    _read_header(path, iter(header), found)
    body = _Body(path, texts, len(header))
    letters = "".join(_EPHEMERIS_MESSAGES) if systems is None else systems
    if found.version < 3.0:
        _read_records_2(body, letters, found)
    elif found.version < 4.0:
        _read_records_3(body, letters, found)
    else:
        _read_records_4(body, letters, found)
    return found.result()


def _header_texts(texts: list[str]) -> list[str]:
    """Return the lines of the header, its last one included; all lines if it has no end."""
    for number, text in enumerate(texts, start=1):
        if text[_LABEL_COLUMN:].strip() == "END OF HEADER":
            return texts[:number]
    return texts


def _read_header(path: pathlib.Path, lines: Iterator[Line], content: _Content) -> None:
    first = next(lines, None)
    if first is None or first.text[_LABEL_COLUMN:].strip() != "RINEX VERSION / TYPE":
        raise RinexError(f"{path}:1: not a RINEX file: no RINEX VERSION / TYPE")
    content.version = read_number(first, "version", 0, 9)
    if not 2.0 <= content.version < 5.0:
        raise RinexError(f"{path}:1: RINEX version {content.version:g} is not supported")
    if first.text[20] != "N":
        raise RinexError(f"{path}:1: file type {first.text[20]!r}: 'N' (navigation) is required")
    for line in lines:
        label = line.text[_LABEL_COLUMN:].strip()
        if label == "END OF HEADER":
            return
        if label in ("ION ALPHA", "ION BETA"):
            values = tuple(read_number(line, label, 2 + 12 * i, 12) for i in range(4))
            content.klobuchar[label[4:].lower()] = values
        elif label == "IONOSPHERIC CORR":
            _read_ionosphere_header(line, content)
        elif label == "LEAP SECONDS":
            content.leap_seconds = int(read_number(line, label, 0, 6))
    raise RinexError(f"{path}: END OF HEADER is missing")


def _read_ionosphere_header(line: Line, content: _Content) -> None:
    """Read a line of RINEX 3; those of systems other than GPS and Galileo do not matter here."""
    kind = line.text[:4].rstrip()
    if kind in ("GPSA", "GPSB"):
        values = tuple(read_number(line, kind, 5 + 12 * i, 12) for i in range(4))
        content.klobuchar["alpha" if kind == "GPSA" else "beta"] = values
    elif kind == "GAL":
        first, second, third = (read_number(line, kind, 5 + 12 * i, 12) for i in range(3))
        content.nequick = (first, second, third)


def _read_records_2(body: _Body, systems: str, content: _Content) -> None:
    for lines in body.records(lambda head: bool(head.strip())) if "G" in systems else ():
        record = body.lines(lines)
        satellite = f"G{int(read_number(record[0], 'satellite number', 0, 2)):02d}"
        content.ephemerides.append(read_ephemeris(record, satellite, "LNAV", indent=3))


def _read_records_3(body: _Body, systems: str, content: _Content) -> None:
    for lines in body.records(lambda head: head[:1] != " "):
        satellite = body.texts[lines[0]][:3]
        if satellite[0] not in _EPHEMERIS_MESSAGES:
            content.skip(satellite[0])
        if satellite[0] not in _EPHEMERIS_MESSAGES or satellite[0] not in systems:
            continue
        record = body.lines(lines)
        content.ephemerides.append(read_ephemeris(record, satellite, None, indent=4))


def _read_records_4(body: _Body, systems: str, content: _Content) -> None:
    for lines in body.records(lambda head: head[:1] == ">"):
        record = body.lines(lines)
        words = record[0].text[1:].split()
        if len(words) < 3:
            raise record[0].error("record: '> type satellite message' is required")
        kind, satellite, message = words[:3]
        if kind == "EPH" and message in _EPHEMERIS_MESSAGES.get(satellite[0], ()):
            if len(record) < 2:
                raise record[0].error(f"{satellite}: the record ends early")
            if satellite[0] in systems:
                content.ephemerides.append(read_ephemeris(record[1:], satellite, message, indent=4))
        elif kind == "ION" and (satellite[0], message) in (("G", "LNAV"), ("E", "IFNV")):
            _read_ionosphere_record(record, satellite[0], content)
        else:
            content.skip(f"{satellite[0]} {kind} {message}")


def _read_ionosphere_record(record: list[Line], system: str, content: _Content) -> None:
    """Read an ION record of RINEX 4: three values after the epoch, then four to a line."""
    places = [(1, column) for column in (23, 42, 61)]
    places += [(row, column) for row in (2, 3) for column in (4, 23, 42, 61)]
    values: list[float] = []
    for row, column in places[: 8 if system == "G" else 3]:
        if row >= len(record):
            raise record[-1].error("ION: the record ends early")
        values.append(read_number(record[row], f"ION parameter {len(values)}", column, 19))
    if system == "G":
        content.klobuchar = {"alpha": tuple(values[:4]), "beta": tuple(values[4:])}
    else:
        content.nequick = (values[0], values[1], values[2])
