"""Reader of RINEX 2, 3 and 4 observation files (RINEX 2.11, 3.05, 4.01; IGS/RTCM-SC104)."""

from __future__ import annotations

import pathlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vtff_gnss.observation_table import ObservationTable
from vtff_gnss.observations import ObservationEpoch
from vtff_gnss.rinex.compressed_file import (
    decompress,
    decompress_hatanaka,
    is_hatanaka,
    read_file,
)
from vtff_gnss.rinex.errors import RinexError
from vtff_gnss.rinex.navigation_records import Line
from vtff_gnss.rinex.observation_continuity import set_lock_times
from vtff_gnss.rinex.observation_epochs import EpochRecords, RinexEvent, walk_epochs
from vtff_gnss.rinex.observation_header import LABEL_COLUMN, RinexObservationHeader, read_header
from vtff_gnss.rinex.observation_records import RecordReader, SignalRows
from vtff_gnss.rinex.observation_signals import RINEX2_ATTRIBUTES

__all__ = ["RinexObservations", "parse_rinex_observation", "read_rinex_observation"]


@dataclass(frozen=True)
class RinexObservations:
    """Content of an observation file.

    Parameters
    ----------
    header : RinexObservationHeader
        As at the top of the file.
    table : ObservationTable
        All observations; ``log_name`` is ``"RINEX"``.
    events : tuple of RinexEvent
        Event records (flags 2 to 5).
    remarks : tuple of str
        Warnings of the Hatanaka decompressor, header lines that could not be read, and epochs that
        are left out.
    error : RinexError or None
        With `partial`, what ended the reading; the table holds what was before.
    """

    header: RinexObservationHeader
    table: ObservationTable
    events: tuple[RinexEvent, ...]
    remarks: tuple[str, ...]
    error: RinexError | None

    def epochs(self) -> Iterator[ObservationEpoch]:
        """Yield the epochs."""
        return self.table.epochs()


def read_rinex_observation(
    path: str | pathlib.Path,
    systems: str | None = None,
    signals: Collection[str] | None = None,
    partial: bool = False,
    rinex2_attributes: Mapping[str, Mapping[str, str]] = RINEX2_ATTRIBUTES,
) -> RinexObservations:
    """Read an observation file: plain, Compact RINEX (Hatanaka), gzip, bzip2, zip or compress.

    The compression is found by content. All times are converted to GPS time, exactly.

    Parameters
    ----------
    path : path-like
    systems : str, optional
        Letters of the satellite systems to keep, e.g. ``"GE"``; default: all.
    signals : collection of str, optional
        Band and attribute of the signals to keep, e.g. ``("1C", "2W")``; default: all.
    partial : bool
        Return what is before the first malformed or incomplete epoch instead of raising; `error`
        then says what was wrong. The header must be intact.
    rinex2_attributes : mapping
        Signals behind the code types of RINEX 2; see `RINEX2_ATTRIBUTES`.

    Raises
    ------
    RinexError
        If the file is no observation file, or damaged; the message is ``file:line: reason``, with
        lines counted after decompression.
    OSError
        If the file cannot be read.

    Notes
    -----
    - A value that is blank or, as RINEX has it, 0.000 for code and phase, is NaN, and
      ``FLAG_CODE_VALID`` or ``FLAG_PHASE_VALID`` is absent.
    - C/N0 is the S value; without one, the middle of the class of the signal strength digit of the
      phase or code (6 dB wide, RINEX 3.05 section 5.7); else NaN. RINEX has no sigmas: NaN.
    - Bit 0 of the loss-of-lock digit sets ``FLAG_LOCK_LOST``; bit 1 removes
      ``FLAG_PARITY_KNOWN``. A power failure (epoch flag 1) and a reported slip (flag 6) set
      ``FLAG_LOCK_LOST`` too.
    - Lock times are not in the file: see `set_lock_times`.
    """
    path = pathlib.Path(path)
    content = read_file(path)
    return parse_rinex_observation(content, path, systems, signals, partial, rinex2_attributes)


def parse_rinex_observation(
    content: bytes,
    path: str | pathlib.Path,
    systems: str | None = None,
    signals: Collection[str] | None = None,
    partial: bool = False,
    rinex2_attributes: Mapping[str, Mapping[str, str]] = RINEX2_ATTRIBUTES,
) -> RinexObservations:
    """Read the bytes of an observation file; see `read_rinex_observation`."""
    name, remarks = str(path), tuple[str, ...]()
    content = decompress(content, path)
    if is_hatanaka(content):
        content, remarks = decompress_hatanaka(content, path)
        name = f"{path} (decompressed)"
    if not content or content.isspace():
        raise RinexError(f"{path}: the file is empty")
    lines = content.splitlines()
    header, start = _read_header(lines, name)
    records = walk_epochs(lines, start, header, name)
    if records.error is None and not content.endswith((b"\n", b"\r")):
        _check_last_line(lines, records, header, name)
    reader = RecordReader(lines, header, name, systems, signals, rinex2_attributes)
    rows = reader.read(records.batches)
    slips = reader.read(records.slips)
    # Malformed fields are in epochs that were walked, so before what ended the walk.
    error = min(reader.errors, key=lambda e: e.line_number, default=None)
    epoch_count = len(records.times) if error is None else error.epoch
    failure = records.error
    # A number that the end of the file has cut is not malformed.
    if error is not None and (failure is None or error.line_number < len(lines)):
        failure = error.error
    if failure is not None and not partial:
        raise failure
    return RinexObservations(
        header=header,
        table=_table(rows, slips, records, header, epoch_count, name),
        events=tuple(records.events),
        remarks=(*remarks, *header.remarks, *_describe_damaged(records)),
        error=failure,
    )


def _describe_damaged(records: EpochRecords) -> tuple[str, ...]:
    count = len(records.damaged)
    if count == 0:
        return ()
    verb = "epoch is" if count == 1 else "epochs are"
    return (f"{count} damaged {verb} left out, the first: {records.damaged[0]}",)


def _read_header(lines: Sequence[bytes], name: str) -> tuple[RinexObservationHeader, int]:
    count = len(lines)
    for number, line in enumerate(lines):
        if line[LABEL_COLUMN:].strip() == b"END OF HEADER":
            count = number + 1
            break
        if number == 0 and line[LABEL_COLUMN:].strip() != b"RINEX VERSION / TYPE":
            count = 1
            break
    texts = [Line(name, i + 1, lines[i].decode("ascii", "replace")) for i in range(count)]
    return read_header(iter(texts)), count


def _check_last_line(
    lines: Sequence[bytes], records: EpochRecords, header: RinexObservationHeader, name: str
) -> None:
    """Take a last line without line end as cut off, unless it is complete."""
    batch = records.batches[-1]
    if not batch.line_indices:
        return
    letter = batch.satellites[-1][:1].decode("ascii", "replace")
    if header.version < 3.0:
        last = batch.line_indices[-1] + batch.lines_per_record_2 - 1
        width = 16 * ((len(batch.types[""]) - 1) % 5 + 1)
    else:
        last = batch.line_indices[-1]
        width = 3 + 16 * len(batch.types.get(letter, ()))
    # Two characters less: those of loss of lock and signal strength are often left out.
    if last == len(lines) - 1 and len(lines[last]) < width - 2:
        records.error = RinexError(f"{name}:{last + 1}: the file ends inside this line")
        del records.times[-1], records.clock_offsets[-1]


def _table(
    rows: SignalRows,
    slips: SignalRows,
    records: EpochRecords,
    header: RinexObservationHeader,
    epoch_count: int,
    name: str,
) -> ObservationTable:
    rows = rows.before_epoch(epoch_count)
    time = np.array(records.times[:epoch_count], dtype=np.int64)
    set_lock_times(rows, slips, time, records.power_failures, header.interval, name)
    return ObservationTable(
        time_nanoseconds=time,
        first_row=np.searchsorted(rows.epoch, np.arange(epoch_count + 1)),
        columns=rows.columns,
        receiver_clock_offset=np.array(records.clock_offsets[:epoch_count], dtype=np.float64),
        time_status=np.zeros(epoch_count, dtype=np.uint8),
        receiver_status=np.zeros(epoch_count, dtype=np.uint32),
        log_name="RINEX",
    )
