"""Whether two serialised messages say the same.

The bytes that align the fields of a serialised message belong to no field. Fast DDS leaves in them
what the memory held before, so that equal messages of two runs may differ there.
"""

from __future__ import annotations

import struct
from typing import Any

from vtff_bag.file.message_definitions import deserialize, message_class

__all__ = ["have_equal_content", "read_content"]


def have_equal_content(first: bytes, second: bytes, type_name: str) -> bool:
    """Return whether two serialised messages are equal in every bit of every field.

    Parameters
    ----------
    first, second
        Messages in CDR.
    type_name
        Type of both, ``package/msg/Type``.

    Raises
    ------
    UnknownTypeError
        If the bytes differ and the type is not installed.
    """
    if first == second:
        return True
    if len(first) != len(second):
        return False
    kind = message_class(type_name)
    left, right = (read_content(deserialize(message, kind)) for message in (first, second))
    return bool(left == right)


def read_content(value: Any) -> Any:
    """Return a message, or the value of a field, in a form that compares bit by bit.

    A number that is none equals itself, and zeros differ by their sign. Arrays become bytes,
    messages lists of their fields.
    """
    if hasattr(value, "get_fields_and_field_types"):
        return [read_content(getattr(value, name)) for name in value.get_fields_and_field_types()]
    if hasattr(value, "tobytes"):
        return value.tobytes()
    if isinstance(value, float):
        return struct.pack("<d", value)
    if isinstance(value, (list, tuple)):
        return [read_content(item) for item in value]
    return value
