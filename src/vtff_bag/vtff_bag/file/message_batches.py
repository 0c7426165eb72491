"""Messages of a bag, many at a time, without a Python object for each message.

The messages of some thousand records stay where they are in the bytes of their blocks; arrays tell
where each begins and ends. `vtff_bag.file.cdr_columns` makes columns of them.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from typing import BinaryIO, NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_bag.file import mcap_blocks
from vtff_bag.file.errors import BagReadError
from vtff_bag.file.mcap_blocks import MESSAGE_HEAD_SIZE, MESSAGE_OPCODE, RECORD, Block
from vtff_bag.file.reader import BagReader, RawMessage
from vtff_dynamics.compiled import compiled

__all__ = [
    "MessageBatch",
    "copy_parts",
    "find_messages",
    "join_batches",
    "message_batches",
    "read_integer",
    "topic_table",
]

_BLOCKS_TOGETHER = 64

_RECORD_SIZE: int = RECORD.size
# Places in the bytes of a record: its length, and in the message behind that the log time.
_LENGTH, _LOG_TIME = 1, 6
_CHANNELS = 1 << 16


class MessageBatch(NamedTuple):
    """Messages in the bytes of their blocks; arrays of shape (m,).

    Attributes
    ----------
    stored : ndarray of uint8, shape (n,)
        Bytes of blocks.
    topic : ndarray of int
        Index of the topic of each message.
    log_time : ndarray of int
        ns since 1970.
    block : ndarray of int
        Where the block of the message is among all blocks, in the order of the files.
    begin, end : ndarray of int
        First byte of the serialised message in `stored`, and the byte after its last one.
    """

    stored: npt.NDArray[np.uint8]
    topic: npt.NDArray[np.int64]
    log_time: npt.NDArray[np.int64]
    block: npt.NDArray[np.int64]
    begin: npt.NDArray[np.int64]
    end: npt.NDArray[np.int64]

    def rows(self, chosen: slice | npt.NDArray[np.intp]) -> MessageBatch:
        """Return the chosen messages, in the same bytes."""
        return MessageBatch(self.stored, *(column[chosen] for column in self[1:]))

    def in_order(self) -> MessageBatch:
        """Return the messages by log time, then in file order."""
        return self.rows(np.lexsort((self.block, self.log_time)))

    def alone(self) -> MessageBatch:
        """Return the messages in bytes that hold nothing else."""
        length = self.end - self.begin
        end = np.cumsum(length)
        stored = np.empty(int(length.sum()), dtype=np.uint8)
        copy_parts(self.stored, self.begin, length, stored)
        return self._replace(stored=stored, begin=end - length, end=end)

    def raw_messages(self, topic: str, type_name: str) -> list[RawMessage]:
        """Return messages that are all of one topic, one by one."""
        columns = (self.log_time, self.begin, self.end)
        return [
            RawMessage(topic, type_name, log_time, self.stored[begin:end].tobytes())
            for log_time, begin, end in zip(*(c.tolist() for c in columns), strict=True)
        ]


def message_batches(reader: BagReader, topics: Sequence[str]) -> Iterator[MessageBatch]:
    """Iterate over messages of a bag in the order of `BagReader.raw_messages`, many at a time.

    Damaged parts are left out and described in the notes of the reader.

    Parameters
    ----------
    reader : BagReader
    topics : sequence of str
        Topics whose messages are returned; batches have their indices.

    Raises
    ------
    BagReadError
        If a topic is not in the bag.
    """
    for name in topics:
        reader.check_topic(name)
    return _merge_blocks(reader, {name: index for index, name in enumerate(topics)})


def _merge_blocks(reader: BagReader, topics: Mapping[str, int]) -> Iterator[MessageBatch]:
    """Merge the blocks of all files; only blocks that are near in time are in memory."""
    blocks = reader.blocks_by_time()
    places = {place: index for index, place in enumerate(sorted(block[1:3] for block in blocks))}
    topics_of_channels = [
        topic_table(
            {
                channel_id: topics[channel.topic]
                for channel_id, channel in content.channels.items()
                if channel.topic in topics
            }
        )
        for content in reader.contents
    ]
    waiting: list[MessageBatch] = []
    with contextlib.ExitStack() as stack:
        opened = [stack.enter_context(open(file, "rb")) for file in reader.files]
        for first in range(0, len(blocks), _BLOCKS_TOGETHER):
            after = first + _BLOCKS_TOGETHER
            for _, number, offset, block in blocks[first:after]:
                waiting += _read_block(
                    reader,
                    number,
                    block,
                    opened[number],
                    topics_of_channels[number],
                    places[number, offset],
                )
            if not waiting:
                continue
            batch = join_batches(waiting).in_order()
            # Strictly before: of equal times, the message earlier in the file goes first.
            ready = len(batch.begin)
            if after < len(blocks):
                ready = int(np.searchsorted(batch.log_time, blocks[after][0]))
            yield batch.rows(slice(ready))
            waiting = [batch.rows(slice(ready, None)).alone()]


def _read_block(
    reader: BagReader,
    number: int,
    block: Block,
    file: BinaryIO,
    topics: npt.NDArray[np.int64],
    place: int,
) -> list[MessageBatch]:
    """Return the messages of a block of a file, by its number; none if the block is damaged."""
    content = reader.contents[number]
    try:
        records = mcap_blocks.read_records(content, block, file)
        with mcap_blocks.damage_named(content, block):
            return [find_messages(records, topics, place)]
    except BagReadError as error:
        reader.note(str(error))
        return []


def topic_table(topic_of_channel: Mapping[int, int]) -> npt.NDArray[np.int64]:
    """Return the topic of every channel that there may be; -1 where none is given."""
    topics = np.full(_CHANNELS, -1, dtype=np.int64)
    for channel, topic in topic_of_channel.items():
        topics[channel] = topic
    return topics


def find_messages(records: bytes, topics: npt.NDArray[np.int64], block: int) -> MessageBatch:
    """Return the messages of some channels in the records of a block, in file order.

    Parameters
    ----------
    records : bytes
        As `mcap_blocks.read_records` returns them.
    topics : ndarray of int
        Index of the topic of each channel, of `topic_table`; -1 where no messages are wanted.
    block : int
        See `MessageBatch`.

    Raises
    ------
    ValueError
        If a record is cut off.
    """
    stored = np.frombuffer(records, dtype=np.uint8)
    count, places = _find_messages(stored, topics)
    if count < 0:
        raise ValueError("a record is cut off")
    topic, log_time, begin, end = places[:, :count]
    return MessageBatch(stored, topic, log_time, np.full(count, block), begin, end)


def join_batches(batches: Sequence[MessageBatch]) -> MessageBatch:
    """Return the messages of one or more batches, one batch after the other."""
    sizes = [len(batch.stored) for batch in batches]
    shift = np.repeat(np.cumsum([0, *sizes[:-1]]), [len(batch.begin) for batch in batches])
    joined = MessageBatch(*(np.concatenate(columns) for columns in zip(*batches, strict=True)))
    return joined._replace(begin=joined.begin + shift, end=joined.end + shift)


@compiled
def read_integer(content, place, length):  # type: ignore[no-untyped-def]
    """Return the integer of some bytes, the lowest first; one of eight bytes may be negative.

    Parameters
    ----------
    content : ndarray of uint8, shape (n,)
    place : int
        Place of the first byte.
    length : int
        Number of bytes, 1 to 8.
    """
    number = np.int64(0)
    for byte in range(length):
        number |= np.int64(content[place + byte]) << (8 * byte)
    return number


@compiled
def copy_parts(stored, begin, length, result):  # type: ignore[no-untyped-def]
    """Copy parts of bytes, which begin somewhere, to a result one after the other."""
    place = 0
    for part in range(len(begin)):
        size = length[part]
        # Loops from zero over a view are those that become instructions for many bytes at once.
        source = stored[begin[part] : begin[part] + size]
        target = result[place : place + size]
        for number in range(size):
            target[number] = source[number]
        place += size


@compiled
def _find_messages(stored, topics):  # type: ignore[no-untyped-def]
    """Return how many messages there are, and topic, log time, begin and end of each, (4, n).

    `topics` is the index of the topic of each channel, -1 where its messages are not wanted. The
    number is -1 if a record is cut off.
    """
    size = len(stored)
    places = np.empty((4, size // (_RECORD_SIZE + MESSAGE_HEAD_SIZE) + 1), dtype=np.int64)
    count = 0
    position = 0
    while position < size:
        start = position + _RECORD_SIZE
        if start > size:
            return -1, places
        length = read_integer(stored, position + _LENGTH, 8)
        is_message = stored[position] == MESSAGE_OPCODE
        # A length is without sign: one that seems negative is far beyond the end.
        if length < 0 or length > size - start or (is_message and length < MESSAGE_HEAD_SIZE):
            return -1, places
        position = start + length
        if is_message:
            topic = topics[read_integer(stored, start, 2)]
            if topic >= 0:
                places[0, count] = topic
                places[1, count] = read_integer(stored, start + _LOG_TIME, 8)
                places[2, count] = start + MESSAGE_HEAD_SIZE
                places[3, count] = position
                count += 1
    return count, places
