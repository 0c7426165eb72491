"""Samples that are no messages, on every topic of a flight: dropped, counted, nothing else."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time

import pytest
import rclpy
from domain_coordinator import domain_id
from graph_support import ROOT, SYSTEMS, WALL_TIME_FIELDS, topics
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock

from vtff_bag.file.message_content import have_equal_content
from vtff_bag.file.message_definitions import message_class
from vtff_bag.file.reader import BagReader
from vtff_bringup.run.domain import PROFILES_VARIABLE, RANGE_VARIABLE
from vtff_node import qos
from vtff_node.start.listeners import UNNAMED_NODE

CLOCK, RECORDER = "/clock", "bag_recorder"
LIMIT = 300.0  # s after which a test gives up
FLIGHTS = [
    ("reference", 120),
    *(
        pytest.param(system, 120, marks=pytest.mark.slow)
        for system in ("esf", "formation_three", "laser", "reference_attitude", "survey_software")
    ),
]


def damaged_samples(kind):
    """Return samples of a type that are cut short, and one with a text in Latin-1."""
    message = kind()
    if hasattr(message, "header"):
        message.header.frame_id = "antenna"
    content = serialize_message(message)
    content += bytes(-len(content) % 4)
    # Fast DDS fills samples up to whole words with zeros, and delivers none without bytes.
    samples = [content[:4], content[: 4 + (len(content) - 5) // 8 * 4]]
    if b"antenna" in content:
        samples.append(content.replace(b"antenna", b"\xe4ntenna"))
    return samples


class Intruder:
    """A foreign node that publishes damaged samples.

    They are transient local: each node in lockstep gets them, whenever it hears of their publisher.
    """

    def __init__(self, domain, samples, types):
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        self._node = rclpy.create_node("intruder", context=self._context)
        self._samples, self._types = samples, types
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        for topic in samples:
            if topic != CLOCK:
                self._publish(topic)
        # A simulator does not begin where somebody else publishes /clock.
        self._clock = self._node.create_subscription(Clock, CLOCK, self._on_clock, qos.PUBLISH)

    def _publish(self, topic):
        publisher = self._node.create_publisher(self._types[topic], topic, qos.PUBLISH)
        for content in self._samples[topic]:
            publisher.publish(content)

    def _on_clock(self, _):
        self._node.destroy_subscription(self._clock)
        self._publish(CLOCK)

    def look(self):
        """Return node and topic of each subscription now, those of recorders left out."""
        self._executor.spin_once(timeout_sec=0.05)
        return {
            (f"{each.node_namespace.rstrip('/')}/{each.node_name}", topic)
            for topic in self._samples
            for each in self._node.get_subscriptions_info_by_topic(topic)
            if each.node_name not in (RECORDER, self._node.get_name(), UNNAMED_NODE)
        }

    def close(self):
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)


def fly_disturbed(command, domain, samples, types):
    """Return who has subscribed to what during a flight, and its output."""
    seen = set()
    intruder = Intruder(domain, samples, types)
    process = subprocess.Popen(
        [sys.executable, "-m", "vtff_bringup.cli", *map(str, command)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "ROS_DOMAIN_ID": str(domain)},
    )
    try:
        deadline = time.monotonic() + LIMIT
        while process.poll() is None and time.monotonic() < deadline:
            seen |= intruder.look()
        output, _ = process.communicate(timeout=1.0)
    finally:
        process.kill()
        intruder.close()
    # The flight itself is whole; only the bag holds more than its nodes have published.
    assert process.returncode == 1, output
    assert "the bag does not hold exactly what the nodes published" in output
    return seen, output


@pytest.mark.parametrize(("system", "duration"), FLIGHTS)
def test_damaged_samples_on_every_topic_change_nothing(
    runs, tmp_path, monkeypatch, system, duration
):
    # As the run, so that both find each other at once.
    monkeypatch.setenv(PROFILES_VARIABLE, str(ROOT / "config/dds/fastdds.xml"))
    monkeypatch.setenv(RANGE_VARIABLE, "LOCALHOST")
    arguments = ("--duration", duration, "--composed", "--no-report")
    quiet = runs.make(f"quiet_{system}", f"{system}.yaml", *arguments)[0]
    reader = BagReader(quiet)
    types = {name: message_class(topic.type) for name, topic in reader.topics.items()}
    samples = {name: damaged_samples(kind) for name, kind in types.items() if name != "/rosout"}
    command = ["run", SYSTEMS / f"{system}.yaml", *arguments, "--out", tmp_path / "run"]
    with domain_id() as domain:
        seen, output = fly_disturbed(command, domain, samples, types)

    nodes = {}
    for path in (tmp_path / "run" / "nodes").glob("*.json"):
        record = json.loads(path.read_text())
        assert record["exit_code"] == 0, path.name
        nodes[record["node"]] = record["dropped_samples"]
    dropped = {(node, topic) for node, counts in nodes.items() for topic in counts}
    assert dropped >= seen and len(seen) >= 8
    for node in {node for node, _ in seen}:
        name = node.strip("/").replace("/", ".")
        assert re.search(rf"\[{name}\]: a sample of \S+ is dropped: ", output)
    for node, topic in dropped:
        assert nodes[node][topic] == len(samples[topic]), (node, topic)

    for topic in topics(quiet) - set(WALL_TIME_FIELDS):
        left, right = (
            [
                (raw.log_time, bytes(raw.serialized))
                for raw in BagReader(run).raw_messages([topic])
                if bytes(raw.serialized) not in samples[topic]
            ]
            for run in (quiet, tmp_path / "run")
        )
        assert len(left) == len(right)
        for (time_left, first), (time_right, second) in zip(left, right, strict=True):
            assert time_left == time_right
            assert have_equal_content(first, second, reader.topics[topic].type)
    recorded = BagReader(tmp_path / "run")
    for topic, damaged in samples.items():
        contents = [bytes(raw.serialized) for raw in recorded.raw_messages([topic])]
        assert all(content in contents for content in damaged), topic
