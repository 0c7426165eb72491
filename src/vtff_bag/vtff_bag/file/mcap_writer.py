"""Writer of an MCAP file with chunks, indexes and summary, in few steps a message.

The bytes are those of the writer of the mcap package. That makes an object and a dozen calls
of each message, of which a recorder has thousands a second; here a message is its bytes in the
chunk and two numbers in the index. Records that are rare are written by the mcap package. Record
layout: MCAP specification, version 0.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Mapping
from typing import Protocol

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from vtff_bag.file.mcap_blocks import FOOTER_LENGTH, MAGIC, MESSAGE_OPCODE, RECORD

__all__ = ["COMPRESSIONS", "McapWriter"]

_MESSAGE = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
#: Bytes that the length of a record counts before the content of a message.
_MESSAGE_FIELDS = _MESSAGE.size - RECORD.size
_INDEX_HEAD = struct.Struct("<BQHI")  # opcode, length, channel, bytes of the entries
_CHUNK_HEAD = struct.Struct("<BQQQQII")  # opcode, length, start, end, size, checksum, text length
_LENGTH = struct.Struct("<Q")
_FOOTER_HEAD = struct.Struct("<BQQQ")


def _make_zstd() -> Callable[[bytearray], bytes]:
    # One compressor for all chunks: a new one begins with a megabyte of memory.
    return zstandard.ZstdCompressor().compress


COMPRESSIONS: dict[str, tuple[str, Callable[[], Callable[[bytearray], bytes]]]] = {
    "zstd": ("zstd", _make_zstd),
    "lz4": ("lz4", lambda: lz4.frame.compress),
    "none": ("", lambda: bytes),
}
"""Name in the file, and what makes the function that compresses, by compression."""


class _File(Protocol):
    def write(self, block: bytes | bytearray, /) -> int:
        """Append a block of whole records."""

    def tell(self) -> int:
        """Return the number of bytes written."""


class McapWriter:
    """Writes schemas, channels and messages in chunks, and the summary at the end.

    Parameters
    ----------
    file
        Takes whole records; it stays open. What its methods raise, the methods here raise.
    chunk_size
        Bytes of records after which a chunk is finished, before compression.
    compression
        A key of `COMPRESSIONS`.
    """

    def __init__(self, file: _File, chunk_size: int, compression: str) -> None:
        self._file = file
        self._chunk_size = chunk_size
        self._compression, make = COMPRESSIONS[compression]
        self._compress = make()
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._metadata_indexes: list[MetadataIndex] = []
        self._chunk_indexes = bytearray()
        self._chunk_count = 0
        #: First and last log time, and number of messages by channel, of finished chunks.
        self._times = (0, 0)
        self._counts: dict[int, int] = {}
        #: Records of the chunk that grows.
        self._chunk = bytearray()
        #: Log time and place in that chunk of each of its messages, in turn, by channel.
        self._index: dict[int, list[int]] = {}

    def start(self, profile: str, library: str) -> None:
        """Write the begin of the file."""
        self._file.write(MAGIC + _encode(Header(profile, library)))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Add a schema and return its number."""
        schema = Schema(id=len(self._schemas) + 1, data=data, encoding=encoding, name=name)
        self._schemas.append(schema)
        self._add_to_chunk(schema)
        return schema.id

    def register_channel(
        self, topic: str, message_encoding: str, schema_id: int, metadata: Mapping[str, str]
    ) -> int:
        """Add a channel and return its number, which `add_message` needs."""
        channel = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding=message_encoding,
            metadata=dict(metadata),
            schema_id=schema_id,
        )
        self._channels.append(channel)
        self._add_to_chunk(channel)
        return channel.id

    def _add_to_chunk(self, record: McapRecord) -> None:
        self._chunk += _encode(record)
        if len(self._chunk) > self._chunk_size:
            self.finish_chunk()

    def add_message(
        self, channel_id: int, log_time: int, content: bytes, publish_time: int
    ) -> None:
        """Append a message; times in ns since 1970.

        Raises
        ------
        KeyError
            If no channel has that number.
        struct.error
            If a time is negative.
        """
        chunk = self._chunk
        head = _MESSAGE.pack(
            MESSAGE_OPCODE,
            _MESSAGE_FIELDS + len(content),
            channel_id,
            0,
            log_time,
            publish_time,
        )
        entries = self._index.get(channel_id)
        if entries is None:
            entries = self._begin_index(channel_id)
        entries.append(log_time)
        entries.append(len(chunk))
        chunk += head
        chunk += content
        if len(chunk) > self._chunk_size:
            self.finish_chunk()

    def _begin_index(self, channel_id: int) -> list[int]:
        if not 0 < channel_id <= len(self._channels):
            raise KeyError(channel_id)
        entries: list[int] = []
        self._index[channel_id] = entries
        return entries

    def count_messages(self) -> dict[int, int]:
        """Return the number of messages by channel, of channels that have any."""
        counts = dict(self._counts)
        for channel_id, entries in self._index.items():
            counts[channel_id] = counts.get(channel_id, 0) + len(entries) // 2
        return counts

    def times(self) -> tuple[int, int]:
        """Return the least and the greatest log time, ns since 1970; zeros without a message."""
        return self._times_with(*self._chunk_times()) if self._index else self._times

    def _times_with(self, start_time: int, end_time: int) -> tuple[int, int]:
        """Return the times of finished chunks and of one more."""
        if self._counts:
            start_time = min(start_time, self._times[0])
        return start_time, max(end_time, self._times[1])

    def _chunk_times(self) -> tuple[int, int]:
        times = [entries[::2] for entries in self._index.values()]
        return min(map(min, times)), max(map(max, times))

    def finish_chunk(self) -> None:
        """Write the chunk that grows and its indexes; a chunk without messages goes on growing."""
        if not self._index:
            return
        start_time, end_time = self._chunk_times()
        records = self._chunk
        compressed = self._compress(records)
        name = self._compression.encode()
        head = _CHUNK_HEAD.pack(
            Opcode.CHUNK,
            _CHUNK_HEAD.size - RECORD.size + len(name) + _LENGTH.size + len(compressed),
            start_time,
            end_time,
            len(records),
            zlib.crc32(records),
            len(name),
        )
        place = self._file.tell()
        stored = b"".join((head, name, _LENGTH.pack(len(compressed)), compressed))
        self._file.write(stored)
        index_start = self._file.tell()
        offsets = {}
        indexes = bytearray()
        for channel_id, entries in self._index.items():
            offsets[channel_id] = index_start + len(indexes)
            size = len(entries) * 8
            indexes += _INDEX_HEAD.pack(
                Opcode.MESSAGE_INDEX, _INDEX_HEAD.size - RECORD.size + size, channel_id, size
            )
            indexes += struct.pack(f"<{len(entries)}Q", *entries)
        self._file.write(indexes)
        # Encoded: objects of a long recording would take twenty times the memory.
        self._chunk_count += 1
        self._chunk_indexes += _encode(
            ChunkIndex(
                chunk_length=len(stored),
                chunk_start_offset=place,
                compression=self._compression,
                compressed_size=len(compressed),
                message_end_time=end_time,
                message_index_length=len(indexes),
                message_index_offsets=offsets,
                message_start_time=start_time,
                uncompressed_size=len(records),
            )
        )
        self._times = self._times_with(start_time, end_time)
        self._counts = self.count_messages()
        self._index.clear()
        self._chunk = bytearray()

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Write a record of texts."""
        record = _encode(Metadata(name=name, metadata=dict(data)))
        self._metadata_indexes.append(
            MetadataIndex(offset=self._file.tell(), length=len(record), name=name)
        )
        self._file.write(record)

    def finish(self) -> None:
        """Write the last chunk and the summary: the file is complete."""
        self.finish_chunk()
        self._file.write(_encode(DataEnd(0)))
        summary_start = self._file.tell()
        summary = bytearray()
        offsets = bytearray()
        for opcode, group in (
            (Opcode.SCHEMA, b"".join(map(_encode, self._schemas))),
            (Opcode.CHANNEL, b"".join(map(_encode, self._channels))),
            (Opcode.STATISTICS, _encode(self._statistics())),
            (Opcode.CHUNK_INDEX, self._chunk_indexes),
            (Opcode.ATTACHMENT_INDEX, b""),
            (Opcode.METADATA_INDEX, b"".join(map(_encode, self._metadata_indexes))),
        ):
            start = summary_start + len(summary)
            offsets += _encode(SummaryOffset(opcode, group_start=start, group_length=len(group)))
            summary += group
        offsets_start = summary_start + len(summary)
        summary += offsets
        places = (summary_start, offsets_start)
        head = _FOOTER_HEAD.pack(Opcode.FOOTER, FOOTER_LENGTH, *places)
        checksum = zlib.crc32(head, zlib.crc32(summary))
        self._file.write(summary)
        self._file.write(_encode(Footer(*places, summary_crc=checksum)) + MAGIC)

    def _statistics(self) -> Statistics:
        start_time, end_time = self._times
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=self._chunk_count,
            message_count=sum(self._counts.values()),
            message_end_time=end_time,
            message_start_time=start_time,
            metadata_count=len(self._metadata_indexes),
            schema_count=len(self._schemas),
        )


def _encode(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())
