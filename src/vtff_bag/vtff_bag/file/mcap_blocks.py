"""Intact parts of an MCAP file, found by its summary or, if that is damaged, by a scan of the file.

The mcap package stops at the first damaged byte and does not return the messages before it. This
module scans a damaged file record by record, checks the checksum of each chunk, and continues
after a damaged part at the next intact chunk. Record layout: MCAP specification, version 0.
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
import mmap
import os
import pathlib
import re
import struct
import zlib
from collections.abc import Collection, Iterator
from typing import Any, BinaryIO, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata, MetadataIndex, Schema, Statistics

from vtff_bag.file.errors import BagReadError

_MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")  # opcode, length of what follows
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
MESSAGE_HEAD_SIZE = _MESSAGE.size
MESSAGE_OPCODE = int(Opcode.MESSAGE)  # a comparison with a member of an enumeration is slow
_CHUNK_INDEX_OPCODE = int(Opcode.CHUNK_INDEX)
_CHUNK_INDEX = struct.Struct("<QQQQ")  # first and last log time, offset, length of the chunk
_SUMMARY_RECORDS: dict[int, Any] = {
    int(Opcode.STATISTICS): Statistics,
    int(Opcode.SCHEMA): Schema,
    int(Opcode.CHANNEL): Channel,
    int(Opcode.METADATA_INDEX): MetadataIndex,
}
_FOOTER_LENGTH = 20  # bytes that follow
_LARGEST_CHUNK = 1 << 30  # B uncompressed; a record that states more has a damaged length
BAG_METADATA_RECORD = "rosbag2"  # name of the record that repeats metadata.yaml inside the file
_GROUP_SIZE = 128 * 1024  # B of messages outside chunks that make one block

# After damage the scan continues at a chunk (length below 2^40, known compression) or at the 13
# bytes of DataEnd.
_RESYNCHRONISE = re.compile(
    rb"\x06.{5}\0\0\0.{28}(?:\x04\0\0\0zstd|\x03\0\0\0lz4|\0\0\0\0)|\x0f\x04\0\0\0\0\0\0\0",
    re.DOTALL,
)

_DAMAGE = (
    McapError,
    zstandard.ZstdError,
    ValueError,
    KeyError,
    struct.error,
    RuntimeError,
    MemoryError,
    EOFError,
    OverflowError,
)


class StoredMessage(NamedTuple):
    """A message as it is stored in the file; times in ns since 1970."""

    channel_id: int
    log_time: int
    publish_time: int
    serialized: bytes


class Block(NamedTuple):
    """A chunk, or consecutive messages outside chunks.

    ``offset`` and ``length`` are bytes of the file, record headers included. Times are the first
    and last log time, ns since 1970.
    """

    start_time: int
    end_time: int
    offset: int
    length: int
    chunked: bool


@dataclasses.dataclass
class FileContent:
    """The readable content of an MCAP file.

    ``bag_metadata`` is the copy of metadata.yaml inside the file; empty if there is none.
    """

    path: pathlib.Path
    channels: dict[int, Channel] = dataclasses.field(default_factory=dict)
    schemas: dict[int, Schema] = dataclasses.field(default_factory=dict)
    blocks: list[Block] = dataclasses.field(default_factory=list)
    message_counts: dict[int, int] = dataclasses.field(default_factory=dict)
    start_time: int = 0
    end_time: int = 0
    closed: bool = False
    damaged_bytes: int = 0
    bag_metadata: str = ""
    notes: list[str] = dataclasses.field(default_factory=list)

    @property
    def complete(self) -> bool:
        """Whether the file was closed properly and nothing in it is damaged."""
        return self.closed and not self.damaged_bytes

    @property
    def message_count(self) -> int:
        """Number of messages of all channels."""
        return sum(self.message_counts.values())


@dataclasses.dataclass
class _Summary:
    """Records in the summary of a file."""

    statistics: Statistics | None = None
    schemas: dict[int, Schema] = dataclasses.field(default_factory=dict)
    channels: dict[int, Channel] = dataclasses.field(default_factory=dict)
    chunks: list[Block] = dataclasses.field(default_factory=list)
    metadata: list[MetadataIndex] = dataclasses.field(default_factory=list)


def read_content(path: pathlib.Path) -> FileContent:
    """Return the content of a file from its summary if that is intact, else by a scan.

    Raises
    ------
    BagReadError
        If the file cannot be opened or is not an MCAP file.
    """
    try:
        with open(path, "rb") as file:
            content = _read_content_from_summary(path, file)
    except OSError as error:
        raise BagReadError(f"{path}: cannot read: {error.strerror or error}") from error
    return content if content is not None else scan_content(path)


def scan_content(path: pathlib.Path) -> FileContent:
    """Return the content of a file by reading all of it and checking every chunk.

    Raises
    ------
    BagReadError
        If the file cannot be opened or no part of it is that of an MCAP file.
    """
    try:
        with open(path, "rb") as file:
            if os.fstat(file.fileno()).st_size == 0:
                raise BagReadError(f"{path}: the file is empty")
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as mapped:
                return _Scan(path, mapped).run()
    except (OSError, ValueError) as error:
        raise BagReadError(f"{path}: cannot read: {error}") from error


def read_block(
    content: FileContent,
    block: Block,
    file: BinaryIO,
    channel_ids: Collection[int] | None = None,
) -> Iterator[StoredMessage]:
    """Iterate over the messages of a block in file order.

    Parameters
    ----------
    content, block, file
        Content of the file, a block in it, and the open file.
    channel_ids
        Channels whose messages are returned; all if not given.

    Raises
    ------
    BagReadError
        If the block is damaged; raised before the first message is returned.
    """
    with damage_named(content, block):
        messages = _messages_of(_read_records(block, file), channel_ids)
    return iter(messages)


def read_records(content: FileContent, block: Block, file: BinaryIO) -> bytes:
    """Return the records of a block, decompressed and checked; arguments as in `read_block`.

    Raises
    ------
    BagReadError
        If the block is damaged.
    """
    with damage_named(content, block):
        return _read_records(block, file)


@contextlib.contextmanager
def damage_named(content: FileContent, block: Block) -> Iterator[None]:
    """Raise what damage of a block raises as a BagReadError that names the place."""
    try:
        yield
    except _DAMAGE as error:
        raise BagReadError(
            f"{content.path}: damaged between bytes {block.offset} and "
            f"{block.offset + block.length}: {error}"
        ) from error


def _read_records(block: Block, file: BinaryIO) -> bytes:
    file.seek(block.offset)
    stored = file.read(block.length)
    return _read_chunk(stored) if block.chunked else stored


def _messages_of(stored: bytes, channel_ids: Collection[int] | None) -> list[StoredMessage]:
    """Return the messages of some channels, or of all; ValueError if a record is cut off."""
    # One loop without calls: a bag has thousands of messages for each second of reading.
    record_of, message_of = RECORD.unpack_from, _MESSAGE.unpack_from
    head, message_head, size = RECORD.size, _MESSAGE.size, len(stored)
    new = tuple.__new__  # that of the class takes twice as long
    messages: list[StoredMessage] = []
    position = 0
    while position < size:
        opcode, length = record_of(stored, position)
        start = position + head
        position = start + length
        if position > size or (opcode == MESSAGE_OPCODE and length < message_head):
            raise ValueError("a record is cut off")
        if opcode == MESSAGE_OPCODE:
            channel_id, _, log_time, publish_time = message_of(stored, start)
            if channel_ids is None or channel_id in channel_ids:
                serialized = stored[start + message_head : position]
                fields = (channel_id, log_time, publish_time, serialized)
                messages.append(new(StoredMessage, fields))
    return messages


def _split_records(stored: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, start and end of each record; ValueError if a record is cut off."""
    position = 0
    while position < len(stored):
        opcode, length = RECORD.unpack_from(stored, position)
        start = position + RECORD.size
        position = start + length
        if position > len(stored) or (opcode == Opcode.MESSAGE and length < _MESSAGE.size):
            raise ValueError("a record is cut off")
        yield opcode, start, position


def _read_chunk(stored: bytes) -> bytes:
    """Return the records inside a stored chunk record, decompressed and checked."""
    chunk = Chunk.read(ReadDataStream(io.BytesIO(stored[RECORD.size :])))
    if chunk.uncompressed_size > _LARGEST_CHUNK:
        raise ValueError(f"a chunk claims {chunk.uncompressed_size} bytes")
    if chunk.compression == "zstd":
        stated = zstandard.frame_content_size(chunk.data)
        if stated not in (-1, chunk.uncompressed_size):
            raise ValueError("a chunk contradicts its size")
        records = zstandard.decompress(chunk.data, max_output_size=chunk.uncompressed_size)
    elif chunk.compression == "lz4":
        # One byte more than stated shows a contradiction without taking in all that follows.
        decompressor = lz4.frame.LZ4FrameDecompressor()
        records = decompressor.decompress(chunk.data, max_length=chunk.uncompressed_size + 1)
    elif chunk.compression == "":
        records = chunk.data
    else:
        raise ValueError(f"compression '{chunk.compression}' is not supported")
    if len(records) != chunk.uncompressed_size:
        raise ValueError("a chunk is cut off")
    if chunk.uncompressed_crc and zlib.crc32(records) != chunk.uncompressed_crc:
        raise ValueError("a chunk fails its checksum")
    return records


def _read_content_from_summary(path: pathlib.Path, file: BinaryIO) -> FileContent | None:
    """Return the content from an intact summary section; None where a scan is needed."""
    try:
        stored = _read_summary(file)
        summary = None if stored is None else _parse_summary(stored)
    except _DAMAGE:
        return None
    if summary is None or summary.statistics is None:
        return None
    statistics = summary.statistics
    if statistics.message_count and not summary.chunks:
        return None
    content = FileContent(
        path=path,
        channels=dict(summary.channels),
        schemas=dict(summary.schemas),
        message_counts=dict(statistics.channel_message_counts),
        start_time=statistics.message_start_time,
        end_time=statistics.message_end_time,
        closed=True,
    )
    size = file.seek(0, os.SEEK_END)

    def is_inside(offset: int, length: int) -> bool:
        # An index with a good checksum may still name places that no file has.
        return length >= RECORD.size and offset + length <= size

    for block in summary.chunks:
        if not is_inside(block.offset, block.length):
            return None
        file.seek(block.offset)
        if file.read(RECORD.size) != RECORD.pack(Opcode.CHUNK, block.length - RECORD.size):
            return None
        content.blocks.append(block)
    for entry in summary.metadata:
        if not is_inside(entry.offset, entry.length):
            continue  # the messages can be read without it
        file.seek(entry.offset)
        _read_bag_metadata(content, file.read(entry.length)[RECORD.size :])
    return content


def _read_bag_metadata(content: FileContent, stored: bytes) -> None:
    try:
        record = Metadata.read(ReadDataStream(io.BytesIO(stored)))
    except _DAMAGE:
        return  # the messages can be read without it
    if record.name == BAG_METADATA_RECORD:
        content.bag_metadata = record.metadata.get("serialized_metadata", "")


def _read_summary(file: BinaryIO) -> bytes | None:
    """Return the records of the summary; None without a footer whose checksum covers them."""
    size = file.seek(0, os.SEEK_END)
    footer_start = size - len(_MAGIC) - _FOOTER_LENGTH - RECORD.size
    if footer_start < len(_MAGIC):
        return None
    file.seek(footer_start)
    ending = file.read()
    opcode, length = RECORD.unpack_from(ending)
    checksum: int
    summary_start, _, checksum = struct.unpack_from("<QQI", ending, RECORD.size)
    if (opcode, length) != (Opcode.FOOTER, _FOOTER_LENGTH) or not ending.endswith(_MAGIC):
        return None
    if not len(_MAGIC) < summary_start <= footer_start:
        return None
    file.seek(summary_start)
    covered = file.read(size - summary_start - len(_MAGIC) - 4)
    if checksum != 0 and zlib.crc32(covered) != checksum:
        return None
    return covered[: footer_start - summary_start]


def _parse_summary(stored: bytes) -> _Summary:
    """Return what the records of a summary tell; raises one of `_DAMAGE` where they are wrong."""
    summary = _Summary()
    for opcode, start, end in _split_records(stored):
        if opcode == _CHUNK_INDEX_OPCODE:
            # An index is of four numbers, and of more that is not needed: there are thousands.
            begin, last, offset, length = _CHUNK_INDEX.unpack_from(stored, start)
            if end - start < _CHUNK_INDEX.size:
                raise ValueError("a record is cut off")
            summary.chunks.append(Block(begin, last, offset, length, True))
        elif opcode in _SUMMARY_RECORDS:
            stream = ReadDataStream(io.BytesIO(stored[start:end]))
            record = _SUMMARY_RECORDS[opcode].read(stream)
            if isinstance(record, Statistics):
                summary.statistics = record
            elif isinstance(record, Schema):
                summary.schemas[record.id] = record
            elif isinstance(record, Channel):
                summary.channels[record.id] = record
            else:
                summary.metadata.append(record)
    return summary


class _Scan:
    """Reads a file record by record."""

    def __init__(self, path: pathlib.Path, mapped: mmap.mmap) -> None:
        self._content = FileContent(path)
        self._file = mapped
        self._size = len(mapped)
        self._group: Block | None = None

    def run(self) -> FileContent:
        content = self._content
        has_magic = self._file[: len(_MAGIC)] == _MAGIC
        position = len(_MAGIC) if has_magic else 0
        if not has_magic:
            content.notes.append("the first bytes are damaged")
        while position < self._size and not content.closed:
            end = self._read_record(position)
            if end is None:
                end = self._find_end_of_damage(position)
                content.damaged_bytes += end - position
                content.notes.append(f"bytes {position} to {end} are damaged or cut off")
            position = end
        self._close_group()
        if not has_magic and not content.blocks and not content.channels:
            raise BagReadError(f"{content.path}: not an MCAP file, and nothing in it is readable")
        self._summarise()
        return content

    def _summarise(self) -> None:
        content = self._content
        unknown_ids = {
            number for number in content.message_counts if number not in content.channels
        }
        lost = sum(content.message_counts.pop(number) for number in unknown_ids)
        if lost:
            content.notes.append(f"{lost} messages belong to topics whose description is lost")
        if not content.closed:
            content.notes.append("the file was not closed properly: no summary at its end")
        content.start_time = min((block.start_time for block in content.blocks), default=0)
        content.end_time = max((block.end_time for block in content.blocks), default=0)

    def _read_record(self, position: int) -> int | None:
        """Read the record at a position and return its end; None if the record is damaged."""
        if position + RECORD.size > self._size:
            return None
        length: int
        opcode, length = RECORD.unpack_from(self._file, position)
        end = position + RECORD.size + length
        if end > self._size or not Opcode.HEADER <= opcode <= Opcode.DATA_END:
            return None
        try:
            self._take(opcode, position, end)
        except _DAMAGE:
            return None
        return end

    def _take(self, opcode: int, position: int, end: int) -> None:
        start = position + RECORD.size
        if opcode == Opcode.MESSAGE:
            self._take_message(position, start, end)
        elif opcode == Opcode.CHUNK:
            self._take_chunk(position, end)
        elif opcode == Opcode.CHANNEL or opcode == Opcode.SCHEMA:
            self._take_description(opcode, self._file[start:end])
        elif opcode == Opcode.METADATA:
            _read_bag_metadata(self._content, self._file[start:end])
        elif opcode == Opcode.FOOTER:
            if self._file[end : end + len(_MAGIC)] != _MAGIC:
                raise ValueError("the last bytes are damaged")
            self._content.closed = True

    def _take_description(self, opcode: int, stored: bytes) -> None:
        stream = ReadDataStream(io.BytesIO(stored))
        if opcode == Opcode.CHANNEL:
            channel = Channel.read(stream)
            self._content.channels.setdefault(channel.id, channel)
            self._content.message_counts.setdefault(channel.id, 0)
        else:
            schema = Schema.read(stream)
            self._content.schemas.setdefault(schema.id, schema)

    def _take_message(self, position: int, start: int, end: int) -> None:
        if end - start < _MESSAGE.size:
            raise ValueError("a message is cut off")
        channel_id, _, log_time, _ = _MESSAGE.unpack_from(self._file, start)
        if channel_id not in self._content.channels:
            raise ValueError("a message belongs to no topic")
        counts = self._content.message_counts
        counts[channel_id] = counts.get(channel_id, 0) + 1
        group = self._group
        if group is None or group.offset + group.length != position or group.length > _GROUP_SIZE:
            self._close_group()
            self._group = Block(log_time, log_time, position, end - position, False)
        else:
            self._group = group._replace(
                start_time=min(group.start_time, log_time),
                end_time=max(group.end_time, log_time),
                length=end - group.offset,
            )

    def _close_group(self) -> None:
        if self._group is not None:
            self._content.blocks.append(self._group)
            self._group = None

    def _take_chunk(self, position: int, end: int) -> None:
        stored = _read_chunk(self._file[position:end])
        records = list(_split_records(stored))  # all records are checked before the first is used
        times = []
        counts = self._content.message_counts
        for opcode, start, record_end in records:
            if opcode == Opcode.MESSAGE:
                channel_id, _, log_time, _ = _MESSAGE.unpack_from(stored, start)
                times.append(log_time)
                counts[channel_id] = counts.get(channel_id, 0) + 1
            elif opcode == Opcode.CHANNEL or opcode == Opcode.SCHEMA:
                self._take_description(opcode, stored[start:record_end])
        self._close_group()
        if times:
            self._content.blocks.append(
                Block(min(times), max(times), position, end - position, True)
            )

    def _find_end_of_damage(self, position: int) -> int:
        """Return the position of the next intact chunk, of the end of the data, or of the file."""
        match = _RESYNCHRONISE.search(self._file, position + 1)
        while match is not None:
            candidate = match.start()
            opcode, length = RECORD.unpack_from(self._file, candidate)
            end = candidate + RECORD.size + length
            if end <= self._size and self._is_intact(opcode, candidate, end):
                return candidate
            match = _RESYNCHRONISE.search(self._file, candidate + 1)
        return self._size

    def _is_intact(self, opcode: int, position: int, end: int) -> bool:
        if opcode == Opcode.DATA_END:
            return True
        try:
            _read_chunk(self._file[position:end])
        except _DAMAGE:
            return False
        return True
