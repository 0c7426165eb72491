"""Bag reader: a bag directory or a single MCAP file, complete or damaged.

The reader does not use ``mcap.reader.make_reader``, not even for whole files, though that is about
as fast. It reads one file, and it stops at the first damaged byte without a list of the messages
that are intact. Here whole and damaged files take one path: their blocks come from the summary or
from a scan (`mcap_blocks`). So both are read in the same order, the files of a bag are merged, and
only blocks that overlap in time are in memory.
"""

from __future__ import annotations

import bisect
import contextlib
import os
import pathlib
import stat
from collections.abc import Collection, Iterator
from typing import Any, BinaryIO, NamedTuple

from vtff_bag.file import mcap_blocks
from vtff_bag.file import metadata as bag_metadata
from vtff_bag.file.errors import BagError, BagReadError
from vtff_bag.file.mcap_blocks import Block, FileContent
from vtff_bag.file.message_definitions import deserialize, message_class
from vtff_bag.file.metadata import BagMetadata, TopicInformation

SUFFIX = ".mcap"
RUN_SUBDIRECTORY = "bag"


class RawMessage(NamedTuple):
    """A recorded message: topic, type, log time in ns since 1970, CDR bytes."""

    topic: str
    type: str
    log_time: int
    serialized: bytes


class DecodedMessage(NamedTuple):
    """A deserialised message with its log time in ns since 1970."""

    log_time: int
    message: Any


#: Topics of bags that were recorded when a formation had one deputy.
OLD_TOPICS = frozenset(
    f"/formation/{name}"
    for name in (
        "relative_state",
        "relative_state_truth",
        "ambiguities",
        "differential_tec",
        "target",
        "laser_range",
        "electron_density",
        "irregularity_boundary",
    )
)


class BagReader:
    """Reads a bag.

    Parameters
    ----------
    path
        The bag directory, a run folder with a bag in ``bag/``, or one ``.mcap`` file.
    scan
        Read every file to its end and check every chunk, even if the summary is intact.

    Attributes
    ----------
    topics
        `TopicInformation` by topic name, in the order of the file.
    files
        The storage files.
    start_time, end_time
        Log time of the first and the last message, ns since 1970; 0 in an empty bag.
    notes
        One line for each defect of the bag; empty for a complete bag.

    Raises
    ------
    BagReadError
        If there is no bag or nothing in it can be read; the text names the file.
    """

    def __init__(self, path: str | os.PathLike[str], *, scan: bool = False) -> None:
        try:
            self.path = _find_bag(pathlib.Path(path))
        except OSError as error:  # a name that is too long, a folder that may not be read
            raise BagReadError(f"{path}: {error.strerror}") from error
        self.notes: list[str] = []
        self.metadata: BagMetadata | None = None
        self.files = self._find_files()
        read = mcap_blocks.scan_content if scan else mcap_blocks.read_content
        self.contents: list[FileContent] = [read(file) for file in self.files]
        for content in self.contents:
            self.notes.extend(f"{content.path.name}: {note}" for note in content.notes)
        self.topics = self._merge_topics()
        self._refuse_old_topics()
        self._check_metadata()
        filled = [content for content in self.contents if content.message_count]
        self.start_time = min((content.start_time for content in filled), default=0)
        self.end_time = max((content.end_time for content in filled), default=0)

    def _refuse_old_topics(self) -> None:
        """Refuse bags whose topics of the deputy are not in its namespace."""
        old = sorted(OLD_TOPICS.intersection(self.topics))
        if old:
            raise BagReadError(
                f"{self.path}: an older vtff recorded it, with '{old[0]}': what belongs to a "
                "deputy is now in its namespace; record the run anew"
            )

    @property
    def complete(self) -> bool:
        """Whether every file was closed properly and no part is damaged."""
        return all(content.complete for content in self.contents) and not self.notes

    @property
    def message_count(self) -> int:
        """Number of messages of all topics."""
        return sum(topic.message_count for topic in self.topics.values())

    @property
    def custom_data(self) -> dict[str, str]:
        """Texts that the recorder stored, for example the description of the run."""
        return dict(self.metadata.custom_data) if self.metadata is not None else {}

    def raw_messages(
        self,
        topics: Collection[str] | None = None,
        start: int | None = None,
        end: int | None = None,
    ) -> Iterator[RawMessage]:
        """Iterate over messages by log time, then in file order.

        Damaged parts are left out and described in `notes`.

        Parameters
        ----------
        topics
            Topics whose messages are returned; all if not given.
        start, end
            Limits of the log time, ns since 1970: messages from ``start`` on and before ``end``.

        Raises
        ------
        BagReadError
            If a topic is not in the bag.
        """
        for name in topics or ():
            self.check_topic(name)
        return self._merge_blocks(set(self.topics if topics is None else topics), start, end)

    def messages(self, topic: str) -> Iterator[DecodedMessage]:
        """Iterate over the deserialised messages of a topic by log time; needs rclpy.

        Raises
        ------
        BagReadError
            If the topic is not in the bag, or a message does not fit its type.
        UnknownTypeError
            If the message type is not installed.
        """
        for raw in self.raw_messages([topic]):
            yield self.decoded(raw)

    def decoded(self, raw: RawMessage) -> DecodedMessage:
        """Return a deserialised message; needs rclpy, raises as `messages`."""
        class_of_topic = message_class(raw.type)
        try:
            message = deserialize(raw.serialized, class_of_topic)
        except Exception as error:  # rclpy raises its own and C++ exceptions here
            raise BagReadError(
                f"{self.path}: topic '{raw.topic}': a message at {raw.log_time} ns is not a "
                f"{raw.type}: {error}"
            ) from error
        return DecodedMessage(raw.log_time, message)

    def check_topic(self, name: str) -> None:
        """Raise BagReadError if a topic is not in the bag."""
        if name not in self.topics:
            present = ", ".join(self.topics) or "none"
            raise BagReadError(f"{self.path}: no topic '{name}' in the bag; topics: {present}")

    def note(self, defect: str) -> None:
        """Add a line to `notes`, unless it is there already."""
        if defect not in self.notes:
            self.notes.append(defect)

    def _find_files(self) -> list[pathlib.Path]:
        if not self.path.exists():
            raise BagReadError(f"{self.path}: no such bag")
        if not self.path.is_dir():
            mode = self.path.stat().st_mode
            if stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode) or stat.S_ISCHR(mode):
                raise BagReadError(f"{self.path}: neither a folder nor a regular file")
            self._read_metadata_beside(self.path)
            return [self.path]
        present = sorted(self.path.glob(f"*{SUFFIX}"))
        metadata_path = self.path / bag_metadata.METADATA_FILE
        if not metadata_path.is_file():
            if not present:
                raise BagReadError(
                    f"{self.path}: not a bag: neither {bag_metadata.METADATA_FILE} nor a "
                    f"{SUFFIX} file in it"
                )
            self.notes.append(f"{bag_metadata.METADATA_FILE} is missing")
            return present
        return self._find_files_by_metadata(metadata_path, present)

    def _find_files_by_metadata(
        self, metadata_path: pathlib.Path, present: list[pathlib.Path]
    ) -> list[pathlib.Path]:
        try:
            self.metadata = bag_metadata.read_metadata(metadata_path)
        except BagReadError as error:
            if not present:
                raise
            self.notes.append(str(error))
            return present
        if self.metadata.storage_identifier != bag_metadata.STORAGE_IDENTIFIER:
            raise BagReadError(
                f"{metadata_path}: storage '{self.metadata.storage_identifier}' is not supported, "
                f"only {bag_metadata.STORAGE_IDENTIFIER}"
            )
        # Only the name is used: old versions stored a path that began with the folder of the bag.
        listed = [self.path / pathlib.PurePath(file.path).name for file in self.metadata.files]
        missing = [file for file in listed if not file.is_file()]
        if missing and not present:
            raise BagReadError(f"{missing[0]}: named in {metadata_path.name} but missing")
        self.notes.extend(
            f"{file.name}: named in {metadata_path.name} but missing" for file in missing
        )
        return [file for file in listed if file not in missing] or present

    def _read_metadata_beside(self, file: pathlib.Path) -> None:
        metadata_path = file.parent / bag_metadata.METADATA_FILE
        # A single file can be read without metadata, so that errors of the metadata do not matter.
        with contextlib.suppress(BagError):
            metadata = bag_metadata.read_metadata(metadata_path)
            if any(pathlib.PurePath(entry.path).name == file.name for entry in metadata.files):
                self.metadata = metadata

    def _check_metadata(self) -> None:
        """Use the metadata in the file if metadata.yaml is missing or of another bag."""
        stored = next(
            (content.bag_metadata for content in self.contents if content.bag_metadata), ""
        )
        stored_metadata = bag_metadata.parse_stored_metadata(stored) if stored else None
        if self.metadata is None:
            self.metadata = stored_metadata
            return
        reason = self._find_contradiction(self.metadata)
        if reason:
            self.notes.append(f"{bag_metadata.METADATA_FILE} is of another bag: {reason}")
            self.metadata = stored_metadata

    def _find_contradiction(self, metadata: BagMetadata) -> str:
        """Return how the metadata contradict the files; empty if they may be of the same bag."""
        listed = {topic.name for topic in metadata.topics}
        unlisted = sorted(set(self.topics) - listed)
        # The metadata of a recorder that was killed are those of its start, without topics.
        if listed and unlisted:
            return f"it does not list topic '{unlisted[0]}'"
        present = {file.name for file in self.files}
        whole = present == {pathlib.PurePath(file.path).name for file in metadata.files}
        if whole and all(content.complete for content in self.contents):
            if metadata.message_count != self.message_count:
                return (
                    f"it lists {metadata.message_count} messages, the files hold "
                    f"{self.message_count}"
                )
        return ""

    def _merge_topics(self) -> dict[str, TopicInformation]:
        topics: dict[str, TopicInformation] = {}
        for content in self.contents:
            for channel_id, channel in sorted(content.channels.items()):
                schema = content.schemas.get(channel.schema_id)
                topic = topics.setdefault(
                    channel.topic,
                    TopicInformation(
                        name=channel.topic,
                        type=schema.name if schema is not None else "",
                        offered_qos_profiles=bag_metadata.parse_qos(
                            channel.metadata.get("offered_qos_profiles")
                        ),
                        type_hash=channel.metadata.get("topic_type_hash", ""),
                        serialization_format=channel.message_encoding,
                    ),
                )
                topic.message_count += content.message_counts.get(channel_id, 0)
        return topics

    def blocks_by_time(self) -> list[tuple[int, int, int, Block]]:
        """Return start time, number of the file, offset, and block, of all blocks in that order."""
        return sorted(
            (block.start_time, number, block.offset, block)
            for number, content in enumerate(self.contents)
            for block in content.blocks
        )

    def _merge_blocks(
        self, wanted: set[str], start: int | None, end: int | None
    ) -> Iterator[RawMessage]:
        """Merge the blocks of all files; only blocks that overlap in time are in memory."""
        blocks = [
            (start_time, number, offset, block)
            for start_time, number, offset, block in self.blocks_by_time()
            if (start is None or block.end_time >= start) and (end is None or start_time < end)
        ]
        pending: list[Any] = []  # (log time, file, offset of the block, index in it, message)
        with contextlib.ExitStack() as stack:
            opened = [stack.enter_context(open(file, "rb")) for file in self.files]
            for start_time, number, _, block in blocks:
                # Strictly before: of equal times, the message earlier in the file goes first.
                ready = bisect.bisect_left(pending, (start_time,))
                yield from (item[-1] for item in pending[:ready])
                del pending[:ready]
                pending.extend(
                    self._read_selected(number, block, opened[number], wanted, start, end)
                )
                pending.sort()
            yield from (item[-1] for item in pending)

    def _read_selected(
        self,
        number: int,
        block: Block,
        file: BinaryIO,
        wanted: set[str],
        start: int | None,
        end: int | None,
    ) -> list[tuple[int, int, int, int, RawMessage]]:
        """Return the messages of a block, each behind what messages are sorted by."""
        content = self.contents[number]
        names = {
            channel_id: (channel.topic, self.topics[channel.topic].type)
            for channel_id, channel in content.channels.items()
            if channel.topic in wanted
        }
        try:
            messages = mcap_blocks.read_block(content, block, file, names)
        except BagReadError as error:
            self.note(str(error))
            return []
        # One loop without generators: a bag has thousands of messages for each second of reading.
        offset = block.offset
        new = tuple.__new__  # that of the class takes twice as long
        selected = []
        for index, (channel_id, log_time, _, serialized) in enumerate(messages):
            if start is not None and log_time < start:
                continue
            if end is not None and log_time >= end:
                continue
            topic, type_name = names[channel_id]
            raw = new(RawMessage, (topic, type_name, log_time, serialized))
            selected.append((log_time, number, offset, index, raw))
        return selected


def _find_bag(path: pathlib.Path) -> pathlib.Path:
    """Return the bag inside a run folder; any other path as it is."""
    inside = path / RUN_SUBDIRECTORY
    is_bag = (path / bag_metadata.METADATA_FILE).is_file() or any(path.glob(f"*{SUFFIX}"))
    return inside if inside.is_dir() and not is_bag else path
