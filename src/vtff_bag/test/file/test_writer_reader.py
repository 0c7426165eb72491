"""Bags written here are read by rosbags and mcap, and read back in order."""

import os
import resource
import shutil
import signal
import struct
import subprocess
import sys
import textwrap

import bag_samples
import lz4.frame
import pytest
import yaml
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from vtff_bag.file import mcap_blocks
from vtff_bag.file.errors import BagReadError, BagWriteError
from vtff_bag.file.info import describe_bag
from vtff_bag.file.metadata import parse_stored_metadata, read_metadata
from vtff_bag.file.reader import OLD_TOPICS, BagReader
from vtff_bag.file.recover import recover
from vtff_bag.file.writer import BagWriter

COUNT = 3000


@pytest.fixture(params=["zstd", "lz4", "none"])
def bag(request, tmp_path):
    messages = bag_samples.sample_messages(COUNT)
    directory = tmp_path / "run" / "bag"
    bag_samples.write_bag(directory, messages, compression=request.param, chunk_size=16 * 1024)
    return directory, messages


def test_layout_is_that_of_rosbag2(bag):
    directory, _ = bag
    assert sorted(path.name for path in directory.iterdir()) == ["bag_0.mcap", "metadata.yaml"]
    text = (directory / "metadata.yaml").read_text()
    assert "&" not in text and "*" not in text  # anchors and aliases
    content = yaml.safe_load(text)["rosbag2_bagfile_information"]
    assert content["version"] == 9
    assert content["message_count"] == COUNT
    assert content["starting_time"]["nanoseconds_since_epoch"] == bag_samples.START
    assert content["duration"]["nanoseconds"] == (COUNT // 3 - 1) * bag_samples.STEP
    assert content["relative_file_paths"] == ["bag_0.mcap"]
    assert content["custom_data"] == {"configuration": "abc"}
    assert content["ros_distro"] == "jazzy"
    profile = content["topics_with_message_count"][0]["topic_metadata"]["offered_qos_profiles"][0]
    assert profile["reliability"] == "reliable"
    assert profile["lifespan"] == {"sec": 9223372036, "nsec": 854775807}


def test_rosbags_reads_every_message(bag):
    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import QosDurability, QosReliability

    directory, messages = bag
    with AnyReader([directory]) as reader:
        for connection in reader.connections:
            assert connection.digest == bag_samples.STRING_HASH
            assert connection.msgcount == COUNT // 3
            (profile,) = connection.ext.offered_qos_profiles
            assert profile.reliability == QosReliability.RELIABLE
            assert profile.durability == QosDurability.TRANSIENT_LOCAL
        texts = [
            (time, reader.deserialize(raw, connection.msgtype).data.split()[0])
            for connection, time, raw in reader.messages()
        ]
    assert texts == [(time, str(index)) for index, (_, _, time) in enumerate(messages)]


def test_mcap_reads_every_message_and_the_records_of_rosbag2(bag):
    directory, messages = bag
    with open(directory / "bag_0.mcap", "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary.statistics.message_count == COUNT
        assert [(s.name, s.encoding) for s in summary.schemas.values()] == [
            ("std_msgs/msg/String", "ros2msg")
        ]
        for channel in summary.channels.values():
            assert channel.message_encoding == "cdr"
            assert channel.metadata["topic_type_hash"] == bag_samples.STRING_HASH
            (profile,) = yaml.safe_load(channel.metadata["offered_qos_profiles"])
            assert profile["durability"] == "transient_local"
        stored = [(message.data, message.log_time) for _, _, message in reader.iter_messages()]
        assert stored == [(serialized, time) for _, serialized, time in messages]
        (record,) = [entry for entry in reader.iter_metadata() if entry.name == "rosbag2"]
        metadata = yaml.safe_load(record.metadata["serialized_metadata"])
        assert metadata["message_count"] == COUNT


def test_own_reader_gives_messages_topics_and_times(bag):
    directory, messages = bag
    for path in (directory, directory / "bag_0.mcap"):
        reader = BagReader(path)
        assert reader.complete and reader.notes == []
        assert reader.message_count == COUNT
        assert (reader.start_time, reader.end_time) == (messages[0][2], messages[-1][2])
        assert list(reader.topics) == ["/topic_0", "/topic_1", "/topic_2"]
        raw = list(reader.raw_messages())
        assert [(m.topic, m.serialized, m.log_time) for m in raw] == [
            (f"/topic_{topic}", serialized, time) for topic, serialized, time in messages
        ]
    times = [raw.log_time for raw in reader.raw_messages(["/topic_1"])]
    assert (times[0], times[-1]) == (messages[1][2], messages[-2][2])
    assert reader.custom_data == {"configuration": "abc"}


def test_run_folder_stands_for_its_bag(bag):
    directory, _ = bag
    assert BagReader(directory.parent).path == directory
    report = recover(directory.parent)
    assert report.output == directory.parent / "bag_recovered"
    assert BagReader(directory.parent).path == directory


def test_time_window_and_topics(bag):
    directory, messages = bag
    start, end = (
        bag_samples.START + 10 * bag_samples.STEP,
        bag_samples.START + 20 * bag_samples.STEP,
    )
    selected = list(BagReader(directory).raw_messages(["/topic_2"], start, end))
    expected = [m[1] for m in messages if m[0] == 2 and start <= m[2] < end]
    assert [message.serialized for message in selected] == expected


def test_messages_out_of_order_come_by_log_time_then_file_order(tmp_path):
    messages = bag_samples.sample_messages(900)
    shuffled = [messages[i ^ 5] for i in range(896)]  # neighbours exchanged
    bag_samples.write_bag(tmp_path / "bag", shuffled, chunk_size=2048)
    read = [m.serialized for m in BagReader(tmp_path / "bag").raw_messages()]
    assert read == [m[1] for m in sorted(shuffled, key=lambda m: m[2])]


def test_deserialised_messages(bag):
    pytest.importorskip("rclpy")
    directory, messages = bag
    texts = [
        decoded.message.data.split()[0] for decoded in BagReader(directory).messages("/topic_1")
    ]
    assert texts == [str(index) for index in range(1, COUNT, 3)]


def test_same_input_gives_same_bytes(tmp_path):
    for name in ("a", "b"):
        bag_samples.write_bag(tmp_path / name / "bag", bag_samples.sample_messages(500))
    for file in ("bag_0.mcap", "metadata.yaml"):
        assert (tmp_path / "a/bag" / file).read_bytes() == (tmp_path / "b/bag" / file).read_bytes()


def test_topic_without_messages_is_kept(tmp_path):
    bag_samples.write_bag(tmp_path / "bag", [])
    reader = BagReader(tmp_path / "bag")
    assert reader.complete
    assert [topic.message_count for topic in reader.topics.values()] == [0, 0, 0]
    assert list(reader.raw_messages()) == []


def test_open_bag_is_recognisable(tmp_path):
    writer = bag_samples.write_bag(tmp_path / "bag", [], close=False)
    metadata = read_metadata(tmp_path / "bag" / "metadata.yaml")
    assert [file.path for file in metadata.files] == ["bag_0.mcap"]
    assert metadata.custom_data == {"configuration": "abc"}
    assert "not closed properly -> vtff bag recover" in describe_bag(tmp_path / "bag")
    writer.close()


def test_flush_each_second_reaches_the_file(tmp_path):
    now = [0.0]
    writer = bag_samples.write_bag(
        tmp_path / "bag", [], close=False, chunk_size=1 << 20, steady_clock=lambda: now[0]
    )

    def messages_in_file():
        found = 0
        with open(writer.path, "rb") as file:
            try:
                for record in StreamReader(file).records:
                    found += type(record).__name__ == "Message"
            except Exception:  # the end of an open file: mcap has several errors for it
                return found
        return found

    for index in range(10):
        writer.write(1, bag_samples.string_message(str(index)), bag_samples.START)
    assert messages_in_file() == 0
    now[0] = 1.0
    writer.flush_if_due()
    assert messages_in_file() == 10
    now[0] = 2.5
    writer.write(1, bag_samples.string_message("late"), bag_samples.START)
    assert messages_in_file() == 11
    writer.close()


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_a_killed_writer_leaves_all_but_its_last_second(tmp_path, compression):
    script = textwrap.dedent(
        """
        import os, signal, sys
        import bag_samples
        now = [0.0]
        messages = bag_samples.sample_messages(3250)
        writer = bag_samples.write_bag(
            sys.argv[1], [], close=False, compression=sys.argv[2], steady_clock=lambda: now[0]
        )
        for index, (topic, serialized, log_time) in enumerate(messages):
            now[0] = index / 100
            writer.write(topic + 1, serialized, log_time)
        os.kill(os.getpid(), signal.SIGKILL)
        """
    )
    killed = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "bag"), compression],
        cwd=bag_samples.__file__.rsplit("/", 1)[0],
    )
    assert killed.returncode == -signal.SIGKILL
    reader = BagReader(tmp_path / "bag")
    stored = [message.serialized for message in reader.raw_messages()]
    assert 3250 - 100 <= len(stored) <= 3250 and not reader.complete
    assert stored == [m[1] for m in bag_samples.sample_messages(len(stored))]
    assert [content.damaged_bytes for content in reader.contents] == [0]


def test_existing_bag_is_never_overwritten(bag):
    directory, _ = bag
    before = (directory / "bag_0.mcap").read_bytes()
    with pytest.raises(BagWriteError, match="holds a bag already"):
        BagWriter(directory)
    assert (directory / "bag_0.mcap").read_bytes() == before


def test_writer_errors_name_what_is_wrong(tmp_path):
    with pytest.raises(BagWriteError, match="bzip2.*zstd, lz4, none"):
        BagWriter(tmp_path / "bag", compression="bzip2")
    (tmp_path / "file").write_text("")
    with pytest.raises(BagWriteError, match="file"):
        BagWriter(tmp_path / "file" / "bag")
    writer = bag_samples.write_bag(tmp_path / "bag", [])
    with pytest.raises(BagWriteError, match="bag_0.mcap: the bag is closed"):
        writer.write(1, b"", 0)


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda path: None, "no such bag"),
        (lambda path: path.mkdir(), "not a bag"),
        (lambda path: path.write_bytes(b""), "empty"),
        (lambda path: path.write_bytes(b"no bag" * 50), "not an MCAP file"),
    ],
)
def test_reader_errors_name_the_file(tmp_path, make, named):
    path = tmp_path / "suspect"
    make(path)
    with pytest.raises(BagReadError, match=f"suspect.*{named}"):
        BagReader(path)


@pytest.mark.parametrize(
    ("opcode", "place", "value"),
    [
        pytest.param(0x08, 16, 1 << 63, id="chunk that begins nowhere"),
        pytest.param(0x08, 24, 3, id="chunk shorter than its head"),
        pytest.param(0x0D, 0, 1 << 63, id="metadata that begin nowhere"),
        pytest.param(0x0D, 8, 1 << 62, id="metadata larger than any memory"),
    ],
)
def test_an_index_that_names_no_place_of_the_file_is_not_believed(tmp_path, opcode, place, value):
    """Found by the fuzzer: the checksum of the summary holds, or is switched off, as here."""
    messages = bag_samples.sample_messages(30)
    bag_samples.write_bag(tmp_path / "bag", messages)
    file = tmp_path / "bag/bag_0.mcap"
    content = bytearray(file.read_bytes())
    footer = len(content) - 8 - 20
    (position,) = struct.unpack_from("<Q", content, footer)
    patched = 0
    while position < footer - 9:
        found, length = struct.unpack_from("<BQ", content, position)
        if found == opcode:
            struct.pack_into("<Q", content, position + 9 + place, value)
            patched += 1
        position += 9 + length
    struct.pack_into("<I", content, footer + 16, 0)
    file.write_bytes(content)
    assert patched
    assert len(list(BagReader(tmp_path / "bag").raw_messages())) == len(messages)


@pytest.mark.parametrize("make", [os.mkfifo, lambda path: path.symlink_to("/dev/zero")])
def test_what_never_ends_is_no_bag(tmp_path, make):
    make(tmp_path / "endless")
    with pytest.raises(BagReadError, match="endless: neither a folder nor a regular file"):
        BagReader(tmp_path / "endless")


def test_a_name_that_no_file_can_have_is_no_bag(tmp_path):
    with pytest.raises(BagReadError, match="too long"):
        BagReader(tmp_path / ("x" * 300))


def test_other_storage_is_refused(bag):
    directory, _ = bag
    path = directory / "metadata.yaml"
    path.write_text(
        path.read_text().replace("storage_identifier: mcap", "storage_identifier: sqlite3")
    )
    with pytest.raises(BagReadError, match="metadata.yaml: storage 'sqlite3'"):
        BagReader(directory)


def test_unknown_topic_is_named(bag):
    with pytest.raises(BagReadError, match="'/absent'.*/topic_0"):
        next(BagReader(bag[0]).raw_messages(["/absent"]))


def test_damaged_or_missing_metadata_does_not_hide_the_messages(bag):
    directory, _ = bag
    (directory / "metadata.yaml").write_text("rosbag2_bagfile_information: [")
    reader = BagReader(directory)
    assert reader.message_count == COUNT and "metadata.yaml" in reader.notes[0]
    (directory / "metadata.yaml").unlink()
    reader = BagReader(directory)
    assert reader.message_count == COUNT and "missing" in reader.notes[0]


def test_full_disk_names_the_path_and_leaves_a_readable_bag(tmp_path):
    script = textwrap.dedent(
        """
        import resource, sys
        import bag_samples
        from vtff_bag.file.errors import BagWriteError
        messages = bag_samples.sample_messages(60000)
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
        try:
            bag_samples.write_bag(sys.argv[1], messages, compression="none", chunk_size=30_000)
        except BagWriteError as error:
            print(error)
        """
    )
    outcome = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "bag")],
        capture_output=True,
        text=True,
        cwd=bag_samples.__file__.rsplit("/", 1)[0],
        check=True,
    )
    assert "bag_0.mcap: cannot write: File too large" in outcome.stdout
    reader = BagReader(tmp_path / "bag")
    stored = [message.serialized for message in reader.raw_messages()]
    assert len(stored) > 500
    assert stored == [m[1] for m in bag_samples.sample_messages(len(stored))]
    assert [content.damaged_bytes for content in reader.contents] == [0]
    assert recover(tmp_path / "bag").message_count == len(stored)


def test_info_has_the_rows_of_ros2_bag_info(bag):
    text = describe_bag(bag[0])
    assert "Files:             bag_0.mcap\n" in text
    assert "Duration:          999.000000000s\n" in text
    assert "Start:             Mar 21 2016 00:59:43.000000000 UTC (1458521983.000000000)\n" in text
    assert f"Messages:          {COUNT}\n" in text
    assert (
        "Topic information: Topic: /topic_0 | Type: std_msgs/msg/String | Count: 1000 | "
        "Serialization Format: cdr\n" in text
    )
    assert "State:             complete" in text


@pytest.mark.parametrize(
    "text",
    [
        b"a: " + b"[" * 5000,
        b"\xff\xfe\x00",
        b"rosbag2_bagfile_information: {x: 2016-13-45}",
        b"rosbag2_bagfile_information: {x: !!int ''}",
        b"rosbag2_bagfile_information: {x: !!timestamp no}",
        b"a: &a [1, 1]\nb: &b [*a, *a]\nrosbag2_bagfile_information: &c [*b, *c]\n",
        b"rosbag2_bagfile_information: {topics_with_message_count: [[]]}",
    ],
)
def test_metadata_that_cannot_be_read_are_one_line(tmp_path, text):
    bag_samples.write_bag(tmp_path / "bag", bag_samples.sample_messages(30))
    (tmp_path / "bag/metadata.yaml").write_bytes(text)
    reader = BagReader(tmp_path / "bag")
    assert reader.message_count == 30
    assert len(reader.notes) == 1 and "metadata.yaml: not " in reader.notes[0]
    assert "\n" not in reader.notes[0]
    assert parse_stored_metadata(text.decode("utf-8", "replace")) is None
    (tmp_path / "bag/bag_0.mcap").unlink()
    with pytest.raises(BagReadError, match=r"metadata\.yaml: not "):
        BagReader(tmp_path / "bag")


def test_a_chunk_that_expands_beyond_its_stated_size_is_damage():
    """A few kilobytes of lz4 may stand for gigabytes: no more than is stated is taken in."""
    packed = lz4.frame.compress(bytes(200_000_000))
    fields = struct.pack("<QQQI", 0, 1, 1000, 0) + struct.pack("<I", 3) + b"lz4"
    fields += struct.pack("<Q", len(packed)) + packed
    chunk = struct.pack("<BQ", 6, len(fields)) + fields
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ValueError, match="a chunk is cut off"):
        mcap_blocks._read_chunk(chunk)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000  # kB


FILL_DISK = textwrap.dedent(
    """
    import os, pathlib, sys
    from vtff_bag.file.errors import BagWriteError
    from vtff_bag.file.reader import OLD_TOPICS, BagReader
    from vtff_bag.file.writer import BagWriter

    bag = pathlib.Path(sys.argv[1]) / "bag"
    try:
        writer = BagWriter(bag, compression="none")
    except BagWriteError as error:
        sys.exit(f"{error}; left: {os.listdir(bag)}")
    topic = writer.add_topic("/noise", "std_msgs/msg/String")
    written = after = 0
    while after < 500:  # a megabyte after the alarm
        writer.write(topic, os.urandom(2000), 10**18 + written)
        written += 1
        after += bool(writer.disk_alarm)
    writer.close()
    reader = BagReader(bag)
    names = ",".join(sorted(os.listdir(bag)))
    print(writer.disk_alarm, reader.complete, reader.message_count == written, names, sep="|")
    """
)


def run_on_small_disk(folder, megabytes):
    """Run `FILL_DISK` with a file system of a few MB that only its process sees."""
    mount = f"mount -t tmpfs -o size={megabytes}m tmpfs {folder}"
    probe = ["unshare", "-rm", "sh", "-c", mount]
    if shutil.which("unshare") is None or subprocess.run(probe, capture_output=True).returncode:
        pytest.skip("this machine does not allow a file system of its own to a process")
    command = f'{mount} && exec "{sys.executable}" -c "$0" {folder}'
    return subprocess.run(
        ["unshare", "-rm", "sh", "-c", command, FILL_DISK], capture_output=True, text=True
    )


def test_on_a_full_disk_the_reserve_takes_what_still_comes_and_the_bag_is_closed(tmp_path):
    ended = run_on_small_disk(tmp_path, 10)
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.strip().split("|") == [
        f"{tmp_path}/bag/bag_0.mcap: cannot write: No space left on device",
        "True",
        "True",
        "bag_0.mcap,metadata.yaml",
    ]


def test_a_disk_without_room_for_the_reserve_is_refused(tmp_path):
    ended = run_on_small_disk(tmp_path, 4)
    assert ended.returncode == 1
    assert ended.stderr.splitlines() == [
        f"{tmp_path}/bag/bag_0.mcap: cannot create: No space left on device; left: []"
    ]


def test_a_bag_with_old_topics_is_refused_in_one_line(tmp_path, monkeypatch):
    bag_samples.write_bag(tmp_path / "new", [])
    old = next(iter(BagReader(tmp_path / "new").topics))
    monkeypatch.setattr("vtff_bag.file.reader.OLD_TOPICS", {old})
    with pytest.raises(BagReadError, match=f"{old}.*record the run anew") as refusal:
        BagReader(tmp_path / "new")
    assert "\n" not in str(refusal.value)


def test_topics_of_a_formation_of_two_are_old():
    assert "/formation/relative_state_truth" in OLD_TOPICS
    assert "/formation/safety" not in OLD_TOPICS
