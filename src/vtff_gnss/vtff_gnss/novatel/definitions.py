"""NovAtel's own message definitions (novatel_edie), used one validated frame at a time."""

from __future__ import annotations

from typing import Any

import novatel_edie
from novatel_edie import oem

__all__ = ["MessageDecoder", "log_name"]

LONG_BINARY_SYNC = b"\xaa\x44\x12"

_DATABASE = oem.get_builtin_database()
# What novatel_edie raises; MemoryError at counts that the payload contradicts.
_DECODING_ERRORS = (novatel_edie.NovatelEdieException, RuntimeError, ValueError, MemoryError)


def log_name(message_id: int) -> str:
    """Return the name of a log, without format suffix; ``"LOG<id>"`` if it is not defined."""
    definition = _DATABASE.get_msg_def(message_id)
    return f"LOG{message_id}" if definition is None else str(definition.name)


class MessageDecoder:
    """Decodes and converts single frames.

    Messages are told by ``message.name``: novatel_edie has one class for each definition CRC, so
    that the class of an older firmware's log differs from that of a newer one.
    """

    def __init__(self) -> None:
        novatel_edie.disable_internal_logging()
        self._parser = oem.Parser()
        self._parser.return_unknown_bytes = False
        self._parser.decompress_range_cmp = False

    def decode(self, content: bytes) -> Any | None:
        """Return the message of one frame, or None if it is not defined or does not fit.

        Parameters
        ----------
        content : bytes
            One frame whose checksum is right; an ASCII log ends with its checksum.
        """
        if content[:1] in b"#%":
            content += b"\r\n"  # The parser finds no log that ends otherwise.
        try:
            self._parser.write(content)
            messages = list(self._parser)
        except _DECODING_ERRORS:
            messages = []
        finally:
            self._parser.flush()
        if len(messages) != 1 or not isinstance(messages[0], oem.Message | oem.Response):
            return None
        # The parser looks for a frame inside a frame that it rejects.
        if content.startswith(LONG_BINARY_SYNC):
            if messages[0].name != log_name(int.from_bytes(content[4:6], "little")):
                return None
        return messages[0]

    def to_binary(self, content: bytes) -> bytes | None:
        """Return an ASCII log as the long binary frame it stands for, or None if it has none."""
        message = self.decode(content)
        if message is None:
            return None
        try:
            binary = bytes(message.to_binary().message)
        except _DECODING_ERRORS:
            return None
        return binary if binary.startswith(LONG_BINARY_SYNC) else None
