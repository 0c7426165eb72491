"""The file writer gives the bytes of the writer of the mcap package."""

import io

import mcap.writer
import numpy as np
import pytest

from vtff_bag.file.mcap_writer import McapWriter

COMPRESSIONS = {
    "zstd": mcap.writer.CompressionType.ZSTD,
    "lz4": mcap.writer.CompressionType.LZ4,
    "none": mcap.writer.CompressionType.NONE,
}


class File(io.BytesIO):
    def flush(self):
        pass


def make_writers(compression, chunk_size):
    ours, theirs = File(), File()
    theirs_writer = mcap.writer.Writer(theirs, chunk_size, COMPRESSIONS[compression])
    return (ours, McapWriter(ours, chunk_size, compression)), (theirs, theirs_writer)


@pytest.mark.parametrize("compression", sorted(COMPRESSIONS))
@pytest.mark.parametrize("seed", range(4))
def test_bytes_are_those_of_the_mcap_package(compression, seed):
    generator = np.random.default_rng(seed)
    (ours, our_writer), (theirs, their_writer) = make_writers(compression, 3000)
    for writer in (our_writer, their_writer):
        writer.start(profile="ros2", library="test")
    channels = 0
    for _ in range(400):
        action = generator.random()
        content = generator.bytes(int(generator.integers(0, 700)))
        times = [int(time) for time in generator.integers(0, 1 << 62, 2)]
        channel = int(generator.integers(1, channels + 1)) if channels else 0
        for writer in (our_writer, their_writer):
            if action < 0.03 or not channels:
                schema = writer.register_schema(f"schema {channels}", "ros2msg", content)
                writer.register_channel(f"/topic_{channels}", "cdr", schema, {"key": "value"})
            elif action < 0.06 and writer is our_writer:
                writer.finish_chunk()
            elif action < 0.06:
                writer.flush()
            elif action < 0.08:
                writer.add_metadata("metadata", {"text": "some", "other": str(times)})
            else:
                writer.add_message(channel, times[0], content, times[1])
        channels += action < 0.03 or not channels
    for writer in (our_writer, their_writer):
        writer.finish()
    assert ours.getvalue() == theirs.getvalue()


def test_a_file_without_messages_is_that_of_the_mcap_package():
    (ours, our_writer), (theirs, their_writer) = make_writers("zstd", 10)
    for writer in (our_writer, their_writer):
        writer.start(profile="ros2", library="test")
        writer.register_channel("/topic", "cdr", writer.register_schema("a", "b", bytes(100)), {})
        writer.finish()
    assert ours.getvalue() == theirs.getvalue()
    assert our_writer.times() == (0, 0) and our_writer.count_messages() == {}


def test_counts_and_times_are_those_of_all_messages_so_far():
    writer = McapWriter(File(), 1000, "none")
    writer.start(profile="", library="")
    for name in ("/first", "/second"):
        writer.register_channel(name, "cdr", writer.register_schema(name, "", b""), {})
    for time in (50, 40, 60, 55):
        writer.add_message(2, time, bytes(400), time)
    assert (writer.times(), writer.count_messages()) == ((40, 60), {2: 4})
    writer.add_message(1, 10, b"", 10)
    assert (writer.times(), writer.count_messages()) == ((10, 60), {2: 4, 1: 1})
    with pytest.raises(KeyError):
        writer.add_message(3, 10, b"", 10)
    assert writer.count_messages() == {2: 4, 1: 1}
