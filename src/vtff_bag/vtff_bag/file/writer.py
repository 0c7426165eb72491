"""Bag writer: one MCAP file and its ``metadata.yaml``, safe against sudden death.

Every second of wall time the writer finishes the current chunk and hands it to the operating
system, so that a killed process loses at most its last second. The writer holds `RESERVE_SIZE` of
the disk: on a full disk it gives them up, goes on, and tells so by `BagWriter.disk_alarm`, so that
the run can end in order and the bag can be closed.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import pathlib
import time
from collections.abc import Callable, Iterable, Mapping
from types import TracebackType
from typing import IO, cast

from mcap.writer import CompressionType, Writer

from vtff_bag.file import metadata as bag_metadata
from vtff_bag.file.errors import BagWriteError
from vtff_bag.file.message_definitions import message_definition
from vtff_bag.file.metadata import (
    BagMetadata,
    FileInformation,
    QosEntry,
    TopicInformation,
)
from vtff_node.plain_yaml import format_yaml

PROFILE = "ros2"
LIBRARY = "vtff bag_recorder"
MESSAGE_ENCODING = "cdr"
SCHEMA_ENCODING = "ros2msg"
COMPRESSIONS = {
    "zstd": CompressionType.ZSTD,
    "lz4": CompressionType.LZ4,
    "none": CompressionType.NONE,
}
DEFAULT_CHUNK_SIZE = 128 * 1024
FLUSH_INTERVAL = 1.0  # s of wall time
RESERVE_SIZE = 8 * 1024 * 1024  # bytes; a minute of two receivers at 20 Hz, and the index

_NO_SPACE = (errno.ENOSPC, errno.EDQUOT)


class _RecordFile:
    """An MCAP file without a buffer, which always ends after a whole record.

    The writer of the mcap package hands over whole records in a few large blocks, so that a buffer
    would gain nothing. After a failed write, the part of the record that reached the disk is cut
    off again.

    Attributes
    ----------
    alarm
        Why the reserve of the disk was given up; empty while the disk has room.
    """

    def __init__(self, path: pathlib.Path) -> None:
        self._path = path
        self.alarm = ""
        try:
            self._reserve = _reserve_space(path.parent)
            self._file = io.FileIO(path, "xb")
        except OSError as error:
            raise BagWriteError(f"{path}: cannot create: {error.strerror or error}") from error
        self._length = 0

    def write(self, block: bytes | bytearray) -> int:
        remaining = memoryview(block)
        while remaining:
            try:
                remaining = remaining[self._file.write(remaining) or 0 :]
            except OSError as error:
                text = f"{self._path}: cannot write: {error.strerror or error}"
                if error.errno in _NO_SPACE and self._reserve is not None:
                    self.alarm = text
                    self._release_reserve()
                    continue
                self._cut_off_partial_record()
                raise BagWriteError(text) from error
        self._length += len(block)
        return len(block)

    def _release_reserve(self) -> None:
        if self._reserve is not None:
            with contextlib.suppress(OSError):
                self._reserve.close()
            self._reserve = None

    def _cut_off_partial_record(self) -> None:
        try:
            self._file.truncate(self._length)
        except OSError:
            # The file stays readable: a killed process leaves a partial record at its end too.
            return

    def tell(self) -> int:
        return self._length

    def flush(self) -> None:
        """Do nothing: `write` has handed all to the operating system."""

    def close(self) -> None:
        self._release_reserve()
        try:
            self._file.close()
        except OSError as error:
            raise BagWriteError(f"{self._path}: cannot close: {error.strerror or error}") from error


def _reserve_space(directory: pathlib.Path) -> io.FileIO | None:
    """Return an open file without a name that holds `RESERVE_SIZE` bytes of the disk.

    None where the process may not write files of that size: no reserve helps against that limit.

    Raises
    ------
    OSError
        If there is no room for it.
    """
    path = directory / f".reserve_{os.getpid()}"
    file = io.FileIO(path, "wb")
    try:
        path.unlink()
        os.posix_fallocate(file.fileno(), 0, RESERVE_SIZE)
    except OSError as error:
        file.close()
        if error.errno == errno.EFBIG:
            return None
        raise
    return file


class BagWriter:
    """Writes a bag: the MCAP file ``<directory>/<name>_0.mcap`` and ``metadata.yaml``.

    Parameters
    ----------
    directory
        Directory of the bag; it is made if it does not exist, and must not hold a bag yet.
    custom_metadata
        Texts for ``custom_data`` of the metadata, for example configuration hashes.
    chunk_size
        Bytes of message records per chunk before compression.
    compression
        ``zstd``, ``lz4`` or ``none``.
    steady_clock
        Function that returns wall time in s, for the flush each second.

    Raises
    ------
    BagWriteError
        If the bag cannot be written, here and in every method; the text names the path.
    """

    def __init__(
        self,
        directory: str | os.PathLike[str],
        custom_metadata: Mapping[str, str] | None = None,
        chunk_size: int = DEFAULT_CHUNK_SIZE,
        compression: str = "zstd",
        *,
        steady_clock: Callable[[], float] = time.monotonic,
    ) -> None:
        if compression not in COMPRESSIONS:
            raise BagWriteError(
                f"compression '{compression}' is unknown; choose one of: {', '.join(COMPRESSIONS)}"
            )
        self.directory = pathlib.Path(directory)
        self._make_directory()
        self.path = self.directory / f"{self.directory.absolute().name}_0.mcap"
        self._information = FileInformation(self.path.name)
        self._topics: dict[int, TopicInformation] = {}
        self._schemas: dict[tuple[str, str], int] = {}
        self._custom_metadata = {str(k): str(v) for k, v in (custom_metadata or {}).items()}
        self._steady_clock = steady_clock
        self._next_flush = steady_clock() + FLUSH_INTERVAL
        self._closed = False
        self._failed = False
        self._file = _RecordFile(self.path)
        try:
            stream = cast(IO[bytes], self._file)
            self._writer = Writer(stream, chunk_size, COMPRESSIONS[compression])
            self._writer.start(profile=PROFILE, library=LIBRARY)
            self._write_metadata_file()
        except BagWriteError:
            self._abandon()
            raise

    def _make_directory(self) -> None:
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            occupied = any(
                entry.suffix == ".mcap" or entry.name == bag_metadata.METADATA_FILE
                for entry in self.directory.iterdir()
            )
        except OSError as error:
            raise BagWriteError(
                f"{self.directory}: cannot make the bag directory: {error.strerror or error}"
            ) from error
        if occupied:
            raise BagWriteError(f"{self.directory}: holds a bag already; choose another directory")

    @property
    def message_counts(self) -> dict[str, int]:
        """Number of messages written so far, by topic."""
        return {topic.name: topic.message_count for topic in self._topics.values()}

    def topic_number(self, name: str) -> int | None:
        """Return the number of a topic; None if the topic was not added."""
        return next((number for number, topic in self._topics.items() if topic.name == name), None)

    def add_custom_metadata(self, custom_metadata: Mapping[str, str]) -> None:
        """Add texts to ``custom_data``; `close` writes them."""
        self._custom_metadata.update({str(k): str(v) for k, v in custom_metadata.items()})

    @property
    def message_count(self) -> int:
        """Number of messages written so far."""
        return self._information.message_count

    @property
    def disk_alarm(self) -> str:
        """Why the bag takes little more, one line: the disk is full; empty while it has room."""
        return self._file.alarm

    @property
    def failed(self) -> bool:
        """Whether a write error has ended the recording."""
        return self._failed

    def add_topic(
        self,
        name: str,
        type_name: str,
        offered_qos_profiles: Iterable[QosEntry] = (),
        type_hash: str = "",
        definition: str | None = None,
    ) -> int:
        """Add a topic and return its number, which `write` needs.

        Parameters
        ----------
        name
            Name of the topic with its leading slash.
        type_name
            ``package/msg/Type``.
        offered_qos_profiles
            Profiles of the publishers, see `vtff_bag.file.metadata.offered_qos`.
        type_hash
            ``RIHS01_...``; empty if it is unknown.
        definition
            Schema text; if not given, that of the installed message type.

        Raises
        ------
        UnknownTypeError
            If no definition is given and the type is not installed.
        """
        self._check_open()
        text = message_definition(type_name) if definition is None else definition
        topic = TopicInformation(
            name=name,
            type=type_name,
            offered_qos_profiles=list(offered_qos_profiles),
            type_hash=type_hash,
        )
        try:
            topic_id = self._register(topic, text)
        except BagWriteError:
            self._abandon()
            raise
        self._topics[topic_id] = topic
        return topic_id

    def _register(self, topic: TopicInformation, text: str) -> int:
        schema_id = self._schemas.get((topic.type, text))
        if schema_id is None:
            schema_id = self._writer.register_schema(topic.type, SCHEMA_ENCODING, text.encode())
            self._schemas[topic.type, text] = schema_id
        return self._writer.register_channel(
            topic=topic.name,
            message_encoding=MESSAGE_ENCODING,
            schema_id=schema_id,
            metadata={
                "offered_qos_profiles": format_yaml(topic.offered_qos_profiles),
                "topic_type_hash": topic.type_hash,
            },
        )

    def write(
        self, topic_id: int, serialized: bytes, log_time: int, publish_time: int | None = None
    ) -> None:
        """Append a message.

        Parameters
        ----------
        topic_id
            Number of the topic, from `add_topic`.
        serialized
            CDR of the message with the four bytes of encapsulation.
        log_time, publish_time
            Times in ns since 1970, not negative; ``publish_time`` is ``log_time`` if not given.
        """
        self._check_open()
        self._topics[topic_id].message_count += 1
        self._information.add_message(log_time)
        try:
            self._writer.add_message(
                topic_id, log_time, serialized, log_time if publish_time is None else publish_time
            )
        except BagWriteError:
            self._abandon()
            raise
        self.flush_if_due()

    def flush(self) -> None:
        """Finish the current chunk and hand it to the operating system."""
        self._check_open()
        self._next_flush = self._steady_clock() + FLUSH_INTERVAL
        try:
            self._writer.flush()
        except BagWriteError:
            self._abandon()
            raise

    def flush_if_due(self) -> None:
        """Flush if the last flush was a second ago; needed while no message is written."""
        if self._steady_clock() >= self._next_flush:
            self.flush()

    def close(self) -> None:
        """Write the summary and the final ``metadata.yaml``; a second call does nothing."""
        if self._closed or self._failed:
            return
        try:
            serialized = format_yaml(self._make_metadata().as_dictionary())
            self._writer.add_metadata("rosbag2", {"serialized_metadata": serialized})
            self._writer.finish()
            self._file.close()
            self._write_metadata_file()
        except BagWriteError:
            self._abandon()
            raise
        self._closed = True

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def _check_open(self) -> None:
        if self._failed:
            raise BagWriteError(f"{self.path}: an earlier write failed; nothing more is written")
        if self._closed:
            raise BagWriteError(f"{self.path}: the bag is closed")

    def _abandon(self) -> None:
        """Close the file after a failure; flushed chunks stay readable and recoverable."""
        self._failed = True
        self._file.close()

    def _make_metadata(self) -> BagMetadata:
        return BagMetadata(
            files=[self._information],
            topics=list(self._topics.values()),
            custom_data=self._custom_metadata,
        )

    def _write_metadata_file(self) -> None:
        bag_metadata.write_metadata(self.directory, self._make_metadata())
