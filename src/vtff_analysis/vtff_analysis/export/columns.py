"""Messages of a topic as flat, named columns."""

from __future__ import annotations

import array
import json
import re
from collections.abc import Iterable
from typing import Any

import numpy as np

from vtff_node.message_text import field_comments
from vtff_node.stamps import to_nanoseconds

LOG_TIME_COLUMN = "log_time_ns"

#: Longest fixed array that becomes one column for each element: a covariance of 6 by 6.
LONGEST_FIXED = 36

_SEQUENCE = re.compile(r"^sequence<(.+?)(?:, \d+)?>$")
_FIXED = re.compile(r"^(.+)\[\d+\]$")
#: Units with which comments of message definitions begin, alone or before a remark.
_UNIT = re.compile(
    r"^((?:m|s|rad|deg|cycles|Hz|dB-Hz|TECU|electrons|kg|N|A|T|nT|V|K|%|ms|ns|rpm|sqrt\(s\))"
    r"(?:[ /^*.]?(?:m|s|rad|deg|min|sqrt\(s\)|-?\d+))*)(?=$|[,;:]| )"
)
_ANYTHING = re.compile(r"^(.+)$")


def message_columns(messages: Iterable[tuple[int, Any]]) -> dict[str, list[Any]]:
    """Return messages as columns of equal length, one row for each message.

    Parameters
    ----------
    messages
        Log time (ns since 1970) and message; all of one type.

    Returns
    -------
    dict
        `LOG_TIME_COLUMN`, then the fields in the order of the definition. A nested field has its
        path with dots (``header.frame_id``). A time becomes one column of ns since 1970, a short
        fixed array one column for each element (``position[0]``); any other array stays a list.
    """
    columns: dict[str, list[Any]] = {LOG_TIME_COLUMN: []}
    for row, (log_time, message) in enumerate(messages):
        columns[LOG_TIME_COLUMN].append(log_time)
        for name, value in _flatten("", message):
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
        Name of the element type in ROS (``double``, ``uint8``, ``string``, ...) and whether the
        column holds lists, by the name of the column. Messages in a list become texts (JSON).
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


def column_comments(message: Any) -> dict[str, str]:
    """Return the comment of the message definition of each column that has one.

    Parameters
    ----------
    message
        Any message of the type.
    """
    return {name: comment for name, comment in _comments("", message) if comment}


def _comments(prefix: str, message: Any) -> Iterable[tuple[str, str]]:
    told = field_comments(message)
    for field in message.get_fields_and_field_types():
        value, name, comment = getattr(message, field), f"{prefix}{field}", told.get(field, "")
        if _is_time(value):
            yield f"{name}_ns", comment
        elif hasattr(value, "get_fields_and_field_types"):
            yield from _comments(f"{name}.", value)
        elif isinstance(value, np.ndarray) and value.size <= LONGEST_FIXED:
            yield from ((f"{name}[{i}]", comment) for i in range(value.size))
        else:
            yield name, comment


def unit_of_comment(comment: str) -> str:
    """Return the unit with which the comment of a field begins; empty if it begins with none."""
    match = _UNIT.match(comment)
    return match[1] if match else ""


def explode_columns(columns: dict[str, list[Any]]) -> dict[str, list[Any]]:
    """Return columns without lists: one row for each element of a message's lists.

    Messages that are columns themselves (observations, slant TEC) become one row for each signal.
    A row whose lists are empty keeps its other values. If the lists of any message differ in
    length, all lists become texts instead.
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


def _flatten(prefix: str, message: Any) -> Iterable[tuple[str, Any]]:
    """Yield name and value of each field and nested field."""
    for field in message.get_fields_and_field_types():
        name, value = f"{prefix}{field}", getattr(message, field)
        if _is_time(value):
            yield f"{name}_ns", to_nanoseconds(value)
        elif hasattr(value, "get_fields_and_field_types"):
            yield from _flatten(f"{name}.", value)
        elif isinstance(value, np.ndarray) and value.size <= LONGEST_FIXED:
            yield from ((f"{name}[{i}]", item) for i, item in enumerate(value.tolist()))
        else:
            yield name, _plain(value)


def _is_time(value: Any) -> bool:
    if not hasattr(value, "get_fields_and_field_types"):
        return False
    return set(value.get_fields_and_field_types()) == {"sec", "nanosec"}


def _plain(value: Any) -> Any:
    """Return a value as a number, a text, or a list of numbers or texts."""
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
        return json.dumps(dict(_flatten("", item)), ensure_ascii=False)
    return _plain(item)


def _is_list(value: Any) -> bool:
    return isinstance(value, list)


def _text(value: Any) -> str:
    return "" if value is None else repr(value)
