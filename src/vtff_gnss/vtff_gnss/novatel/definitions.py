"""NovAtel's own message definitions (novatel_edie), used one validated frame at a time."""

from __future__ import annotations

import functools
import struct
from typing import Any

import novatel_edie
from novatel_edie import oem

from vtff_gnss.novatel.framing import CRC_LENGTH, MIN_HEADER_LENGTH, crc32_novatel

__all__ = ["MessageDecoder", "log_name"]

LONG_BINARY_SYNC = b"\xaa\x44\x12"

#: What novatel_edie raises; MemoryError at counts that the payload contradicts.
_DECODING_ERRORS = (novatel_edie.NovatelEdieException, RuntimeError, ValueError, MemoryError)


@functools.cache
def _database() -> Any:
    """Return NovAtel's definitions, read when the first log is: many nodes never decode one."""
    return oem.get_builtin_database()


def log_name(message_id: int) -> str:
    """Return the name of a log, without format suffix; ``"LOG<id>"`` if it is not defined."""
    definition = _database().get_msg_def(message_id)
    return f"LOG{message_id}" if definition is None else str(definition.name)


class MessageDecoder:
    """Decodes and converts single frames.

    Messages are told by ``message.name``: novatel_edie has one class for each definition CRC, so
    that the class of an older firmware's log differs from that of a newer one.
    """

    def __init__(self) -> None:
        self._message_types = oem.Message | oem.Response
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
        elif content.startswith(LONG_BINARY_SYNC):
            content = _with_known_header(content)
        try:
            self._parser.write(content)
            messages = list(self._parser)
        except _DECODING_ERRORS:
            messages = []
        finally:
            self._parser.flush()
        if len(messages) != 1 or not isinstance(messages[0], self._message_types):
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


def _with_known_header(content: bytes) -> bytes:
    """Return a long binary frame without what newer firmware has appended to its header.

    The header states its length so that it can grow; novatel_edie 2.10.11 ends the process by a
    segmentation fault if it has.
    """
    header_length = content[len(LONG_BINARY_SYNC)]
    if header_length == MIN_HEADER_LENGTH:
        return content
    frame = bytearray(content[:MIN_HEADER_LENGTH] + content[header_length:-CRC_LENGTH])
    frame[len(LONG_BINARY_SYNC)] = MIN_HEADER_LENGTH
    return bytes(frame) + struct.pack("<I", crc32_novatel(bytes(frame)))
