"""Two runs of one scenario with one seed: the same messages, topic by topic, byte for byte."""

from __future__ import annotations

import itertools
import struct

import pytest
from rclpy.serialization import deserialize_message

from vtff_bringup.bag.reader import BagReader
from vtff_msgs.msg import SimulatorStatus, StepDone

SYSTEM = "reference_software.yaml"

#: Topics that tell of wall time or of the machine.
EXCEPTED = {"/diagnostics", "/rosout"}

#: Bytes of wall time in otherwise compared messages: StepDone.compute_time, and
#: SimulatorStatus.real_time_factor and wall_lag, which stand side by side.
WALL_TIME_FIELDS = {"/sim/step_done": (StepDone, 4), "/sim/status": (SimulatorStatus, 8)}


def topics(run):
    return {name for name in BagReader(run).topics if name not in EXCEPTED}


def without_wall_time(topic, content):
    """Return the bytes of a message with its wall-time fields set to zero."""
    if topic not in WALL_TIME_FIELDS:
        return content
    kind, length = WALL_TIME_FIELDS[topic]
    message = deserialize_message(content, kind)
    if kind is StepDone:
        start = content.rindex(struct.pack("<f", message.compute_time))
    else:
        values = struct.pack("<ff", message.real_time_factor, message.wall_lag)
        start = content.rindex(values)
    return content[:start] + bytes(length) + content[start + length :]


def serialized(run, topic):
    """Return log time and bytes of every message of a topic, without wall time."""
    found = [
        (raw.log_time, without_wall_time(topic, bytes(raw.serialized)))
        for raw in BagReader(run).raw_messages([topic])
    ]
    if topic == "/sim/step_done":
        # Several nodes may publish here; only the order of each of them is defined.
        found.sort()
    return found


@pytest.fixture(scope="module")
def four_runs(runs):
    return {
        "distributed_1": runs.make("distributed_1", SYSTEM)[0],
        "distributed_2": runs.make("distributed_2", SYSTEM, "--no-report")[0],
        "composed_1": runs.make("composed_1", SYSTEM, "--composed", "--no-report")[0],
        "composed_2": runs.make("composed_2", SYSTEM, "--composed", "--no-report")[0],
    }


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("distributed_1", "distributed_2"),
        ("composed_1", "composed_2"),
        ("distributed_1", "composed_1"),
    ],
)
def test_runs_are_equal_byte_for_byte(four_runs, first, second):
    names = topics(four_runs[first])
    assert names == topics(four_runs[second])
    assert len(names) >= 8
    for topic in sorted(names):
        pairs = itertools.zip_longest(
            serialized(four_runs[first], topic), serialized(four_runs[second], topic)
        )
        for number, (left, right) in enumerate(pairs):
            assert left == right, f"{topic}: message {number} differs"


def test_another_controller_gives_other_messages(runs, four_runs):
    """The comparison can fail."""
    other = runs.make(
        "other", SYSTEM, "sdre_controller.design:=delay_aware", "--duration", 60, "--no-report"
    )[0]
    topic = "/deputy/control/thrust_command"
    first = serialized(four_runs["composed_1"], topic)[:60]
    assert first != serialized(other, topic)[:60]
