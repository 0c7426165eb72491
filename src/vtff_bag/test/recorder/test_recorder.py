"""Rules of the recorder without ROS, then the node against real publishers."""

import contextlib
import os
import re
import signal
import struct
import subprocess
import sys
import textwrap
import time
import types

import bag_samples
import pytest

from vtff_bag.file.errors import BagWriteError
from vtff_bag.file.reader import BagReader
from vtff_bag.file.recover import recover
from vtff_bag.file.stamps import leading_stamp
from vtff_bag.file.writer import BagWriter
from vtff_bag.recorder.offered_qos import strongest_common
from vtff_bag.recorder.recorder import GATHER_LIMIT, Recorder
from vtff_bag.recorder.recording_rules import Acknowledger, GatherPace, ScenarioTime, TopicSelection

SECOND = 10**9


def test_leading_stamp_in_both_byte_orders():
    assert leading_stamp(b"\x00\x01\x00\x00" + struct.pack("<iI", 5, 7)) == 5 * SECOND + 7
    assert leading_stamp(b"\x00\x00\x00\x00" + struct.pack(">iI", 5, 7)) == 5 * SECOND + 7


def test_leading_stamp_of_negative_or_short_message_is_unset():
    assert leading_stamp(b"\x00\x01\x00\x00" + struct.pack("<iI", -5, 7)) == 0
    assert leading_stamp(b"\x00\x01\x00\x00\x01") == 0


def test_clock_outranks_stamps():
    scenario = ScenarioTime()
    scenario.take_stamp(3)
    scenario.take_stamp(2)
    assert scenario.nanoseconds == 3
    scenario.take_clock(1)
    scenario.take_stamp(9)
    assert scenario.nanoseconds == 1


@pytest.mark.parametrize(
    ("topic", "settings", "wanted"),
    [
        ("/chief/gnss/epoch", {}, True),
        ("/rosout", {}, True),
        ("/diagnostics", {}, True),
        ("/parameter_events", {}, False),
        ("/node/_hidden", {}, False),
        ("/_hidden/topic", {}, False),
        ("/_hidden/topic", {"include_hidden": True}, True),
        ("/chief/gnss/raw", {"exclude": ("/chief/gnss/raw",)}, False),
        ("/chief/gnss/epoch", {"include": "^/chief/"}, True),
        ("/deputy/gnss/epoch", {"include": "^/chief/"}, False),
    ],
)
def test_topic_selection(topic, settings, wanted):
    assert TopicSelection(**settings).wants(topic) is wanted


def test_bad_regular_expression_is_named():
    with pytest.raises(ValueError, match=r"include '\('"):
        TopicSelection(include="(")


class TestAcknowledger:
    def setup_method(self):
        self.sent = []
        self.acknowledger = Acknowledger(self.sent.append, acknowledge_every=10)

    def test_first_step_waits_for_a_stable_topic_set(self):
        self.acknowledger.take_clock(100)
        assert self.sent == []
        self.acknowledger.allow_first()
        assert self.sent == [100]

    def test_first_step_is_acknowledged_at_once_when_topics_are_stable_before(self):
        self.acknowledger.allow_first()
        assert self.sent == []
        self.acknowledger.take_clock(100)
        assert self.sent == [100]

    def test_every_tenth_step_by_its_own_stamp(self):
        self.acknowledger.allow_first()
        for step in range(35):
            self.acknowledger.take_clock(step)
        assert self.sent == [0, 10, 20, 30]

    def test_nothing_after_the_stop(self):
        self.acknowledger.allow_first()
        self.acknowledger.stopped = True
        self.acknowledger.take_clock(0)
        assert self.sent == []


def test_messages_gather_for_some_steps_within_limits():
    pace = GatherPace(0.1)
    pace.choose(100.0, 0)
    assert pace.choose(100.1, 20) == pytest.approx(0.05)  # 10 steps of 5 ms
    assert pace.choose(100.2, 21) == 0.1
    assert pace.choose(100.3, 21) == 0.1  # the run stands
    assert pace.choose(100.31, 1021) == 0.005


def profile(reliability, durability):
    return types.SimpleNamespace(
        reliability=types.SimpleNamespace(name=reliability),
        durability=types.SimpleNamespace(name=durability),
    )


def test_subscription_asks_for_what_every_publisher_offers():
    strong = profile("RELIABLE", "TRANSIENT_LOCAL")
    weak = profile("BEST_EFFORT", "VOLATILE")
    assert strongest_common([strong, strong]) == (True, True)
    assert strongest_common([strong, weak]) == (False, False)
    assert strongest_common([strong, profile("RELIABLE", "VOLATILE")]) == (True, False)


class FakeSubscription(contextlib.nullcontext):
    """A subscription, and its own handle, of which the test fills the queue."""

    msg_type, raw = None, True

    def __init__(self, callback):
        super().__init__()
        self.callback = callback
        self.waiting = []
        self.handle = self

    def take_message(self, message_type, raw):
        return (self.waiting.pop(0), {}) if self.waiting else None


class FakeNode:
    """The graph and the subscriptions of a node, without DDS."""

    def __init__(self, topics):
        self.topics = dict(topics)
        self.nodes = {}
        self.best_effort = set()  # topics whose publishers repeat nothing that was lost
        self.callbacks = {}
        self.subscriptions = {}
        self.warnings = []

    def get_topic_names_and_types(self):
        return [(name, [kind]) for name, kind in self.topics.items()]

    def count_publishers(self, name):
        return 1

    def get_publishers_info_by_topic(self, name):
        from rclpy.duration import Infinite
        from rclpy.qos import QoSProfile, ReliabilityPolicy

        offer = QoSProfile(depth=10)
        if name in self.best_effort:
            offer.reliability = ReliabilityPolicy.BEST_EFFORT
        for part in ("deadline", "lifespan", "liveliness_lease_duration"):
            setattr(offer, part, Infinite)
        return [
            types.SimpleNamespace(
                qos_profile=offer,
                topic_type_hash=bag_samples.STRING_HASH,
                node_name=self.nodes.get(name, "source"),
                node_namespace="/",
            )
        ]

    def create_subscription(self, message_type, topic, callback, profile, raw):
        assert raw and profile.depth == 5000
        self.callbacks[topic] = callback
        self.subscriptions[topic] = FakeSubscription(callback)
        return self.subscriptions[topic]

    def destroy_subscription(self, subscription):
        subscription.waiting.clear()

    def get_fully_qualified_name(self):
        return "/bag_recorder"

    def get_logger(self):
        return types.SimpleNamespace(warning=self.warnings.append)


def stamped(seconds):
    return b"\x00\x01\x00\x00" + struct.pack("<iI", seconds, 0) + struct.pack("<I", 1) + b"\0"


TOPICS = {
    "/clock": "rosgraph_msgs/msg/Clock",
    "/stamped": "std_msgs/msg/Header",
    "/state": "geometry_msgs/msg/AccelStamped",
    "/text": "std_msgs/msg/String",
}


@pytest.fixture
def recording(tmp_path):
    pytest.importorskip("rclpy")
    node = FakeNode(TOPICS)
    writer = BagWriter(tmp_path / "bag")
    failures = []
    recorder = Recorder(node, writer, TopicSelection(), on_failure=failures.append)
    recorder.tick()
    return types.SimpleNamespace(
        node=node, writer=writer, recorder=recorder, failures=failures, path=tmp_path / "bag"
    )


def close_and_read(recording):
    recording.recorder.finish()
    recording.writer.close()
    return [(m.topic, m.log_time // SECOND) for m in BagReader(recording.path).raw_messages()]


def test_log_time_is_stamp_or_clock_or_latest_scenario_time(recording):
    callbacks = recording.node.callbacks
    callbacks["/text"](bag_samples.string_message("before any time"))
    callbacks["/clock"](stamped(100))
    callbacks["/text"](bag_samples.string_message("at 100"))
    callbacks["/state"](stamped(101))
    callbacks["/text"](bag_samples.string_message("still 100: /clock counts"))
    callbacks["/state"](stamped(0))
    callbacks["/clock"](stamped(102))
    assert close_and_read(recording) == [
        ("/text", 100),
        ("/clock", 100),
        ("/text", 100),
        ("/text", 100),
        ("/state", 100),
        ("/state", 101),
        ("/clock", 102),
    ]


def test_without_clock_the_newest_stamp_is_the_time(recording):
    callbacks = recording.node.callbacks
    callbacks["/state"](stamped(7))
    callbacks["/state"](stamped(5))
    callbacks["/text"](bag_samples.string_message("x"))
    assert close_and_read(recording) == [("/state", 5), ("/state", 7), ("/text", 7)]


def test_a_clock_cut_short_is_recorded_and_is_no_step(tmp_path):
    pytest.importorskip("rclpy")
    acknowledged = []
    node, writer = FakeNode(TOPICS), BagWriter(tmp_path / "bag")
    acknowledger = Acknowledger(acknowledged.append, 1)
    recorder = Recorder(node, writer, TopicSelection(), acknowledger)
    recorder.tick()
    acknowledger.allow_first()
    for serialized in (stamped(100)[:8], stamped(100), stamped(101)[:4], stamped(101)):
        node.callbacks["/clock"](serialized)
    assert acknowledged == [100 * SECOND, 101 * SECOND]
    recorder.finish()
    writer.close()
    items = [(len(m.serialized), m.log_time) for m in BagReader(tmp_path / "bag").raw_messages()]
    assert items == [
        (8, 100 * SECOND),
        (len(stamped(0)), 100 * SECOND),
        (4, 100 * SECOND),
        (len(stamped(0)), 101 * SECOND),
    ]


def test_a_damaged_statement_is_recorded_and_states_nothing(tmp_path):
    pytest.importorskip("rclpy")
    node = FakeNode({**TOPICS, "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray"})
    with BagWriter(tmp_path / "bag") as writer:
        recorder = Recorder(node, writer, TopicSelection(), expected_nodes=["/deputy/relative_ekf"])
        recorder.tick()
        node.callbacks["/diagnostics"](statement("/deputy/relative_ekf", {})[:30])
        assert recorder.received == 1 and not recorder.stable
        recorder.finish()
    assert node.warnings == [
        "a sample of /diagnostics states nothing: 30 bytes that are no DiagnosticArray"
    ]


def test_messages_that_never_get_a_time_are_kept(recording):
    recording.node.callbacks["/text"](bag_samples.string_message("x"))
    assert [topic for topic, _ in close_and_read(recording)] == ["/text"]


@pytest.mark.parametrize("clock_first", [True, False])
def test_in_lockstep_messages_without_a_time_stay_before_those_of_their_topic(
    tmp_path, clock_first
):
    """Whatever comes first on other topics: a thrust is stamped a second ahead."""
    pytest.importorskip("rclpy")
    node = FakeNode({**TOPICS, "/thrust": "geometry_msgs/msg/AccelStamped"})
    writer = BagWriter(tmp_path / "bag")
    acknowledger = Acknowledger(lambda stamp: None, 1)
    recorder = Recorder(node, writer, TopicSelection(), acknowledger)
    recorder.tick()
    node.callbacks["/state"](stamped(0))
    node.callbacks["/thrust"](stamped(101))
    if clock_first:
        node.callbacks["/clock"](stamped(100))
    node.callbacks["/state"](stamped(100))
    recorder.finish()
    writer.close()
    items = BagReader(tmp_path / "bag").raw_messages()
    on_topic = [(m.log_time // SECOND, m.serialized) for m in items if m.topic == "/state"]
    assert on_topic == [(100, stamped(0)), (100, stamped(100))]


def test_in_lockstep_messages_with_a_header_gather_until_they_are_acknowledged(
    tmp_path, monkeypatch
):
    pytest.importorskip("rclpy")
    now = [10.0]
    monkeypatch.setattr("vtff_bag.recorder.recorder.time.monotonic", lambda: now[0])
    node = FakeNode({**TOPICS, "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray"})
    writer = BagWriter(tmp_path / "bag")
    acknowledged = []

    def acknowledge(stamp):
        recorder.flush()
        acknowledged.append((stamp // SECOND, writer.message_count))

    acknowledger = Acknowledger(acknowledge, 2)
    recorder = Recorder(node, writer, TopicSelection(), acknowledger)
    recorder.tick()
    # The type std_msgs/Header begins with its stamp and has no header.
    assert recorder.gathered_subscriptions == [node.subscriptions["/state"]]
    acknowledger.allow_first()
    state = node.subscriptions["/state"]
    node.callbacks["/clock"](stamped(100))
    state.waiting += [stamped(100), stamped(0)]
    now[0] += 0.05
    recorder.tick()
    node.callbacks["/clock"](stamped(101))
    assert recorder.received == 2
    node.callbacks["/clock"](stamped(102))
    assert acknowledged == [(100, 1), (102, 5)]
    state.waiting.append(stamped(102))
    now[0] += 0.2
    recorder.tick()
    assert recorder.received == 6 and state.waiting == []
    recorder.finish()
    writer.close()
    items = [(m.topic, m.log_time // SECOND) for m in BagReader(tmp_path / "bag").raw_messages()]
    assert items == [
        ("/clock", 100),
        ("/state", 100),
        ("/clock", 101),
        ("/clock", 102),
        ("/state", 102),
        ("/state", 102),
    ]


def test_once_stable_each_tick_takes_what_has_gathered(tmp_path, monkeypatch):
    """Ticks come one limit apart, and time passes within them."""
    pytest.importorskip("rclpy")
    now = [10.0]

    def monotonic():
        now[0] += 1e-4
        return now[0]

    monkeypatch.setattr("vtff_bag.recorder.recorder.time.monotonic", monotonic)
    node = FakeNode(TOPICS)
    acknowledger = Acknowledger(lambda stamp: recorder.flush(), 1)
    recorder = Recorder(node, BagWriter(tmp_path / "bag"), TopicSelection(), acknowledger)
    recorder.tick()
    now[0] += 0.5
    recorder.tick()
    assert recorder.stable
    for number in range(1, 6):
        node.subscriptions["/state"].waiting.append(stamped(100))
        now[0] = 11.0 + GATHER_LIMIT * number
        recorder.tick()
        assert recorder.received == number
    # An acknowledgement between two ticks delays none.
    now[0] += 0.5 * GATHER_LIMIT
    node.callbacks["/clock"](stamped(100))
    node.subscriptions["/state"].waiting.append(stamped(100))
    now[0] += 0.5 * GATHER_LIMIT
    recorder.tick()
    assert recorder.received == 7


@pytest.mark.parametrize("is_lockstep", [True, False])
def test_what_waits_is_taken_before_a_topic_is_subscribed_again(tmp_path, is_lockstep):
    pytest.importorskip("rclpy")
    node = FakeNode(TOPICS)
    writer = BagWriter(tmp_path / "bag")
    acknowledger = Acknowledger(lambda stamp: None, 1) if is_lockstep else None
    recorder = Recorder(node, writer, TopicSelection(), acknowledger)
    recorder.tick()
    first = node.subscriptions["/state"]
    assert first in recorder.gathered_subscriptions or not is_lockstep
    first.waiting += [stamped(100), stamped(101)]
    node.best_effort.add("/state")
    recorder._next_search = 0.0
    recorder.tick()
    assert node.subscriptions["/state"] is not first
    assert "best effort" in node.warnings[-1]
    node.callbacks["/state"](stamped(102))
    recorder.finish()
    writer.close()
    items = [(m.topic, m.log_time // SECOND) for m in BagReader(tmp_path / "bag").raw_messages()]
    assert items == [("/state", 100), ("/state", 101), ("/state", 102)]


def test_outside_lockstep_nothing_gathers(recording):
    assert recording.recorder.gathered_subscriptions == []


def test_unknown_type_is_named_once_and_skipped(recording):
    recording.node.topics["/foreign"] = "absent_msgs/msg/Thing"
    recording.recorder._next_search = 0.0
    recording.recorder.tick()
    recording.recorder._next_search = 0.0
    recording.recorder.tick()
    assert len(recording.node.warnings) == 1
    assert "/foreign" in recording.node.warnings[0]
    assert "absent_msgs/msg/Thing" in recording.node.warnings[0]
    assert "/foreign" not in recording.recorder.topic_names


def statement(node, listeners):
    """Return the serialised report of a node about who hears its topics."""
    from diagnostic_msgs.msg import DiagnosticArray
    from rclpy.serialization import serialize_message

    from vtff_node.diagnostics import OK, status
    from vtff_node.start.listeners import listener_values, status_name

    report = status(status_name(node), OK, "topics", listener_values(listeners))
    return serialize_message(DiagnosticArray(status=[report]))


@pytest.mark.parametrize("exclude", [(), ("/diagnostics",)])
def test_topic_set_is_not_stable_before_all_topics_are_heard(tmp_path, monkeypatch, exclude):
    pytest.importorskip("rclpy")
    now = [0.0]
    monkeypatch.setattr("vtff_bag.recorder.recorder.time.monotonic", lambda: now[0])
    node = FakeNode(
        {"/text": "std_msgs/msg/String", "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray"}
    )
    acknowledger = Acknowledger([].append)
    recorder = Recorder(
        node,
        BagWriter(tmp_path / "bag"),
        TopicSelection(exclude=exclude),
        acknowledger,
        ["/late"],
    )

    def tick(seconds):
        for _ in range(int(seconds / 0.05)):
            now[0] += 0.05
            recorder.tick()

    tick(1.0)
    assert not recorder.stable and recorder.missing == ["node /late"]
    assert ("/diagnostics" in recorder.topic_names) is not bool(exclude)
    # The announcement of one of its two publishers was lost.
    node.nodes["/text"] = "late"
    listeners = {"/text": ["/bag_recorder"], "/more": ["/bag_recorder"]}
    node.callbacks["/diagnostics"](statement("/late", listeners))
    tick(1.0)
    assert not recorder.stable and recorder.missing == ["/more of node /late"]
    node.topics["/more"] = "std_msgs/msg/String"
    node.nodes["/more"] = "late"
    assert not acknowledger.is_allowed
    tick(0.1)
    assert recorder.missing == [] and recorder.stable and acknowledger.is_allowed


def test_write_error_is_reported_once_and_recording_goes_quiet(recording, monkeypatch):
    def full(*arguments):
        raise BagWriteError("bag_0.mcap: cannot write: No space left on device")

    monkeypatch.setattr(recording.writer, "write", full)
    for _ in range(3):
        recording.node.callbacks["/clock"](stamped(100))
    assert len(recording.failures) == 1
    assert recording.recorder.received == 3


PUBLISHER = textwrap.dedent(
    """
    import sys, time
    import rclpy
    from rclpy.duration import Duration
    from geometry_msgs.msg import AccelStamped
    from rosgraph_msgs.msg import Clock
    from std_msgs.msg import String
    from vtff_msgs.msg import StepDone
    from vtff_node.node import VtffNode

    rclpy.init(args=["--ros-args", "-p", "lockstep:=true"])
    node = VtffNode("source")
    clock = node.publisher(Clock, "/clock")
    state = node.publisher(AccelStamped, "/deputy/state")
    text = node.publisher(String, "/text")
    acknowledged = []
    node.subscribe(
        StepDone,
        "/sim/step_done",
        lambda message: acknowledged.append(message.header.stamp.sec),
    )
    node.begin()

    def step(index):
        message = AccelStamped()
        message.header.stamp.sec = 1458521983 + index
        clock.publish(Clock(clock=message.header.stamp))
        if index < 667:
            state.publish(message)
            text.publish(String(data=f"step {index}"))

    def wait_for(seconds):
        deadline = time.monotonic() + 60.0
        while seconds not in acknowledged:
            if time.monotonic() > deadline:
                raise SystemExit(f"no acknowledgement of {seconds}")
            rclpy.spin_once(node, timeout_sec=1.0)

    # The first step is published before anybody is known to listen.
    step(0)
    wait_for(1458521983)
    if "end" in sys.argv:
        node.close(0.0)  # nothing waits any more for what has not been discovered
        print("published", flush=True)
        sys.stdin.read()
        sys.exit()
    for index in range(1, 666):
        step(index)
        if index % 10 == 0:
            wait_for(1458521983 + index)
        if index == 30 and "acknowledged" in sys.argv:
            print("acknowledged", flush=True)
            sys.stdin.read()
    step(666)
    step(667)  # a clock alone: 668 + 667 + 667 messages
    for publisher in (clock, state, text):
        assert publisher.wait_for_all_acked(Duration(seconds=10.0))
    print("published", flush=True)
    sys.stdin.read()
    """
)


@pytest.fixture
def ros_environment():
    pytest.importorskip("rclpy")
    pytest.importorskip("vtff_msgs")
    from domain_coordinator import domain_id

    with domain_id() as domain:
        yield {**os.environ, "ROS_DOMAIN_ID": str(domain)}


def start(arguments, environment):
    return subprocess.Popen(
        [sys.executable, *arguments],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def errors_of(*processes):
    """End processes and return what they have printed on stderr."""
    for process in processes:
        process.kill()
    return "\n".join(process.communicate()[1] for process in processes)


LOCKSTEP = ["-p", "lockstep:=true", "-p", "acknowledge_steps:=true"]
RECORDER = ["-m", "vtff_bag.bag_recorder_node", "--ros-args"]


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_node_records_every_message_in_lockstep(tmp_path, ros_environment, ending):
    bag = tmp_path / "run" / "bag"
    source = start(["-c", PUBLISHER], ros_environment)
    recorder = start(
        [*RECORDER, "-p", f"output:={bag}", *LOCKSTEP]
        + ["-p", "wait_for_nodes:=['/source']", "-p", "custom_data:=['configuration=abc']"],
        ros_environment,
    )
    try:
        assert source.stdout.readline() == "published\n", errors_of(source, recorder)
        recorder.send_signal(ending)
        printed, errors = recorder.communicate(timeout=30)
    finally:
        for process in (source, recorder):
            process.kill()
            process.communicate()
    assert recorder.returncode == 0, errors
    reader = BagReader(bag)
    assert reader.complete
    counts = {name: topic.message_count for name, topic in reader.topics.items()}
    assert counts["/clock"] == 668
    assert counts["/deputy/state"] == counts["/text"] == 667
    assert "/rosout" in counts and "/parameter_events" not in counts
    for name, count in counts.items():
        assert f"{count:10d}  {name}\n" in printed
    read = list(reader.messages("/text"))
    assert [m.message.data for m in read] == [f"step {index}" for index in range(667)]
    states = list(reader.messages("/deputy/state"))
    assert all(m.log_time == m.message.header.stamp.sec * SECOND for m in states)
    steps = [m.message.header.stamp.sec - 1458521983 for m in reader.messages("/sim/step_done")]
    assert steps == list(range(0, 667, 10))
    assert reader.topics["/text"].type_hash == bag_samples.STRING_HASH
    assert reader.topics["/text"].offered_qos_profiles[0]["durability"] == "transient_local"
    assert reader.custom_data == {"configuration": "abc"}


#: Runs the recorder; for three seconds it does not discover the publisher of a topic, as after the
#: loss of its announcement.
LATE_DISCOVERY = textwrap.dedent(
    """
    import time
    from rclpy.node import Node

    begun = time.monotonic()
    find = Node.get_publishers_info_by_topic

    def find_late(node, topic, *arguments, **names):
        is_hidden = topic == "{topic}" and time.monotonic() - begun < 3.0
        return [] if is_hidden else find(node, topic, *arguments, **names)

    Node.get_publishers_info_by_topic = find_late
    from vtff_bag.bag_recorder_node import main
    main()
    """
)


@pytest.mark.parametrize("topic", ["/text", "/diagnostics"])
def test_a_run_that_ends_after_its_first_step_is_whole_though_discovery_was_late(
    tmp_path, ros_environment, topic
):
    bag = tmp_path / "bag"
    source = start(["-c", PUBLISHER, "end"], ros_environment)
    recorder = start(
        ["-c", LATE_DISCOVERY.format(topic=topic), "--ros-args", "-p", f"output:={bag}"]
        + [*LOCKSTEP, "-p", "wait_for_nodes:=['/source']"],
        ros_environment,
    )
    try:
        assert source.stdout.readline() == "published\n", errors_of(source, recorder)
        recorder.send_signal(signal.SIGINT)
        _, errors = recorder.communicate(timeout=60)
    finally:
        for process in (source, recorder):
            process.kill()
            process.communicate()
    assert recorder.returncode == 0, errors
    counts = {name: found.message_count for name, found in BagReader(bag).topics.items()}
    assert counts["/clock"] == counts["/deputy/state"] == counts["/text"] == 1


def test_what_is_acknowledged_is_in_the_file_of_a_killed_node(tmp_path, ros_environment):
    bag = tmp_path / "bag"
    source = start(["-c", PUBLISHER, "acknowledged"], ros_environment)
    recorder = start([*RECORDER, "-p", f"output:={bag}", *LOCKSTEP], ros_environment)
    try:
        assert source.stdout.readline() == "acknowledged\n"
        recorder.kill()
        recorder.wait()
    finally:
        for process in (source, recorder):
            process.kill()
            process.communicate()
    assert recover(bag).message_counts["/clock"] == 31


def test_killed_node_leaves_everything_it_had_flushed(tmp_path, ros_environment):
    """The source falls silent; the recorder flushes by its own timer, then is killed."""
    bag = tmp_path / "bag"
    source = start(["-c", PUBLISHER], ros_environment)
    recorder = start([*RECORDER, "-p", f"output:={bag}", *LOCKSTEP], ros_environment)
    try:
        assert source.stdout.readline() == "published\n"
        deadline = time.monotonic() + 30.0
        while time.monotonic() < deadline:
            counts = BagReader(bag).topics
            if [counts[name].message_count for name in ("/clock", "/text")] == [668, 667]:
                break
            time.sleep(0.2)
        recorder.kill()
        recorder.wait()
    finally:
        for process in (source, recorder):
            process.kill()
            process.communicate()
    report = recover(bag)
    assert not report.was_complete
    assert report.message_counts["/clock"] == 668
    assert report.message_counts["/deputy/state"] == report.message_counts["/text"] == 667
    assert BagReader(report.output).complete


def test_full_disk_ends_the_node_with_an_error_and_a_readable_bag(tmp_path, ros_environment):
    limited = (
        "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (6000, 6000)); "
        "from vtff_bag.bag_recorder_node import main; main()"
    )
    bag = tmp_path / "bag"
    source = start(["-c", PUBLISHER], ros_environment)
    recorder = start(
        ["-c", limited, "--ros-args", "-p", f"output:={bag}", *LOCKSTEP]
        + ["-p", "chunk_size:=2048"],
        ros_environment,
    )
    try:
        recorder.wait(timeout=60)
    finally:
        for process in (source, recorder):
            process.kill()
        source_errors, errors = (process.communicate()[1] for process in (source, recorder))
    assert recorder.returncode == 1, source_errors
    assert "Traceback" not in errors
    assert f"recording ends: {bag}/bag_0.mcap: cannot write: File too large" in errors
    assert recover(bag).message_count > 0


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ([], "output"),
        (["-p", "output:={bag}", "-p", "compression:=bzip2"], "compression.*bzip2"),
        (["-p", "output:={bag}", "-p", "include:=("], "include"),
        (["-p", "output:={bag}", "-p", "custom_data:=['novalue']"], "custom_data.*novalue"),
        (["-p", "output:={file}/bag"], "output.*occupied"),
    ],
)
def test_wrong_parameters_end_with_one_clear_line(tmp_path, ros_environment, arguments, named):
    occupied = tmp_path / "occupied"
    occupied.write_text("")
    filled = [text.format(bag=tmp_path / "bag", file=occupied) for text in arguments]
    recorder = start([*RECORDER, *filled], ros_environment)
    _, errors = recorder.communicate(timeout=60)
    assert recorder.returncode == 2
    lines = [line for line in errors.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1
    assert re.search(named, lines[0])
    assert "Traceback" not in errors
