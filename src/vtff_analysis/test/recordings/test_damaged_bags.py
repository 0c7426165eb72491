"""Every command on bags that are cut, hit, mixed up or foreign: it works or says why not."""

import pathlib
import random
import shutil

import bag_samples
import numpy as np
import pytest

from vtff_bag.file.errors import BagError
from vtff_bag.file.info import describe_bag
from vtff_bag.file.reader import BagReader
from vtff_bag.file.recover import recover
from vtff_bag.file.writer import BagWriter
from vtff_bag.player.messages_in_order import Replay, select_topics

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("vtff_msgs", reason="needs the workspace")

from geometry_msgs.msg import AccelStamped  # noqa: E402
from rclpy.serialization import serialize_message  # noqa: E402

from vtff_analysis.evaluation.formation_flight import formation_flight  # noqa: E402
from vtff_analysis.evaluation.summary import summarise_run  # noqa: E402
from vtff_analysis.recordings.recording import read_run  # noqa: E402
from vtff_analysis.recordings.settings import RunSettings  # noqa: E402
from vtff_msgs.msg import GnssObservations, RelativeState  # noqa: E402
from vtff_node.stamps import to_stamp  # noqa: E402

PLACES = 200
STEPS = 60


def write_run(directory, seed=1, steps=STEPS):
    """A short flight with truth, thrust and observations."""
    generator = np.random.default_rng(seed)
    with BagWriter(directory, {"run": str(seed)}, 2048, steady_clock=lambda: 0.0) as writer:
        relative = writer.add_topic("/deputy/relative_state_truth", "vtff_msgs/msg/RelativeState")
        thrust = writer.add_topic(
            "/deputy/propulsion/thrust_applied", "geometry_msgs/msg/AccelStamped"
        )
        epochs = writer.add_topic("/chief/gnss/epoch", "vtff_msgs/msg/GnssObservations")
        for step in range(steps):
            time = bag_samples.START + step * bag_samples.STEP
            state = RelativeState(child_frame_id="deputy")
            state.position = generator.normal(size=3)
            epoch = GnssObservations(system=[0, 1], prn=[3, 4], band=[1, 1], attribute=[67, 67])
            epoch.cn0_dbhz, epoch.flags = [45.0, 40.0], [7, 7]
            for number, message in ((relative, state), (thrust, AccelStamped()), (epochs, epoch)):
                message.header.stamp = to_stamp(time)
                writer.write(number, serialize_message(message), time)
    return directory


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    directory = write_run(tmp_path_factory.mktemp("run") / "bag")
    messages = {message.serialized for message in BagReader(directory).raw_messages()}
    return (directory / "bag_0.mcap").read_bytes(), messages


def summarise(path):
    """Read a bag as a report does."""
    history = read_run(path)
    found = {name: formation_flight(deputy) for name, deputy in history.deputies.items()}
    flights = {name: flight for name, flight in found.items() if flight is not None}
    return summarise_run(history, RunSettings(), flights)


def replayed(path):
    """Messages that a replay of the bag publishes."""
    reader = BagReader(path)
    published = []
    replay = Replay(reader, select_topics(reader).topics, published.append, rate=1e6)
    while not replay.finished:
        replay.advance()
    return published


def examine(path, messages):
    """Use a bag in every way; what comes out must have been written."""
    for use in (describe_bag, summarise, replayed, recover):
        try:
            found = use(path)
        except BagError as error:
            assert str(path.name) in str(error)
            continue
        if use is replayed:
            assert {message.serialized for message in found} <= messages
    shutil.rmtree(path.with_name(f"{path.stem}_recovered"), ignore_errors=True)


@pytest.mark.parametrize("part", range(4))
def test_cut_off_at_200_places(run, tmp_path, part):
    stored, messages = run
    generator = random.Random(part)
    path = tmp_path / "cut.mcap"
    for _ in range(PLACES // 4):
        path.write_bytes(stored[: generator.randrange(len(stored))])
        examine(path, messages)


@pytest.mark.parametrize("part", range(4))
def test_garbage_at_200_places(run, tmp_path, part):
    stored, messages = run
    generator = random.Random(100 + part)
    path = tmp_path / "garbage.mcap"
    for _ in range(PLACES // 4):
        position = generator.randrange(len(stored))
        kept = position + generator.choice([0, 64])  # inserted, or written over what was there
        garbage = generator.randbytes(generator.randrange(1, 3000))
        path.write_bytes(stored[:position] + garbage + stored[kept:])
        examine(path, messages)


@pytest.mark.parametrize("part", range(2))
def test_damaged_metadata(tmp_path, part):
    directory = write_run(tmp_path / "bag")
    messages = {message.serialized for message in BagReader(directory).raw_messages()}
    path = directory / "metadata.yaml"
    text = path.read_bytes()
    generator = random.Random(200 + part)
    for _ in range(25):
        position = generator.randrange(len(text))
        path.write_bytes(text[:position] + generator.randbytes(generator.randrange(20)))
        examine(directory, messages)
        assert len(replayed(directory)) == 3 * STEPS


def test_missing_metadata_are_taken_from_the_file(tmp_path):
    directory = write_run(tmp_path / "bag")
    (directory / "metadata.yaml").unlink()
    reader = BagReader(directory)
    assert reader.notes == ["metadata.yaml is missing"]
    assert reader.custom_data == {"run": "1"}
    assert "recover" in describe_bag(directory)
    assert recover(directory).message_count == 3 * STEPS


@pytest.mark.parametrize("steps", [STEPS - 1, STEPS])
def test_metadata_of_another_run_are_noticed(tmp_path, steps):
    directory = write_run(tmp_path / "a" / "bag")
    other = write_run(tmp_path / "b" / "bag", seed=2, steps=steps)
    if steps == STEPS:  # as many messages, but of another topic
        bag_samples.write_bag(tmp_path / "c" / "bag", bag_samples.sample_messages(3 * STEPS))
        other = tmp_path / "c" / "bag"
    shutil.copy(other / "metadata.yaml", directory / "metadata.yaml")
    reader = BagReader(directory)
    assert "metadata.yaml is of another bag" in reader.notes[0]
    assert reader.custom_data == {"run": "1"}
    assert reader.message_count == 3 * STEPS
    assert "metadata.yaml is of another bag" in describe_bag(directory)


@pytest.fixture
def foreign_bag(tmp_path):
    """A rosbag2 MCAP as rosbags writes it: one known type, one of an unknown package."""
    rosbags = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    typestore = get_typestore(Stores.ROS2_JAZZY)
    typestore.register(get_types_from_msg("float64 range\nstring unit\n", "radar_msgs/msg/Scan"))
    path = tmp_path / "foreign"
    text_type, scan_type = "std_msgs/msg/String", "radar_msgs/msg/Scan"
    storage = rosbags.StoragePlugin.MCAP
    with rosbags.Writer(path, version=9, storage_plugin=storage) as writer:
        text = writer.add_connection("/chatter", text_type, typestore=typestore)
        scan = writer.add_connection("/radar", scan_type, typestore=typestore)
        for number in range(10):
            time = bag_samples.START + number
            message = typestore.types[text_type](data=f"hello {number}")
            writer.write(text, time, typestore.serialize_cdr(message, text_type))
            message = typestore.types[scan_type](range=float(number), unit="m")
            writer.write(scan, time, typestore.serialize_cdr(message, scan_type))
    return pathlib.Path(path)


def test_bag_of_another_program_is_listed_and_replayed_as_far_as_known(foreign_bag):
    described = describe_bag(foreign_bag)
    assert "Topic: /radar | Type: radar_msgs/msg/Scan | Count: 10" in described
    assert "Topic: /chatter | Type: std_msgs/msg/String | Count: 10" in described
    reader = BagReader(foreign_bag)
    assert reader.complete, reader.notes
    selection = select_topics(reader)
    assert list(selection.topics) == ["/chatter"]
    (line,) = selection.skipped
    assert line.startswith("/radar is skipped (10 messages)") and "radar_msgs/msg/Scan" in line
    texts = [message.message.data for message in reader.messages("/chatter")]
    assert texts == [f"hello {number}" for number in range(10)]
    assert len(replayed(foreign_bag)) == 10
    assert summarise(foreign_bag)["message_count"] == 20
    assert recover(foreign_bag).message_count == 20
