"""Samples of a topic, as bytes, to messages of its type."""

from __future__ import annotations

import operator
from collections.abc import Iterator
from typing import Any

from rclpy.serialization import deserialize_message

__all__ = ["SampleError", "SampleReader"]

#: Character that rclpy puts in place of bytes that are not UTF-8.
_REPLACEMENT = "\N{REPLACEMENT CHARACTER}"


class SampleError(ValueError):
    """Bytes that are no message of their type."""


class SampleReader:
    """Reads samples as messages of one type.

    The middleware itself would drop a sample that is cut short without a word, and rclpy would hand
    on a foreign text with other characters in it.

    Parameters
    ----------
    message_type
        Class of the messages.
    """

    def __init__(self, message_type: Any) -> None:
        self._type = message_type
        self._texts = [
            (path, operator.attrgetter(path)) for path in _find_texts(message_type(), "")
        ]

    def read(self, content: bytes) -> Any:
        """Return the message of a sample.

        Raises
        ------
        SampleError
            If the bytes are no message of the type, or a text in them is not UTF-8.
        """
        try:
            message = deserialize_message(content, self._type)
        except RuntimeError as error:  # base of the RMWError of rclpy
            name = self._type.__name__
            raise SampleError(f"{len(content)} bytes that are no {name}") from error
        for path, read_text in self._texts:
            if _REPLACEMENT in "".join(read_text(message)):
                raise SampleError(f"field '{path}' is not UTF-8")
        return message


def _find_texts(message: Any, prefix: str) -> Iterator[str]:
    """Yield the paths of the texts and lists of texts of a message and of the messages in it.

    Lists of messages are left out.
    """
    for name, declared in message.get_fields_and_field_types().items():
        if declared.startswith(("string", "sequence<string")):
            yield prefix + name
        elif hasattr(part := getattr(message, name), "get_fields_and_field_types"):
            yield from _find_texts(part, f"{prefix}{name}.")
