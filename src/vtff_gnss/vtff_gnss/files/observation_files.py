"""One way into every observation file: RINEX of any kind, NovAtel receiver logs."""

from __future__ import annotations

import pathlib
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass

import numpy as np

from vtff_gnss.constants import SYSTEM_LETTERS
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.fix import STATUS_NONE, Fix
from vtff_gnss.novatel import ReceiverLogStream, StreamCounters
from vtff_gnss.novatel.events import Event
from vtff_gnss.novatel.stream import RawLogs
from vtff_gnss.observation_table import ObservationTable
from vtff_gnss.observations import ObservationEpoch
from vtff_gnss.rinex.compressed_file import is_hatanaka, is_rinex, read_decompressed
from vtff_gnss.rinex.errors import RinexError
from vtff_gnss.rinex.navigation import parse_rinex_navigation
from vtff_gnss.rinex.observation import parse_rinex_observation

__all__ = [
    "ObservationFile",
    "ObservationFileError",
    "check_receiver_log",
    "open_ephemerides",
    "open_observations",
]

Progress = Callable[[int, int], None]

# Starts of NovAtel frames: long and short binary headers, ASCII logs.
_NOVATEL_START = re.compile(rb"\xaaD[\x12\x13]|[#%][A-Z][A-Z0-9]{2,}A?,")
_CHUNK_LENGTH = 1 << 16
_TYPE_COLUMN = 20


class ObservationFileError(ValueError):
    """A file holds no usable observations; the message names it and, where it can, the line."""


@dataclass(frozen=True)
class ObservationFile:
    """Recording of one receiver.

    Parameters
    ----------
    path : pathlib.Path
    format_name : str
        For people: ``"RINEX 3.05 (Hatanaka)"``, ``"NovAtel RANGECMP"``.
    table : ObservationTable
        All epochs.
    ephemerides : tuple of BroadcastEphemeris
        Found in the file, in its order; RINEX observation files have none.
    approximate_position : tuple of 3 float or None
        Position of the antenna, ITRF, m: from the RINEX header (marker and antenna height), or
        the mean of the receiver's fixes if these stay within `ROOFTOP_EXTENT`.
    remarks : tuple of str
        Irregularities of the file in sentences: damage, observations left out.
    fixes : tuple of Fix
        Positions that the receiver computed itself, in a receiver log.
    """

    path: pathlib.Path
    format_name: str
    table: ObservationTable
    ephemerides: tuple[BroadcastEphemeris, ...]
    approximate_position: tuple[float, float, float] | None
    remarks: tuple[str, ...]
    fixes: tuple[Fix, ...] = ()

    def epochs(self) -> Iterator[ObservationEpoch]:
        """Yield the epochs."""
        return self.table.epochs()


ROOFTOP_EXTENT = 100.0
"""m; fixes of a receiver that does not move scatter less."""


def open_observations(
    path: str | pathlib.Path,
    systems: str | None = None,
    signals: Collection[str] | None = None,
    partial: bool = False,
    progress: Progress | None = None,
) -> ObservationFile:
    """Read an observation file whose format is found by its content.

    Parameters
    ----------
    path : path-like
        RINEX 2, 3 or 4, Compact RINEX, NovAtel log (binary, ASCII or mixed); any of them may be
        compressed.
    systems, signals : optional
        As in `read_rinex_observation`.
    partial : bool
        Whether a damaged RINEX file is read up to the damage, with a remark. Receiver logs are
        always read through to the end.
    progress : callable, optional
        Called as ``progress(bytes_read, bytes_total)`` while a receiver log is decoded.

    Raises
    ------
    ObservationFileError
        If the format is unknown, the file damaged, or without observations.
    OSError
        If the file cannot be read.
    """
    path = pathlib.Path(path)
    try:
        content = read_decompressed(path)
        if is_rinex(content):
            return _open_rinex(path, content, systems, signals, partial)
        if _NOVATEL_START.search(content):
            return _open_novatel(path, content, systems, signals, progress)
    except RinexError as error:
        raise ObservationFileError(str(error)) from None
    raise ObservationFileError(_describe_unknown(path, content))


def open_ephemerides(
    path: str | pathlib.Path, systems: str | None = None
) -> tuple[BroadcastEphemeris, ...]:
    """Read the broadcast ephemerides of a RINEX navigation file or a receiver log.

    Parameters
    ----------
    path : path-like
    systems : str, optional
        RINEX letters of the systems that are read, by default GPS and Galileo.

    Raises
    ------
    ObservationFileError
        If the file is something else, damaged, or has no ephemerides of GPS or Galileo.
    OSError
        If the file cannot be read.
    """
    path = pathlib.Path(path)
    try:
        content = read_decompressed(path)
        if is_rinex(content):
            ephemerides = parse_rinex_navigation(content, path, systems).ephemerides
        elif _NOVATEL_START.search(content):
            events = _novatel_events(content, StreamCounters(), None)
            ephemerides = tuple(
                event
                for event in events
                if isinstance(event, BroadcastEphemeris)
                and (systems is None or SYSTEM_LETTERS[event.system] in systems)
            )
        else:
            raise ObservationFileError(_describe_unknown(path, content))
    except RinexError as error:
        raise ObservationFileError(str(error)) from None
    if not ephemerides:
        names = "GPS or Galileo" if systems is None else f"systems {systems}"
        raise ObservationFileError(f"{path}: no ephemerides of {names} in this file")
    return ephemerides


def check_receiver_log(path: str | pathlib.Path) -> None:
    """Raise an error unless a file, compressed or not, holds an intact NovAtel log.

    The file is read up to the first one.

    Raises
    ------
    ObservationFileError
        If the file is something else, or every log of it is damaged.
    OSError
        If the file cannot be read.
    """
    path = pathlib.Path(path)
    try:
        content = read_decompressed(path)
    except RinexError as error:
        raise ObservationFileError(str(error)) from None
    if is_rinex(content):
        raise ObservationFileError(f"{path}: a RINEX file; a NovAtel log is required here")
    counters = StreamCounters()
    for _ in _novatel_events(content, counters, None, raw_logs="all"):
        if counters.frames_good:
            return
    if not content.strip():
        raise ObservationFileError(_describe_unknown(path, content))
    raise ObservationFileError(f"{path}: no NovAtel log that vtff reads was found in this file")


def _open_rinex(
    path: pathlib.Path,
    content: bytes,
    systems: str | None,
    signals: Collection[str] | None,
    partial: bool,
) -> ObservationFile:
    if not is_hatanaka(content) and content[_TYPE_COLUMN : _TYPE_COLUMN + 1] == b"N":
        raise ObservationFileError(
            f"{path}:1: a navigation file; an observation file is required here"
        )
    result = parse_rinex_observation(content, path, systems, signals, partial)
    remarks = list(result.remarks)
    if result.error is not None:
        remarks.append(f"only {len(result.table)} epochs were read: {result.error}")
    if not len(result.table.columns["prn"]):
        reason = f" ({remarks[-1]})" if remarks else ""
        raise ObservationFileError(f"{path}: no observations{_of(systems, signals)}{reason}")
    hatanaka = " (Hatanaka)" if is_hatanaka(content) else ""
    return ObservationFile(
        path=path,
        format_name=f"RINEX {result.header.version:.2f}{hatanaka}",
        table=result.table,
        ephemerides=(),
        approximate_position=result.header.antenna_position(),
        remarks=tuple(remarks),
    )


def _open_novatel(
    path: pathlib.Path,
    content: bytes,
    systems: str | None,
    signals: Collection[str] | None,
    progress: Progress | None,
) -> ObservationFile:
    counters = StreamCounters()
    events = list(_novatel_events(content, counters, progress))
    epochs = [event for event in events if isinstance(event, ObservationEpoch)]
    if not epochs:
        raise ObservationFileError(
            f"{path}: {counters.frames_good} NovAtel logs, but none with observations (RANGE, "
            f"RANGECMP, RANGECMP2, 4 or 5) of a receiver that knew the time"
        )
    # Where several range logs give the same epochs, the log that gives most of them.
    log_name = Counter(epoch.log_name for epoch in epochs).most_common(1)[0][0]
    chosen: list[ObservationEpoch] = []
    remarks = []
    for epoch in epochs:
        if epoch.log_name == log_name and (not chosen or epoch.time > chosen[-1].time):
            chosen.append(epoch)
    if len(chosen) < len(epochs):
        remarks.append(f"{len(epochs) - len(chosen)} epochs of other range logs or out of order")
    if counters.frames_crc_bad or counters.frames_truncated:
        remarks.append(
            f"{counters.frames_crc_bad} damaged and {counters.frames_truncated} cut-off logs"
        )
    fixes = [event for event in events if isinstance(event, Fix)]
    table = ObservationTable.from_epochs(chosen).select(systems, signals)
    if not len(table.columns["prn"]):
        raise ObservationFileError(f"{path}: no observations" + _of(systems, signals))
    return ObservationFile(
        path=path,
        format_name=f"NovAtel {log_name}",
        table=table,
        ephemerides=tuple(e for e in events if isinstance(e, BroadcastEphemeris)),
        approximate_position=_mean_position(fixes),
        remarks=tuple(remarks),
        fixes=tuple(fixes),
    )


def _novatel_events(
    content: bytes,
    counters: StreamCounters,
    progress: Progress | None,
    raw_logs: RawLogs = "none",
) -> Iterator[Event]:
    stream = ReceiverLogStream(counters=counters, raw_logs=raw_logs)
    for start in range(0, len(content), _CHUNK_LENGTH):
        yield from stream.feed(content[start : start + _CHUNK_LENGTH])
        if progress is not None:
            progress(min(start + _CHUNK_LENGTH, len(content)), len(content))
    yield from stream.close()


def _mean_position(fixes: list[Fix]) -> tuple[float, float, float] | None:
    positions = np.array([fix.position for fix in fixes if fix.status != STATUS_NONE])
    if not len(positions) or np.ptp(positions, axis=0).max() > ROOFTOP_EXTENT:
        return None
    x, y, z = np.median(positions, axis=0).tolist()
    return x, y, z


def _of(systems: str | None, signals: Collection[str] | None) -> str:
    chosen = [f"systems {systems}"] if systems is not None else []
    chosen += [f"signals {', '.join(sorted(signals))}"] if signals is not None else []
    return f" of {' and '.join(chosen)}" if chosen else " in this file"


def _describe_unknown(path: pathlib.Path, content: bytes) -> str:
    if not content.strip():
        return f"{path}: the file is empty"
    return f"{path}: neither RINEX nor a NovAtel log (begins with {content[:16]!r})"
