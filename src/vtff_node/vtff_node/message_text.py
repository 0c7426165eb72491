"""A message as lines of text, each field with the unit that its definition gives."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator, Mapping
from typing import Any

from vtff_node.executables import ExecutableNotFoundError, share_folder

__all__ = ["field_comments", "message_lines"]

#: Values of a list that are shown; the others are counted.
LARGEST_LIST = 8

#: Units of fields of common messages, whose definitions have none: SI, as REP 103 wants it.
_STANDARD_UNITS = {
    ("geometry_msgs", "Accel"): {"linear": "m/s2", "angular": "rad/s2"},
    ("geometry_msgs", "Twist"): {"linear": "m/s", "angular": "rad/s"},
    ("geometry_msgs", "Wrench"): {"force": "N", "torque": "N m"},
    ("geometry_msgs", "Point"): {"x": "m", "y": "m", "z": "m"},
}

_FIELD = re.compile(r"^[\w/]+(?:\[[<=\d]*\])?\s+(\w+)\s*(?:#\s*(.*))?$")


def message_lines(message: Any, indent: str = "") -> Iterator[str]:
    """Yield the fields of a message, one line each; a message within it is indented.

    Parameters
    ----------
    message
        A deserialised ROS message.
    indent
        Beginning of each line.
    """
    comments = field_comments(message)
    for name in message.get_fields_and_field_types():
        value = getattr(message, name)
        comment = comments.get(name, "")
        remark = f"    # {comment}" if comment else ""
        if hasattr(value, "get_fields_and_field_types"):
            yield f"{indent}{name}:{remark}"
            yield from message_lines(value, indent + "  ")
        elif _holds_messages(value):
            yield f"{indent}{name}: {len(value)}{remark}"
            for item in value[:LARGEST_LIST]:
                yield f"{indent}-"
                yield from message_lines(item, indent + "  ")
        else:
            yield f"{indent}{name}: {_value_text(value)}{remark}"


def field_comments(message: Any) -> Mapping[str, str]:
    """Return the comment of each field in the definition of a message; empty without one.

    Fields of common messages whose definitions give no unit have that of `_STANDARD_UNITS`.
    """
    kind = (type(message).__module__.partition(".")[0], type(message).__name__)
    return _STANDARD_UNITS.get(kind) or _comments(*kind)


def _holds_messages(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and hasattr(value[0], "SLOT_TYPES")


def _value_text(value: Any) -> str:
    if isinstance(value, (str, bytes)) or not hasattr(value, "__len__"):
        return str(value)
    items = [str(item) for item in list(value)[:LARGEST_LIST]]
    if len(value) > LARGEST_LIST:
        items.append(f"... ({len(value)} values)")
    return f"[{', '.join(items)}]"


@functools.cache
def _comments(package: str, name: str) -> Mapping[str, str]:
    """Return the comment of each field in the definition of a message; empty without one."""
    try:
        path = share_folder(package) / "msg" / f"{name}.msg"
        lines = path.read_text(encoding="utf-8").splitlines()
    except (ExecutableNotFoundError, OSError):
        return {}
    fields = (_FIELD.match(line) for line in lines)
    return {field[1]: field[2] or "" for field in fields if field}
