"""Large tables of results as Parquet or CSV files.

Parquet is the default: it keeps types and all digits, is a fifth of the size, and its metadata hold
what a CSV file cannot: the unit of each column, the first and last time, what was processed, and
the version. Small tables for people (figures of a study beside the paper's) stay CSV.
"""

from __future__ import annotations

import json
import pathlib
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
from pyarrow import csv, parquet

from vtff_bag.run.environment import vtff_version

__all__ = ["file_metadata", "table_of_columns", "unit_of_column", "with_units", "write_table"]

#: Units by the end of a column's name; a length or time in SI units has none in its name.
_UNITS = {
    "_deg": "deg",
    "_tecu": "TECU",
    "_tecu_per_minute": "TECU/min",
    "_dbhz": "dB-Hz",
    "_hz": "Hz",
    "_seconds": "s",
    "_ns": "ns",
}


def unit_of_column(name: str) -> str:
    """Return the unit that the end of a column's name tells; empty if it tells none."""
    ends = [end for end in _UNITS if name.endswith(end)]
    return _UNITS[max(ends, key=len)] if ends else ""


def table_of_columns(columns: Mapping[str, npt.NDArray[Any]]) -> pa.Table:
    """Return a table of numpy columns: numbers, times (datetime64) or texts, all of one length.

    ``pa.table`` and ``pa.array`` import pandas to see whether it made them, which takes 0.3 s.
    """
    return pa.Table.from_arrays([*map(_arrow_array, columns.values())], names=[*columns])


def _arrow_array(column: npt.NDArray[Any]) -> pa.Array:
    if column.dtype.kind != "U":
        buffer = pa.py_buffer(np.ascontiguousarray(column))
        return pa.Array.from_buffers(pa.from_numpy_dtype(column.dtype), len(column), [None, buffer])
    words = column.tolist()
    encoded = {word: word.encode() for word in set(words)}  # few, such as satellites
    texts = [encoded[word] for word in words]
    ends = np.cumsum([0, *map(len, texts)], dtype=np.int32)
    return pa.StringArray.from_buffers(
        len(texts), pa.py_buffer(ends), pa.py_buffer(b"".join(texts))
    )


def file_metadata(
    first_time: str, last_time: str, about: Mapping[str, Any]
) -> dict[bytes | str, bytes | str]:
    """Return the metadata of a Parquet file.

    Parameters
    ----------
    first_time, last_time
        Times of the first and last row with their scale, such as ``2024-01-10 00:00:00 GPS``.
    about
        What the table is: texts or numbers by name.
    """
    told = {"first_time": first_time, "last_time": last_time, **about, "vtff": vtff_version()}
    return {"vtff": json.dumps(told, ensure_ascii=False)}


def with_units(
    schema: pa.Schema, units: Mapping[str, str], descriptions: Mapping[str, str] | None = None
) -> pa.Schema:
    """Return a schema whose fields tell their units, and what they are where that is given.

    Parameters
    ----------
    schema
        Names and types of the columns.
    units
        Unit by name of the column; else that of `unit_of_column`.
    descriptions
        Description by name of the column.
    """
    fields = []
    for field in schema:
        told = {"unit": units.get(field.name) or unit_of_column(field.name)}
        told["description"] = (descriptions or {}).get(field.name, "")
        fields.append(field.with_metadata({key: text for key, text in told.items() if text}))
    return pa.schema(fields, metadata=schema.metadata)


def write_table(
    table: pa.Table,
    path: pathlib.Path,
    units: Mapping[str, str],
    metadata: Mapping[bytes | str, bytes | str],
) -> pathlib.Path:
    """Write a table in the form that the suffix of the path names; return the path.

    Parameters
    ----------
    table
        The table.
    path
        File, ``.parquet`` or ``.csv``.
    units
        Units of the columns; see `with_units`.
    metadata
        `file_metadata`.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    if path.suffix == ".csv":
        csv.write_csv(table, path)
    else:
        schema = with_units(table.schema, units).with_metadata(dict(metadata))
        # The types are equal, and `cast` would import all functions of Arrow.
        parquet.write_table(pa.Table.from_arrays(table.columns, schema=schema), path)
    return path
