"""Killed, cut off and damaged bags: nothing intact is lost, nothing false is added."""

import random
import subprocess
import sys
import textwrap

import bag_samples
import pytest

from vtff_bag.file.errors import BagError, BagReadError, BagWriteError
from vtff_bag.file.info import describe_bag
from vtff_bag.file.reader import BagReader
from vtff_bag.file.recover import recover

TEST_DIRECTORY = bag_samples.__file__.rsplit("/", 1)[0]
COUNT = 1000
CHUNK_SIZE = 5 * 1024
LARGEST_LOSS = 130  # messages of a chunk


def texts(path):
    return [message.serialized for message in BagReader(path).raw_messages()]


@pytest.fixture(scope="module", params=["zstd", "none"])
def original(request, tmp_path_factory):
    messages = bag_samples.sample_messages(COUNT)
    directory = tmp_path_factory.mktemp("original") / "bag"
    bag_samples.write_bag(directory, messages, compression=request.param, chunk_size=CHUNK_SIZE)
    return (directory / "bag_0.mcap").read_bytes(), [message[1] for message in messages]


def examine(path):
    """Run info and recover; return the recovered messages, None after a clear error."""
    before = path.read_bytes()
    try:
        describe_bag(path)
        report = recover(path)
    except BagError as error:
        assert str(path) in str(error)
        return None
    finally:
        assert path.read_bytes() == before
    assert BagReader(report.output).complete
    recovered = texts(report.output)
    assert len(recovered) == report.message_count
    return recovered


def test_killed_recorder_loses_at_most_the_last_second(tmp_path):
    """The child's flush clock advances by 0.01 s a message: a second is 100 messages."""
    script = textwrap.dedent(
        """
        import sys, time
        import bag_samples
        now = [0.0]
        writer = bag_samples.write_bag(
            sys.argv[1], [], close=False, chunk_size=1 << 20, steady_clock=lambda: now[0]
        )
        for index, (topic, serialized, log_time) in enumerate(bag_samples.sample_messages(2550)):
            now[0] = 0.01 * index
            writer.write(topic + 1, serialized, log_time)
        print("written", flush=True)
        sys.stdin.read()
        """
    )
    child = subprocess.Popen(
        [sys.executable, "-c", script, str(tmp_path / "bag")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=TEST_DIRECTORY,
    )
    assert child.stdout.readline() == "written\n"
    child.kill()
    child.communicate()
    assert "not closed properly" in describe_bag(tmp_path / "bag")
    report = recover(tmp_path / "bag")
    assert not report.was_complete
    recovered = texts(report.output)
    expected = [message[1] for message in bag_samples.sample_messages(2550)]
    assert recovered == expected[: len(recovered)]
    assert 2550 - 101 <= len(recovered) < 2550
    copy = BagReader(report.output)
    assert copy.complete
    assert copy.custom_data == {"configuration": "abc", "recovered_from": "bag"}
    assert copy.topics["/topic_1"].type_hash == bag_samples.STRING_HASH
    assert copy.topics["/topic_1"].offered_qos_profiles[0]["durability"] == "transient_local"


def test_recovered_bag_opens_with_rosbags(original, tmp_path):
    from rosbags.highlevel import AnyReader

    stored, _ = original
    (tmp_path / "cut.mcap").write_bytes(stored[: len(stored) // 2])
    report = recover(tmp_path / "cut.mcap")
    with AnyReader([report.output]) as reader:
        count = sum(
            bool(reader.deserialize(raw, connection.msgtype).data)
            for connection, _, raw in reader.messages()
        )
    assert count == report.message_count > 0


@pytest.mark.parametrize("place", range(50))
def test_cut_off_anywhere(original, tmp_path, place):
    stored, messages = original
    generator = random.Random(place)
    length = generator.randrange(len(stored)) if place > 3 else place * 5
    path = tmp_path / "cut.mcap"
    path.write_bytes(stored[:length])
    recovered = examine(path)
    if recovered is None:
        assert length < 9
    else:
        assert recovered == messages[: len(recovered)]


@pytest.mark.parametrize("place", range(25))
def test_garbage_inserted_anywhere(original, tmp_path, place):
    stored, messages = original
    generator = random.Random(1000 + place)
    position = generator.randrange(len(stored))
    garbage = generator.randbytes(generator.randrange(1, 5000))
    path = tmp_path / "garbage.mcap"
    path.write_bytes(stored[:position] + garbage + stored[position:])
    recovered = examine(path)
    known = set(messages)
    assert recovered is not None
    assert all(message in known for message in recovered)
    # At most the chunk that is hit is lost: the description of the topics is in the summary.
    assert len(recovered) >= len(messages) - LARGEST_LOSS
    assert not BagReader(path).complete or recovered == messages


@pytest.mark.parametrize("place", range(25))
def test_bytes_overwritten_anywhere(original, tmp_path, place):
    stored, messages = original
    generator = random.Random(2000 + place)
    position = generator.randrange(len(stored) - 64)
    path = tmp_path / "overwritten.mcap"
    path.write_bytes(stored[:position] + generator.randbytes(64) + stored[position + 64 :])
    recovered = examine(path)
    known = set(messages)
    assert recovered is not None
    assert all(message in known for message in recovered)
    assert len(recovered) >= len(messages) - LARGEST_LOSS
    assert len(texts(path)) <= len(messages)


def test_random_bytes_are_refused(tmp_path):
    path = tmp_path / "noise.mcap"
    path.write_bytes(random.Random(5).randbytes(100_000))
    with pytest.raises(BagReadError, match="noise.mcap: not an MCAP file"):
        recover(path)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["noise.mcap"]


def test_damaged_chunk_is_noted_while_reading(original, tmp_path):
    stored, messages = original
    middle = len(stored) // 2
    path = tmp_path / "hit.mcap"
    path.write_bytes(stored[:middle] + bytes(64) + stored[middle + 64 :])
    reader = BagReader(path)
    assert reader.complete  # the summary is intact; the damage shows only on reading
    read = [message.serialized for message in reader.raw_messages()]
    assert set(read) < set(messages)
    assert not reader.complete
    assert "hit.mcap: damaged between bytes" in reader.notes[0]


def test_existing_output_is_refused(original, tmp_path):
    stored, _ = original
    path = tmp_path / "bag.mcap"
    path.write_bytes(stored)
    (tmp_path / "bag_recovered").mkdir()
    with pytest.raises(BagWriteError, match="bag_recovered: exists already"):
        recover(path)


def test_unchunked_file_is_read_and_recovered(tmp_path):
    """As `ros2 bag record --storage-preset-profile fastwrite` leaves it."""
    from mcap.writer import Writer

    messages = [message[1] for message in bag_samples.sample_messages(500)]
    path = tmp_path / "fast.mcap"
    with open(path, "wb") as file:
        writer = Writer(file, use_chunking=False)
        writer.start(profile="ros2")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data\n")
        channel = writer.register_channel("/text", "cdr", schema)
        for index, serialized in enumerate(messages):
            writer.add_message(channel, index, serialized, index)
        writer.finish()
    assert texts(path) == messages
    path.write_bytes(path.read_bytes()[:20_000])
    recovered = examine(path)
    assert 0 < len(recovered) < 500 and recovered == messages[: len(recovered)]
