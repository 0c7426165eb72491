"""Messages to bytes and back without the conversions of ROS."""

from __future__ import annotations

import array

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from geometry_msgs.msg import AccelStamped  # noqa: E402
from nav_msgs.msg import Odometry  # noqa: E402
from rclpy.serialization import deserialize_message, serialize_message  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from std_msgs.msg import Empty  # noqa: E402

from vtff_msgs import msg as vtff_messages  # noqa: E402
from vtff_msgs.msg import (  # noqa: E402
    AmbiguityStatus,
    GnssObservations,
    OrbitState,
    RelativeState,
    SimulatorStatus,
    StepDone,
)
from vtff_node.message_bytes import message_bytes, message_of_fields  # noqa: E402

TYPES = (
    AccelStamped,
    AmbiguityStatus,
    Clock,
    GnssObservations,
    Odometry,
    OrbitState,
    RelativeState,
    SimulatorStatus,
    StepDone,
)


def fill(message: object, generator: np.random.Generator, length: int) -> None:
    """Give each number, text, array and sequence of a message a drawn value."""
    for name, declared in message.get_fields_and_field_types().items():  # type: ignore[attr-defined]
        value = getattr(message, name)
        if hasattr(value, "get_fields_and_field_types"):
            fill(value, generator, length)
        elif isinstance(value, str):
            setattr(message, name, "".join(generator.choice(list("azé/ "), size=length)))
        elif isinstance(value, bool):
            setattr(message, name, bool(generator.integers(2)))
        elif isinstance(value, float):
            drawn = generator.normal()
            setattr(message, name, float(np.float32(drawn) if declared == "float" else drawn))
        elif isinstance(value, int):
            setattr(message, name, int(generator.integers(0, 100)))
        elif isinstance(value, np.ndarray):
            setattr(message, name, generator.normal(size=value.size).astype(value.dtype))
        elif isinstance(value, array.array):
            count = int(generator.integers(0, length + 1))
            drawn_values = generator.integers(0, 100, size=count).astype(value.typecode)
            setattr(message, name, array.array(value.typecode, drawn_values.tobytes()))


@pytest.mark.parametrize("message_type", TYPES, ids=lambda kind: kind.__name__)
def test_the_bytes_are_those_of_ros(message_type):
    conversion = message_bytes(message_type)
    generator = np.random.default_rng(1)
    for length in (0, 1, 2, 3, 5, 8, 5, 0):
        message = message_type()
        fill(message, generator, length)
        content = conversion.serialize(message)
        assert deserialize_message(content, message_type) == message
        of_ros = bytes(serialize_message(message))
        assert len(content) <= len(of_ros)
        for stored in (of_ros, content, content + b"\0\0"):
            read = conversion.deserialize(stored)
            assert type(read) is message_type
            assert read == message
            assert repr(read) == repr(message)
            assert conversion.serialize(read) == content


def test_what_is_read_can_be_changed_and_converted_by_ros():
    message = RelativeState(child_frame_id="deputy")
    read = message_bytes(RelativeState).deserialize(bytes(serialize_message(message)))
    read.position[1] = 100.0
    read.header.frame_id = "chief/rtn"
    again = deserialize_message(serialize_message(read), RelativeState)
    assert (again.position[1], again.header.frame_id) == (100.0, "chief/rtn")
    assert message.position[1] == 0.0


def test_texts_of_one_total_length_are_told_apart():
    conversion = message_bytes(OrbitState)
    for frame, child in (("gcrf", "chief"), ("earth", "chie"), ("gcrf", "chief")):
        message = OrbitState(child_frame_id=child)
        message.header.frame_id = frame
        assert conversion.deserialize(bytes(serialize_message(message))) == message


def test_bytes_of_another_machine_are_left_to_ros():
    stamp = b"\x00\x00\x00\x07\x00\x00\x00\x08"
    message = message_bytes(Clock).deserialize(b"\x00\x00\x00\x00" + stamp)
    assert (message.clock.sec, message.clock.nanosec) == (7, 8)


def test_truncated_bytes_are_refused_as_by_ros():
    content = bytes(serialize_message(StepDone(node="/chief/receiver_driver")))
    with pytest.raises(Exception, match=r".+"):
        message_bytes(StepDone).deserialize(content[:20])


@pytest.mark.parametrize("message_type", [DiagnosticArray, Empty])
def test_types_with_lists_of_messages_or_without_fields(message_type):
    conversion = message_bytes(message_type)
    if conversion is not None:
        assert conversion.deserialize(bytes(serialize_message(message_type()))) == message_type()


def test_most_messages_of_vtff_are_converted():
    kinds = [getattr(vtff_messages, name) for name in dir(vtff_messages) if name[0].isupper()]
    converted = [kind for kind in kinds if message_bytes(kind) is not None]
    assert len(converted) > 0.5 * len(kinds)


def test_a_message_of_its_fields_is_that_of_the_constructor():
    made = RelativeState()
    fill(made, np.random.default_rng(3), 4)
    names = RelativeState.get_fields_and_field_types()
    fields = {name: getattr(made, name) for name in names}
    message = message_of_fields(RelativeState, **fields)
    assert message == made
    assert type(message) is RelativeState
    assert serialize_message(message) == serialize_message(made)


def test_numbers_beyond_their_field_are_left_to_ros():
    message = RelativeState(ratio=0.0)
    message._ratio = 1e39  # ROS makes it infinite where it does not check fields
    content = message_bytes(RelativeState).serialize(message)
    assert message_bytes(RelativeState).deserialize(bytes(content)).ratio == np.inf
    step = StepDone()
    step._node = 7
    with pytest.raises(Exception, match=r".+"):
        message_bytes(StepDone).serialize(step)
