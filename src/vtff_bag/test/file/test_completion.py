"""A bag whose recorder was lost, completed from the bag of a second recorder."""

import collections
import pathlib
import tempfile

import pytest
from bag_samples import sample_messages, write_bag
from hypothesis import given
from hypothesis import strategies as st

from vtff_bag.file.completion import complete_bag
from vtff_bag.file.errors import BagReadError
from vtff_bag.file.reader import BagReader
from vtff_bag.file.writer import BagWriter

TYPE = "std_msgs/msg/String"


def write(folder, messages, *, closed=True):
    """Write (topic, log time, bytes) into a bag; leave it as a killed recorder does if asked to."""
    writer = BagWriter(folder, {"made_by": folder.name}, chunk_size=2048)
    numbers = {}
    for topic, log_time, content in messages:
        if topic not in numbers:
            numbers[topic] = writer.add_topic(topic, TYPE, definition="string data")
        writer.write(numbers[topic], content, log_time)
    writer.flush()
    if closed:
        writer.close()
    else:
        writer._file.close()


def read(folder):
    reader = BagReader(folder)
    assert reader.complete
    return [(m.topic, m.log_time, m.serialized) for m in reader.raw_messages()]


@given(
    contents=st.lists(st.sampled_from([b"\0\1\0\0a", b"\0\1\0\0b", b"\0\1\0\0c"]), max_size=30),
    topics=st.integers(1, 3),
    lost_at=st.integers(0, 30),
    held=st.integers(0, 12),
)
def test_no_message_is_lost_or_twice(contents, topics, lost_at, held):
    """Publishers hold their newest messages, which overlap with what was recorded."""
    published = [
        (f"/t{number % topics}", 1 + number, content) for number, content in enumerate(contents)
    ]
    first = published[:lost_at]
    second = []
    for topic in range(topics):
        of_topic = [item for item in published if item[0] == f"/t{topic}"]
        second += of_topic[-held:] if held else []
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        write(folder / "bag", first, closed=False)
        write(folder / "bag_2", second)
        added = complete_bag(folder / "bag", folder / "bag_2")
        completed = read(folder / "bag")
        assert [path.name for path in folder.iterdir()] == ["bag"]

    def count(items):
        return collections.Counter((topic, content) for topic, _, content in items)

    assert count(completed) == count(first) | count(second)
    assert added == len(completed) - len(first)
    if all(
        len([i for i in published[lost_at:] if i[0] == f"/t{topic}"]) <= held
        for topic in range(topics)
    ):
        times = {(topic, content) for topic, _, content in published}
        assert {(topic, content) for topic, _, content in completed} == times


def test_what_was_published_and_held_is_whole(tmp_path):
    published = [("/clock", number, b"\0\1\0\0%08d" % number) for number in range(1, 101)]
    write(tmp_path / "bag", published[:60], closed=False)
    write(tmp_path / "bag_2", published[50:])
    assert complete_bag(tmp_path / "bag", tmp_path / "bag_2") == 40
    assert read(tmp_path / "bag") == published
    assert BagReader(tmp_path / "bag").custom_data["made_by"] == "bag_2"  # the texts at the end


def test_a_first_bag_without_anything_is_replaced(tmp_path):
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "bag_0.mcap").write_bytes(b"\x89MCAP")
    write_bag(tmp_path / "bag_2", sample_messages(count := 5))
    assert complete_bag(tmp_path / "bag", tmp_path / "bag_2") == count
    assert len(read(tmp_path / "bag")) == count


def test_without_a_second_bag_the_first_stays(tmp_path):
    write(tmp_path / "bag", [("/clock", 1, b"\0\1\0\0a")], closed=False)
    before = (tmp_path / "bag" / "bag_0.mcap").read_bytes()
    with pytest.raises(BagReadError, match="bag_2: no such bag"):
        complete_bag(tmp_path / "bag", tmp_path / "bag_2")
    assert (tmp_path / "bag" / "bag_0.mcap").read_bytes() == before
