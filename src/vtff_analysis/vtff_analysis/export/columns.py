"""Messages of a topic as flat, named columns."""

from __future__ import annotations

import array
import json
import re
from collections.abc import Iterable
from typing import Any

import numpy as np

LOG_TIME_COLUMN = "log_time_ns"

#: A fixed array up to this long becomes one column an element; 36 is a covariance of six.
LONGEST_FIXED = 36

_SEQUENCE = re.compile(r"^sequence<(.+?)(?:, \d+)?>$")
_FIXED = re.compile(r"^(.+)\[\d+\]$")
_ANYTHING = re.compile(r"^(.+)$")


def message_columns(messages: Iterable[tuple[int, Any]]) -> dict[str, list[Any]]:
    """Return messages as columns of equal length, one row a message.

    Parameters
    ----------
    messages
        Log time (ns since 1970) and message; all of one type.

    Returns
    -------
    dict
        `LOG_TIME_COLUMN`, then the fields in the order of the definition. A nested field has its
        path with dots (``header.frame_id``); a time becomes one column of ns since 1970; a short
        fixed array one column an element (``position[0]``); any other array stays a list.
    """
    columns: dict[str, list[Any]] = {LOG_TIME_COLUMN: []}
    for row, (log_time, message) in enumerate(messages):
        columns[LOG_TIME_COLUMN].append(log_time)
        for name, value in _flat("", message):
            column = columns.setdefault(name, [None] * row)
            column.append(value)
        for column in columns.values():
            if len(column) == row:
                column.append(None)
    return columns


def column_types(message: Any) -> dict[str, tuple[str, bool]]:
    """Return the type of each column of `message_columns`, in the same order.

    Parameters
    ----------
    message
        Any message of the type, for example a new one.

    Returns
    -------
    dict
        Column -> name of the element type as ROS tells it (``double``, ``uint8``, ``string``,
        ...), and whether the column holds lists. A list of messages is one of texts (JSON).
    """
    return {LOG_TIME_COLUMN: ("uint64", False), **dict(_types("", message))}


def _types(prefix: str, message: Any) -> Iterable[tuple[str, tuple[str, bool]]]:
    for field, declared in message.get_fields_and_field_types().items():
        name, value = f"{prefix}{field}", getattr(message, field)
        sequence, fixed = _SEQUENCE.match(declared), _FIXED.match(declared)
        element = (sequence or fixed or _ANYTHING.match(declared))[1]  # type: ignore[index]
        kind = "string" if "string" in element or "/" in element else element
        if _is_time(value):
            yield f"{name}_ns", ("int64", False)
        elif hasattr(value, "get_fields_and_field_types"):
            yield from _types(f"{name}.", value)
        elif isinstance(value, np.ndarray) and value.size <= LONGEST_FIXED:
            yield from ((f"{name}[{i}]", (kind, False)) for i in range(value.size))
        else:
            yield name, (kind, bool(sequence or fixed))


def exploded(columns: dict[str, list[Any]]) -> dict[str, list[Any]]:
    """Return columns without lists: one row an element where all lists of a message are alike.

    Messages that are columns themselves (observations, slant TEC) become one row a signal. A row
    whose lists are empty keeps its other values. Where the lists of a message differ in length
    they become texts instead.
    """
    lists = [name for name, column in columns.items() if any(_is_list(v) for v in column)]
    if not lists:
        return columns
    rows = len(columns[LOG_TIME_COLUMN])
    lengths = [{len(columns[name][row] or ()) for name in lists} for row in range(rows)]
    if any(len(length) > 1 for length in lengths):
        texts = {name: [_text(value) for value in columns[name]] for name in lists}
        return {name: texts.get(name, column) for name, column in columns.items()}
    counts = [max(1, *length) for length in lengths]
    return {
        name: (
            [item for row in range(rows) for item in (columns[name][row] or [None])]
            if name in lists
            else [value for value, n in zip(column, counts, strict=True) for _ in range(n)]
        )
        for name, column in columns.items()
    }


def _flat(prefix: str, message: Any) -> Iterable[tuple[str, Any]]:
    """Yield name and value of each field, nested ones too."""
    for field in message.get_fields_and_field_types():
        name, value = f"{prefix}{field}", getattr(message, field)
        if _is_time(value):
            yield f"{name}_ns", int(value.sec) * 1_000_000_000 + int(value.nanosec)
        elif hasattr(value, "get_fields_and_field_types"):
            yield from _flat(f"{name}.", value)
        elif isinstance(value, np.ndarray) and value.size <= LONGEST_FIXED:
            yield from ((f"{name}[{i}]", item) for i, item in enumerate(value.tolist()))
        else:
            yield name, _plain(value)


def _is_time(value: Any) -> bool:
    fields = getattr(value, "get_fields_and_field_types", dict)()
    return set(fields) == {"sec", "nanosec"}


def _plain(value: Any) -> Any:
    """Return a value as numbers, texts and lists of them."""
    if isinstance(value, (bytes, bytearray)):
        return int.from_bytes(value, "little") if len(value) == 1 else list(value)
    if isinstance(value, (np.ndarray, array.array)):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain_item(item) for item in value]
    return value


def _plain_item(item: Any) -> Any:
    """Return an element of a list; a nested message becomes a JSON text."""
    if hasattr(item, "get_fields_and_field_types"):
        return json.dumps(dict(_flat("", item)), ensure_ascii=False)
    return _plain(item)


def _is_list(value: Any) -> bool:
    return isinstance(value, list)


def _text(value: Any) -> str:
    return "" if value is None else repr(value)
