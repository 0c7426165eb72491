"""Messages many at a time are those that the reader returns one by one."""

import bag_samples
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from observation_messages import random_observations
from rclpy.serialization import serialize_message

from vtff_bag.file import message_batches as batches
from vtff_bag.file.cdr_columns import ColumnCollector
from vtff_bag.file.errors import BagReadError
from vtff_bag.file.reader import BagReader

TYPE = "std_msgs/msg/String"


def read_in_batches(reader, topics):
    """Return the messages of topics as the reader does, from batches."""
    read = []
    for batch in batches.message_batches(reader, topics):
        alone = batch.alone()
        assert len(alone.stored) == int((batch.end - batch.begin).sum())
        for row in range(len(alone.begin)):
            name = topics[int(alone.topic[row])]
            read += alone.rows(slice(row, row + 1)).raw_messages(name, TYPE)
    return read


@pytest.mark.parametrize("blocks", [1, 2, 64])
@pytest.mark.parametrize("neighbours", [0, 5, 37])
@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_order_is_that_of_single_messages(tmp_path, monkeypatch, blocks, neighbours, compression):
    monkeypatch.setattr(batches, "_BLOCKS_TOGETHER", blocks)
    messages = bag_samples.sample_messages(896)
    shuffled = [messages[index ^ neighbours] for index in range(896)]
    # Many messages have one time, also across blocks.
    shuffled = [
        (topic, data, time - time % (7 * bag_samples.STEP)) for topic, data, time in shuffled
    ]
    bag_samples.write_bag(tmp_path, shuffled, compression=compression, chunk_size=2048)
    reader = BagReader(tmp_path)
    for topics in (["/topic_2", "/topic_0"], ["/topic_1"]):
        expected = list(reader.raw_messages(topics))
        assert read_in_batches(reader, topics) == expected and expected


def test_a_damaged_block_is_left_out_and_noted(tmp_path):
    bag_samples.write_bag(tmp_path, bag_samples.sample_messages(900), chunk_size=2048)
    (file,) = tmp_path.glob("*.mcap")
    content = bytearray(file.read_bytes())
    block = BagReader(tmp_path).contents[0].blocks[3]
    content[block.offset + block.length // 2] ^= 0xFF
    file.write_bytes(content)
    one_by_one, together = BagReader(tmp_path), BagReader(tmp_path)
    expected = list(one_by_one.raw_messages(["/topic_0"]))
    assert read_in_batches(together, ["/topic_0"]) == expected
    assert together.notes == one_by_one.notes and len(together.notes) == 1


def test_records_that_are_cut_off():
    with pytest.raises(ValueError, match="a record is cut off"):
        batches.find_messages(
            b"\x05" + (22).to_bytes(8, "little") + bytes(21), batches.topic_table({0: 0}), 0
        )
    with pytest.raises(ValueError, match="a record is cut off"):
        batches.find_messages(
            b"\x05" + (21).to_bytes(8, "little") + bytes(21), batches.topic_table({0: 0}), 0
        )
    with pytest.raises(ValueError, match="a record is cut off"):
        batches.find_messages(b"\x07" + b"\xff" * 8 + bytes(50), batches.topic_table({0: 0}), 0)
    with pytest.raises(ValueError, match="a record is cut off"):
        batches.find_messages(bytes(8), batches.topic_table({0: 0}), 0)


def test_a_topic_that_is_not_in_the_bag(tmp_path):
    bag_samples.write_bag(tmp_path, bag_samples.sample_messages(9))
    with pytest.raises(BagReadError, match="no topic '/absent'"):
        batches.message_batches(BagReader(tmp_path), ["/absent"])


def test_columns_of_a_batch_are_those_of_its_messages():
    generator = np.random.default_rng(3)
    stored = [
        serialize_message(random_observations(count, "a" * count, generator))
        for count in (4, 0, 7, 1)
    ]
    end = np.cumsum([len(message) for message in stored])
    begin = np.concatenate(([0], end[:-1]))
    none = np.zeros(4, dtype=np.int64)
    batch = batches.MessageBatch(
        np.frombuffer(b"".join(stored), dtype=np.uint8), none, none, none, begin, end
    )
    together = ColumnCollector("vtff_msgs/msg/GnssObservations", "here")
    together.add(stored[2])
    together.add_batch(batch.rows(np.array([3, 0, 1])))
    one_by_one = ColumnCollector("vtff_msgs/msg/GnssObservations", "here")
    for number in (2, 3, 0, 1):
        one_by_one.add(stored[number])
    columns, expected = together.columns(), one_by_one.columns()
    assert columns.count == expected.count == 4
    for name, values in expected.numbers.items():
        assert np.array_equal(columns.numbers[name], values, equal_nan=True)
    for name, values in expected.sequences.items():
        assert np.array_equal(columns.sequences[name], values, equal_nan=True)
        assert np.array_equal(columns.lengths[name], expected.lengths[name])


@given(st.binary(min_size=8, max_size=20), st.integers(1, 8), st.integers(0, 12))
def test_integers_are_those_of_python(content, length, place):
    place = min(place, len(content) - length)
    expected = int.from_bytes(content[place : place + length], "little", signed=length == 8)
    assert batches.read_integer(np.frombuffer(content, dtype=np.uint8), place, length) == expected
