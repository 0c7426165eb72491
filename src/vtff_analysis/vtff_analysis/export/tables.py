"""Every topic of a bag as a CSV or Parquet file."""

from __future__ import annotations

import csv
import pathlib
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import pyarrow
from pyarrow import parquet

from vtff_analysis.export.columns import (
    LOG_TIME_COLUMN,
    column_comments,
    column_types,
    explode_columns,
    message_columns,
    unit_of_comment,
)
from vtff_analysis.large_tables import file_metadata, with_units
from vtff_analysis.recordings.topics import key_part
from vtff_bag.file.errors import BagReadError, UnknownTypeError
from vtff_bag.file.message_definitions import message_class
from vtff_bag.file.reader import BagReader

#: Messages turned into rows at once: bounds the memory of a long bag.
BATCH = 5000

#: Element type of a ROS field -> name of the type in pyarrow.
_ARROW_TYPES = {
    **{name: name for name in ("int8", "int16", "int32", "int64")},
    **{name: name for name in ("uint8", "uint16", "uint32", "uint64", "string")},
    "boolean": "bool_",
    "octet": "uint8",
    "char": "uint8",
    "float": "float32",
    "double": "float64",
}

_NANOSECONDS = "ns since 1970-01-01, UTC"

Progress = Callable[[str], None]
_Columns = dict[str, list[Any]]


def export_csv(
    reader: BagReader, folder: pathlib.Path, progress: Progress | None = None
) -> tuple[list[pathlib.Path], list[str]]:
    """Write each topic as ``<topic>.csv``: one row a message, or one a signal.

    Parameters
    ----------
    reader
        The bag.
    folder
        Folder of the files; must exist.
    progress
        Called with the name of each topic.

    Returns
    -------
    files, notes
        The files, and one line for each topic that is left out.
    """
    return _export(reader, folder, ".csv", _write_csv, progress)


def export_parquet(
    reader: BagReader, folder: pathlib.Path, progress: Progress | None = None
) -> tuple[list[pathlib.Path], list[str]]:
    """Write each topic as ``<topic>.parquet``: one row a message, arrays as lists.

    The metadata of a file tell the topic, its type and bag, first and last time and the version,
    those of its columns the unit and the comment of the message definition. Parameters and returns
    are those of `export_csv`.
    """
    return _export(reader, folder, ".parquet", _write_parquet, progress)


def _export(
    reader: BagReader,
    folder: pathlib.Path,
    suffix: str,
    write: Callable[[pathlib.Path, Iterator[_Columns], Any, Mapping[str, str]], None],
    progress: Progress | None,
) -> tuple[list[pathlib.Path], list[str]]:
    files, notes = [], []
    for name, topic in sorted(reader.topics.items()):
        if not topic.message_count:
            continue
        try:
            message_type = message_class(topic.type)
        except UnknownTypeError as error:
            notes.append(f"{name} is left out: {error}")
            continue
        if progress is not None:
            progress(name)
        path = folder / f"{key_part(name)}{suffix}"
        about = {"topic": name, "type": topic.type, "bag": reader.path.name}
        try:
            write(path, _read_batches(reader, name), message_type(), about)
        except BagReadError as error:
            notes.append(str(error))
        if path.exists():
            files.append(path)
    return files, notes


def _read_batches(reader: BagReader, topic: str) -> Iterator[dict[str, list[Any]]]:
    batch: list[tuple[int, Any]] = []
    for decoded in reader.messages(topic):
        batch.append((decoded.log_time, decoded.message))
        if len(batch) == BATCH:
            yield message_columns(batch)
            batch = []
    if batch:
        yield message_columns(batch)


def _write_csv(
    path: pathlib.Path, batches: Iterator[_Columns], example: Any, _about: Mapping[str, str]
) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        # repr gives the shortest text that reads back as the same number.
        writer = csv.writer(file)
        head = list(column_types(example))
        writer.writerow(head)
        for batch in batches:
            columns = explode_columns(batch)
            writer.writerows(zip(*(columns[name] for name in head), strict=True))


def _write_parquet(
    path: pathlib.Path, batches: Iterator[_Columns], example: Any, about: Mapping[str, str]
) -> None:
    # Types come from the definition, not from the first rows: their lists may be empty.
    kinds = {name: getattr(pyarrow, kind)() for name, kind in _ARROW_TYPES.items()}
    fields = [
        (name, pyarrow.list_(kinds[kind]) if is_list else kinds[kind])
        for name, (kind, is_list) in column_types(example).items()
    ]
    descriptions = column_comments(example)
    units = {name: unit_of_comment(comment) for name, comment in descriptions.items()}
    units.update({name: _NANOSECONDS for name, _ in fields if name.endswith("_ns")})
    schema = with_units(pyarrow.schema(fields), units, descriptions)
    ends: list[int] = []
    with parquet.ParquetWriter(path, schema) as writer:
        for batch in batches:
            writer.write_table(pyarrow.table(batch, schema=schema))
            times = batch[LOG_TIME_COLUMN]
            ends = [*ends[:1], times[-1]] if ends else [times[0], times[-1]]
        if ends:
            first, last = (_utc_text(time) for time in ends)
            writer.add_key_value_metadata(file_metadata(first, last, about))


def _utc_text(nanoseconds: int) -> str:
    """Return ns since 1970 as text, to the nanosecond; times beyond 2262 as their number."""
    if nanoseconds > np.iinfo(np.int64).max:
        return str(nanoseconds)
    return f"{np.datetime64(nanoseconds, 'ns')} UTC"
