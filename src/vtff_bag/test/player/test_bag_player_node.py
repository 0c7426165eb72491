"""bag_player against real readers: bytes, order, quality of service, services, pacing, keys."""

import os
import subprocess
import time

import bag_samples
import pytest

from vtff_bag.file.metadata import offered_qos
from vtff_bag.file.reader import BagReader
from vtff_bag.file.stamps import leading_stamp
from vtff_bag.file.writer import BagWriter

pytest.importorskip("rclpy")
pytest.importorskip("vtff_msgs")

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from domain_coordinator import domain_id
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String
from std_srvs.srv import Trigger

from vtff_bag.bag_player_node import BagPlayerNode
from vtff_bag.player.replay_qos import publisher_profile
from vtff_msgs.srv import Seek, SetRate
from vtff_node.executables import executable_path
from vtff_node.parameters import ParameterError
from vtff_node.stamps import to_stamp

STEPS = 700  # of three messages: more in all than a publisher keeps
LIMIT = 60.0  # s after which a test gives up


def write_recording(directory, clock=True, steps=STEPS):
    """Texts on two topics and diagnostics, one reader of which is far behind the other."""
    with BagWriter(directory, steady_clock=lambda: 0.0) as writer:
        if clock:
            clock_number = writer.add_topic("/clock", "rosgraph_msgs/msg/Clock", [offered_qos()])
        latched = writer.add_topic("/latched", "std_msgs/msg/String", [offered_qos()])
        volatile = offered_qos(durability="volatile", history="unknown", depth=0)
        plain = writer.add_topic("/plain", "std_msgs/msg/String", [volatile])
        health = writer.add_topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
        writer.add_topic("/radar", "radar_msgs/msg/Scan", definition="float32 range\n")
        for step in range(steps):
            stamp = bag_samples.START + step * bag_samples.STEP
            if clock:
                writer.write(clock_number, serialize_message(Clock(clock=to_stamp(stamp))), stamp)
            writer.write(latched, bag_samples.string_message(f"latched {step}"), stamp)
            writer.write(plain, bag_samples.string_message(f"plain {step}" * 30), stamp)
            if step % 10 == 0:
                writer.write(health, serialize_message(DiagnosticArray()), stamp)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    directory = tmp_path_factory.mktemp("recording") / "bag"
    write_recording(directory)
    return directory


@pytest.fixture
def graph(ros_context):
    graph = Graph(ros_context)
    yield graph
    graph.close()


class Graph:
    """A player and a listener in one executor."""

    def __init__(self, context):
        self.context = context
        self.executor = SingleThreadedExecutor(context=context)
        self.listener = rclpy.create_node("listener", context=context)
        self.executor.add_node(self.listener)
        self.received = []
        self.player = None

    def start(self, bag, **parameters):
        overrides = [Parameter("bag", value=str(bag))]
        overrides += [Parameter(name, value=value) for name, value in parameters.items()]
        self.player = BagPlayerNode(parameter_overrides=overrides, context=self.context)
        self.executor.add_node(self.player)
        return self.player

    def listen(self, topic, message_type, **policies):
        profile = QoSProfile(depth=5000, **policies)
        self.listener.create_subscription(
            message_type,
            topic,
            lambda serialized: self.received.append((topic, serialized)),
            profile,
            raw=True,
        )

    def listen_to_all(self):
        self.listen("/clock", Clock)
        self.listen("/latched", String, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.listen("/plain", String, reliability=ReliabilityPolicy.RELIABLE)
        self.listen("/diagnostics", DiagnosticArray)

    def spin_until(self, condition):
        deadline = time.monotonic() + LIMIT
        while not condition():
            assert time.monotonic() < deadline, "gave up waiting"
            self.executor.spin_once(timeout_sec=0.05)

    def play(self):
        """Spin to the end of the replay, then until nothing comes any more."""
        self.spin_until(lambda: self.player.finished)
        self.player.close()
        before = -1
        while before != len(self.received):
            before = len(self.received)
            for _ in range(5):
                self.executor.spin_once(timeout_sec=0.02)

    def call(self, service_type, name, **request):
        client = self.listener.create_client(service_type, f"/bag_player/{name}")
        self.spin_until(client.service_is_ready)
        future = client.call_async(service_type.Request(**request))
        self.spin_until(future.done)
        self.listener.destroy_client(client)
        return future.result()

    def of(self, topic):
        return [serialized for name, serialized in self.received if name == topic]

    def close(self):
        self.executor.shutdown()
        for node in (self.player, self.listener):
            if node is not None:
                node.destroy_node()


def recorded(bag, topic):
    return [message.serialized for message in BagReader(bag).raw_messages([topic])]


@pytest.mark.parametrize("rate", [150.0, 2000.0, 1e6])
def test_every_message_once_in_order_with_its_bytes(graph, recording, rate):
    graph.listen_to_all()
    graph.start(recording, rate=rate, delay=0.3)
    graph.play()
    for topic in ("/clock", "/latched", "/plain", "/diagnostics"):
        assert graph.of(topic) == recorded(recording, topic), topic


def test_every_message_once_while_paused_stepped_and_speeded(graph, recording):
    graph.listen_to_all()
    player = graph.start(recording, rate=200.0, delay=0.3)
    graph.spin_until(lambda: len(graph.of("/clock")) > 50)
    answer = graph.call(Trigger, "pause")
    assert answer.success and answer.message.startswith("paused at ")
    still = player.replay.published
    for _ in range(20):
        graph.executor.spin_once(timeout_sec=0.01)
    assert player.replay.published == still
    for number in range(10):
        assert graph.call(Trigger, "step").success
        assert player.replay.published == still + number + 1
    assert graph.call(SetRate, "set_rate", rate=5000.0).success
    refused = graph.call(SetRate, "set_rate", rate=-1.0)
    assert not refused.success and "rate -1" in refused.message
    assert graph.call(Trigger, "resume").success
    graph.play()
    for topic in ("/clock", "/latched", "/plain", "/diagnostics"):
        assert graph.of(topic) == recorded(recording, topic), topic


def test_seek_as_a_service(graph, recording):
    graph.listen_to_all()
    graph.start(recording, start_paused=True)
    assert graph.call(Seek, "seek", offset=650.0).success
    refused = graph.call(Seek, "seek", offset=1e6)
    assert not refused.success and "outside the bag" in refused.message
    assert graph.call(SetRate, "set_rate", rate=1e6).success
    assert graph.call(Trigger, "resume").success
    graph.play()
    assert graph.of("/plain") == recorded(recording, "/plain")[650:]


def test_clock_goes_before_each_message_where_none_is_recorded(graph, tmp_path):
    write_recording(tmp_path / "bag", clock=False, steps=50)
    graph.listen_to_all()
    graph.start(tmp_path / "bag", rate=1e6, delay=0.3)
    graph.play()
    expected = [bag_samples.START + step * bag_samples.STEP for step in range(50)]
    assert [leading_stamp(serialized) for serialized in graph.of("/clock")] == expected
    assert len(graph.of("/latched")) == 50


def test_times_that_no_stamp_can_hold_are_replayed_without_clock(graph, tmp_path):
    with BagWriter(tmp_path / "bag", steady_clock=lambda: 0.0) as writer:
        number = writer.add_topic("/plain", "std_msgs/msg/String", [offered_qos()])
        for index in range(5):
            writer.write(number, bag_samples.string_message(str(index)), 2**62 + index)
    graph.listen_to_all()
    graph.start(tmp_path / "bag", delay=0.3)
    graph.play()
    assert graph.of("/plain") == recorded(tmp_path / "bag", "/plain")
    assert graph.of("/clock") == []


def test_no_clock_where_none_is_wanted(graph, recording):
    graph.listen_to_all()
    graph.start(recording, rate=1e6, exclude_topics=["/clock"], publish_clock=False)
    graph.play()
    assert graph.of("/clock") == []
    assert graph.of("/plain") == recorded(recording, "/plain")


def test_a_live_clock_paces_and_the_recorded_one_is_left_out(graph, recording):
    graph.listen_to_all()
    graph.start(recording, pacing="clock")
    clock = graph.listener.create_publisher(Clock, "/clock", 10)
    graph.spin_until(lambda: graph.listener.count_subscribers("/clock") == 2)

    def tick(step):
        clock.publish(Clock(clock=to_stamp(bag_samples.START + step * bag_samples.STEP)))

    for step in (0, 3, 99):
        tick(step)
        graph.spin_until(lambda step=step: len(graph.of("/plain")) == step + 1)
    assert graph.of("/plain") == recorded(recording, "/plain")[:100]
    assert len(graph.of("/clock")) == 3


def test_wrong_parameters_are_named(graph, recording, tmp_path):
    for parameters, named in [
        ({"bag": tmp_path / "nothing"}, "nothing: no such bag"),
        ({"bag": recording, "topics": ["/none"]}, "no topic '/none'"),
        ({"bag": recording, "rate": 0.0}, "rate"),
        ({"bag": recording, "start_offset": 1e9}, "start_offset"),
        ({"bag": recording, "pacing": "steps"}, "lockstep"),
    ]:
        with pytest.raises(ParameterError, match=named):
            graph.start(**parameters)


def test_recorded_offers_are_restored():
    latched, plain = offered_qos(), offered_qos(durability="volatile", reliability="best_effort")
    assert publisher_profile([latched]).durability is DurabilityPolicy.TRANSIENT_LOCAL
    assert publisher_profile([plain]).reliability is ReliabilityPolicy.BEST_EFFORT
    assert publisher_profile([plain]).durability is DurabilityPolicy.VOLATILE
    # What every recorded reader could match: the strongest of each policy.
    mixed = publisher_profile([plain, latched])
    assert mixed.reliability is ReliabilityPolicy.RELIABLE
    assert mixed.durability is DurabilityPolicy.TRANSIENT_LOCAL
    assert publisher_profile([]).reliability is ReliabilityPolicy.RELIABLE


def test_offers_of_old_bags_are_numbers():
    """Metadata version 4 as rosbag2 of ROS 2 Foxy writes it: rmw's enumerations."""
    old = {"history": 1, "depth": 0, "reliability": 2, "durability": 1}
    profile = publisher_profile([old])
    assert profile.reliability is ReliabilityPolicy.BEST_EFFORT
    assert profile.durability is DurabilityPolicy.TRANSIENT_LOCAL


@pytest.mark.parametrize("damaged", [{}, {"reliability": []}, {"deadline": 3, "depth": "many"}])
def test_damaged_offers_give_a_usable_profile(damaged):
    assert publisher_profile([damaged]).depth >= 1000


def test_finite_durations_are_restored():
    offer = offered_qos(deadline={"sec": 2, "nsec": 5}, lifespan={"sec": 0, "nsec": 7})
    profile = publisher_profile([offer])
    assert profile.deadline.nanoseconds == 2_000_000_005
    assert profile.lifespan.nanoseconds == 7


def damaged_bag(directory, damage):
    """Write a bag of many chunks and damage it in the way that a word says."""
    bag_samples.write_bag(directory, bag_samples.sample_messages(3000), chunk_size=4096)
    file, metadata = next(directory.glob("*.mcap")), directory / "metadata.yaml"
    content = file.read_bytes()
    if damage == "cut":
        file.write_bytes(content[: len(content) // 2])
    elif damage == "hit":
        # The summary is intact: the damage shows only when the chunk is read.
        hit = BagReader(directory).contents[0].blocks[50].offset + 200
        file.write_bytes(content[:hit] + bytes(100) + content[hit + 100 :])
    elif damage == "empty":
        file.write_bytes(b"")
    elif damage == "text":
        file.write_bytes(b"hello")
    elif damage == "metadata":
        metadata.write_text("[[[")
    elif damage == "storage":
        metadata.write_text(metadata.read_text().replace("mcap", "sqlite3"))
    return directory


@pytest.mark.parametrize(
    ("damage", "exit_code", "expected"),
    [
        ("cut", 0, "are damaged or cut off"),
        ("hit", 0, "damaged between bytes"),
        ("metadata", 0, "metadata.yaml: not valid YAML"),
        ("empty", 2, "error: parameter 'bag':"),
        ("text", 2, "nothing in it is readable"),
        ("storage", 2, "storage 'sqlite3' is not supported"),
    ],
)
def test_a_damaged_bag_is_named_in_one_line(damage, exit_code, expected, tmp_path):
    bag = damaged_bag(tmp_path / "bag", damage)
    program = str(executable_path("vtff_bag", "bag_player"))
    parameters = (f"bag:={bag}", "rate:=1000000.0", "delay:=0.0")
    arguments = [word for value in parameters for word in ("-p", value)]
    with domain_id() as free_domain:
        result = subprocess.run(
            [program, "--ros-args", *arguments],
            capture_output=True,
            text=True,
            timeout=LIMIT,
            env={**os.environ, "ROS_DOMAIN_ID": str(free_domain)},
        )
    printed = result.stdout + result.stderr
    assert result.returncode == exit_code, printed
    assert sum(expected in line for line in printed.splitlines()) == 1, printed
    assert "Traceback" not in printed
    if exit_code:
        assert len(printed.splitlines()) == 1, printed
