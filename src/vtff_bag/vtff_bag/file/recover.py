"""Recovery of a bag that was not closed: its intact messages are copied into a new bag."""

from __future__ import annotations

import dataclasses
import os
import pathlib
from collections.abc import Callable

from vtff_bag.file import mcap_blocks
from vtff_bag.file.errors import BagExistsError, BagReadError
from vtff_bag.file.mcap_blocks import FileContent
from vtff_bag.file.reader import BagReader
from vtff_bag.file.writer import BagWriter


@dataclasses.dataclass(frozen=True)
class RecoveryReport:
    """Result of a recovery; times in ns since 1970."""

    source: pathlib.Path
    output: pathlib.Path
    message_counts: dict[str, int]
    start_time: int
    end_time: int
    damaged_bytes: int
    was_complete: bool
    notes: tuple[str, ...]

    @property
    def message_count(self) -> int:
        """Number of messages recovered."""
        return sum(self.message_counts.values())

    def __str__(self) -> str:
        seconds = (self.end_time - self.start_time) * 1e-9
        lines = [
            f"recovered {self.message_count} messages of {len(self.message_counts)} topics, "
            f"{seconds:.3f} s of scenario time: {self.source} -> {self.output}",
        ]
        lines.extend(f"note: {note}" for note in self.notes)
        if self.was_complete:
            lines.append("note: the bag was complete; the copy holds the same messages")
        return "\n".join(lines)


def recover(
    path: str | os.PathLike[str], output: str | os.PathLike[str] | None = None
) -> RecoveryReport:
    """Copy all intact messages of a bag into a new bag with summary and metadata.

    The original is only read.

    Parameters
    ----------
    path
        Bag directory or ``.mcap`` file, damaged, cut off or complete.
    output
        Directory of the new bag; ``<name>_recovered`` beside the original if not given.

    Raises
    ------
    BagReadError
        If nothing in the bag is readable; the text names the file.
    BagExistsError
        If the output exists.
    BagWriteError
        If the output cannot be written; the text names its path.
    """
    reader = BagReader(path, scan=True)
    directory = pathlib.Path(output) if output is not None else default_output(reader.path)
    if directory.exists():
        raise BagExistsError(f"{directory}: exists already; remove it or name another output")
    notes = list(reader.notes)
    custom = {**reader.custom_data, "recovered_from": reader.path.absolute().name}
    with BagWriter(directory, custom) as writer:
        for content in reader.contents:
            notes.extend(copy_messages(content, reader, writer))
        # The counts are final before the bag is closed: closing only adds the summary.
        counts = writer.message_counts
    return RecoveryReport(
        source=reader.path,
        output=directory,
        message_counts=counts,
        start_time=reader.start_time,
        end_time=reader.end_time,
        damaged_bytes=sum(content.damaged_bytes for content in reader.contents),
        was_complete=reader.complete,
        notes=tuple(notes),
    )


def default_output(path: pathlib.Path) -> pathlib.Path:
    """Return ``<name>_recovered`` beside a bag directory or file."""
    absolute = path.absolute()
    name = absolute.name if absolute.is_dir() else absolute.stem
    return absolute.with_name(f"{name}_recovered")


def copy_messages(
    content: FileContent,
    reader: BagReader,
    writer: BagWriter,
    wants: Callable[[str, bytes], bool] | None = None,
) -> list[str]:
    """Copy the messages of one file in file order.

    Parameters
    ----------
    content
        The file.
    reader
        The bag that it belongs to.
    writer
        The bag that takes the messages.
    wants
        Returns whether a message is copied, from its topic and its bytes; by default each is.

    Returns
    -------
    list of str
        One line for each loss of messages.
    """
    notes = []
    topic_numbers = {}
    for channel_id, channel in sorted(content.channels.items()):
        schema = content.schemas.get(channel.schema_id)
        if schema is None:
            notes.append(f"{content.path.name}: the type of topic '{channel.topic}' is lost")
            continue
        information = reader.topics[channel.topic]
        topic_numbers[channel_id] = writer.topic_number(channel.topic) or writer.add_topic(
            channel.topic,
            schema.name,
            information.offered_qos_profiles,
            information.type_hash,
            schema.data.decode("utf-8", errors="replace"),
        )
    with open(content.path, "rb") as file:
        for block in sorted(content.blocks, key=lambda block: block.offset):
            try:
                messages = mcap_blocks.read_block(content, block, file)
            except BagReadError as error:
                notes.append(str(error))
                continue
            for message in messages:
                number = topic_numbers.get(message.channel_id)
                if number is None:
                    continue
                topic = content.channels[message.channel_id].topic
                if wants is None or wants(topic, message.serialized):
                    writer.write(number, message.serialized, message.log_time, message.publish_time)
    return notes
