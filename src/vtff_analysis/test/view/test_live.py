"""The viewer of a live graph: it takes in what is published, publishes nothing, and starts anew."""

import asyncio
import json
import time

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("vtff_msgs", reason="needs the workspace")

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from full_run_samples import orbit  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.serialization import serialize_message  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

from vtff_analysis.view.foxglove_server import FoxgloveMissingError, FoxgloveServer  # noqa: E402
from vtff_analysis.view.live import LiveScene, ViewerNode  # noqa: E402
from vtff_msgs.msg import GnssObservations, IrregularityBoundary, OrbitState  # noqa: E402
from vtff_node.qos import PUBLISH  # noqa: E402
from vtff_node.stamps import to_stamp  # noqa: E402

LIMIT = 20.0  # s of wall time for what takes a fraction of one
START = 1_458_521_983
TOPIC = "/chief/truth/orbit"


class Graph:
    """A publisher and a viewer in one executor."""

    def __init__(self, context):
        self.source = rclpy.create_node("source", context=context)
        self.publisher = self.source.create_publisher(OrbitState, TOPIC, PUBLISH)
        self.live = LiveScene("test")
        self.forwarded = []
        self.viewer = ViewerNode(
            self.live, lambda *message: self.forwarded.append(message), context=context
        )
        self.executor = SingleThreadedExecutor(context=context)
        for node in (self.source, self.viewer):
            self.executor.add_node(node)

    def publish(self, second):
        message = OrbitState()
        message.header.stamp = to_stamp((START + second) * 10**9)
        message.header.frame_id = "gcrf"
        message.position, message.velocity = orbit(float(second))
        self.publisher.publish(message)

    def until(self, condition):
        deadline = time.monotonic() + LIMIT
        while not condition():
            assert time.monotonic() < deadline
            self.executor.spin_once(timeout_sec=0.05)

    def times(self):
        series = self.live.scene.series.get(f"orbit{TOPIC[:6]}/truth")
        return series.time if series is not None else []


@pytest.fixture
def graph(ros_context):
    running = Graph(ros_context)
    yield running
    running.executor.shutdown()
    running.viewer.destroy_node()
    running.source.destroy_node()


def test_what_was_and_is_published_arrives_once(graph):
    for second in range(5):
        graph.publish(second)  # before the viewer has found the topic
    graph.until(lambda: len(graph.times()) == 5)
    content, sent = graph.live.news({})
    assert content["reset"] and content["live"]
    assert content["series"][0]["time"] == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert len(content["dip_equator"]) == 73
    graph.publish(5)
    graph.until(lambda: len(graph.times()) == 6)
    content, sent = graph.live.news(sent)
    assert not content["reset"]
    assert content["series"][0]["time"] == [5.0]
    assert graph.live.news(sent)[0]["series"] == []
    assert [topic for topic, *_ in graph.forwarded] == [TOPIC] * 6
    assert graph.live.as_json()["series"] == []


def test_what_is_no_message_is_forwarded_and_not_shown(graph):
    graph.publish(0)
    message = OrbitState()
    message.header.stamp = to_stamp((START + 1) * 10**9)
    graph.publisher.publish(serialize_message(message)[:40])
    graph.publish(2)
    graph.until(lambda: len(graph.forwarded) == 3)
    assert graph.times() == [0.0, 2.0]


def test_late_edges_and_health_of_slower_nodes_are_no_step_back():
    live = LiveScene("test")
    _, counts = live.news({})
    for topic, kind in (
        ("/deputy/iono/irregularity_boundary", IrregularityBoundary),
        ("/diagnostics", DiagnosticArray),
    ):
        for second in (100, 40):
            stamp = (START + second) * 10**9
            message = kind()
            message.header.stamp = to_stamp(stamp)
            live.take(topic, stamp, lambda message=message: message)
    assert not live.news(counts)[0]["reset"]
    assert [event.kind for event in live.scene.events] == ["edge", "edge"]


def test_a_replay_that_goes_back_starts_the_scene_anew(graph):
    for second in (0, 1, 100, 101):
        graph.publish(second)
    graph.until(lambda: len(graph.times()) == 4)
    _, sent = graph.live.news({})
    graph.publish(50)
    graph.until(lambda: len(graph.times()) == 1)
    content, _ = graph.live.news(sent)
    assert content["reset"]
    assert content["series"][0]["time"] == [0.0]
    assert content["start_unix"] == START + 50


def test_the_viewer_publishes_nothing(graph):
    """A recorder would find messages that no node of the run accounts for."""
    graph.until(lambda: graph.source.count_subscribers(TOPIC) == 1)
    published = graph.viewer.get_publisher_names_and_types_by_node("viewer", "/")
    assert [name for name, _ in published] == ["/parameter_events"]


def test_commands_without_and_with_a_replay(graph):
    assert "no replay runs" in graph.viewer.command("pause", 0.0)
    with pytest.raises(ValueError, match="unknown command 'fly'"):
        graph.viewer.command("fly", 0.0)

    def answer(request, response):
        response.message = "paused at 1.000 s"
        return response

    graph.source.create_service(Trigger, "/bag_player/pause", answer)
    client, _ = graph.viewer._commands["pause"]
    graph.until(client.service_is_ready)
    said = []
    loop = asyncio.new_event_loop()
    asked = loop.run_in_executor(None, lambda: said.append(graph.viewer.command("pause", 0.0)))
    graph.until(lambda: bool(said))
    loop.run_until_complete(asked)
    loop.close()
    assert said == ["paused at 1.000 s"]


def test_foxglove_gets_the_bytes_as_they_are():
    try:
        server = FoxgloveServer(port=0)
    except FoxgloveMissingError as error:
        pytest.skip(str(error))
    websockets = pytest.importorskip("websockets", reason="needs websockets")
    message = serialize_message(GnssObservations(gps_week=1889))
    server.send("/chief/gnss/epoch", "vtff_msgs/msg/GnssObservations", message, START * 10**9)
    server.send("/unknown", "nowhere_msgs/msg/Nothing", b"", 0)  # left out, without an error

    async def listen():
        async with websockets.connect(server.address, subprotocols=["foxglove.sdk.v1"]) as socket:
            while True:
                received = await asyncio.wait_for(socket.recv(), LIMIT)
                if isinstance(received, bytes):
                    if received[0] == 1:  # message data: opcode, subscription, time, bytes
                        return received
                    continue
                told = json.loads(received)
                if told["op"] == "advertise":
                    (channel,) = told["channels"]
                    assert channel["schemaName"] == "vtff_msgs/msg/GnssObservations"
                    assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
                    wanted = [{"id": 7, "channelId": channel["id"]}]
                    await socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
                    await asyncio.sleep(0.2)
                    server.send(
                        "/chief/gnss/epoch",
                        "vtff_msgs/msg/GnssObservations",
                        message,
                        START * 10**9,
                    )

    try:
        received = asyncio.run(listen())
    finally:
        server.stop()
    assert int.from_bytes(received[5:13], "little") == START * 10**9
    assert received[13:] == message
