"""Samples as messages: what is whole is read as by rclpy, what is damaged is refused."""

from __future__ import annotations

import operator
import time

import pytest

rclpy = pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from geometry_msgs.msg import AccelStamped  # noqa: E402
from hypothesis import given, settings  # noqa: E402
from hypothesis import strategies as st  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.serialization import deserialize_message, serialize_message  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402

from vtff_msgs import msg as vtff_messages  # noqa: E402
from vtff_msgs.msg import FormationGuidance, RelativeState  # noqa: E402
from vtff_node.samples import SampleError, SampleReader  # noqa: E402

LIMIT = 20.0  # s of wall time for what takes a fraction of one
#: What nodes subscribe to, and all other messages of vtff.
TYPES = [
    AccelStamped,
    Clock,
    *(getattr(vtff_messages, name) for name in dir(vtff_messages) if name[0].isupper()),
]


def text_paths(message, prefix=""):
    """Return the paths of the texts in a message."""
    paths = []
    for name in message.get_fields_and_field_types():
        value = getattr(message, name)
        if isinstance(value, str):
            paths.append(prefix + name)
        elif hasattr(value, "get_fields_and_field_types"):
            paths += text_paths(value, f"{prefix}{name}.")
    return paths


def filled(kind):
    """Return a message with a text of its own in each field of text."""
    message = kind()
    for number, path in enumerate(text_paths(message)):
        parent, _, name = path.rpartition(".")
        setattr(operator.attrgetter(parent)(message) if parent else message, name, f"text{number}")
    return message


@pytest.mark.parametrize("kind", TYPES, ids=lambda kind: kind.__name__)
def test_a_whole_sample_is_read_as_by_rclpy(kind):
    content = serialize_message(filled(kind))
    assert SampleReader(kind).read(content) == filled(kind)
    assert SampleReader(kind).read(content + bytes(4)) == filled(kind)


@pytest.mark.parametrize("kind", TYPES, ids=lambda kind: kind.__name__)
def test_a_sample_cut_anywhere_is_refused(kind):
    """Unless only what fills it up is cut off."""
    reader, content = SampleReader(kind), serialize_message(filled(kind))
    whole = []
    for length in range(len(content)):
        try:
            whole.append(reader.read(content[:length]))
        except SampleError as error:
            assert str(error) == f"{length} bytes that are no {kind.__name__}"
    assert all(message == filled(kind) for message in whole)
    assert len(whole) < len(content) / 4


@pytest.mark.parametrize("kind", TYPES, ids=lambda kind: kind.__name__)
def test_a_foreign_text_is_refused_and_named(kind):
    reader, content = SampleReader(kind), serialize_message(filled(kind))
    for number, path in enumerate(text_paths(kind())):
        latin = content.replace(b"text%d\0" % number, b"t\xe4xt%d\0" % number)
        with pytest.raises(SampleError, match=f"field '{path}' is not UTF-8"):
            reader.read(latin)


def test_a_foreign_text_in_a_list_is_refused():
    content = serialize_message(FormationGuidance(spacecraft=["chief", "deputy"]))
    with pytest.raises(SampleError, match="field 'spacecraft' is not UTF-8"):
        SampleReader(FormationGuidance).read(content.replace(b"deputy", b"d\xe9puty"))


@pytest.mark.parametrize("kind", TYPES, ids=lambda kind: kind.__name__)
@settings(max_examples=25)
@given(data=st.data())
def test_damaged_bytes_give_a_message_or_are_refused(kind, data):
    content = bytearray(serialize_message(filled(kind)))
    places = st.integers(0, len(content) - 1)
    for place, byte in data.draw(st.lists(st.tuples(places, st.integers(0, 255)), max_size=8)):
        content[place] = byte
    damaged = bytes(content[: data.draw(st.integers(0, len(content)))])
    try:
        message = SampleReader(kind).read(damaged)
    except SampleError:
        return
    assert isinstance(message, kind)
    assert deserialize_message(serialize_message(message), kind) is not None


def test_a_text_without_nul_keeps_its_last_letter():
    """As rclpy reads it; writers of other languages leave the NUL out."""
    content = serialize_message(filled(RelativeState)).replace(b"text0\0", b"text0!")
    assert SampleReader(RelativeState).read(content).header.frame_id == "text0!"


@pytest.mark.parametrize("latched", [False, True])
def test_a_node_drops_and_counts_what_is_no_message(ros_context, latched):
    from vtff_node import qos
    from vtff_node.node import VtffNode

    node, heard = VtffNode("listener", context=ros_context), []
    for topic in ("/first", "/second"):
        node.subscribe(RelativeState, topic, heard.append, latched=latched)
    executor = SingleThreadedExecutor(context=ros_context)
    executor.add_node(node)
    publishers = [
        node.create_publisher(RelativeState, topic, qos.PUBLISH) for topic in ("/first", "/second")
    ]
    whole = serialize_message(filled(RelativeState))
    try:
        deadline = time.monotonic() + LIMIT
        while not all(publisher.get_subscription_count() for publisher in publishers):
            assert time.monotonic() < deadline
            executor.spin_once(timeout_sec=0.05)
        for content in (whole[:40], whole.replace(b"text1", b"\xffext1"), whole):
            publishers[0].publish(content)
        publishers[1].publish(whole[:44])
        publishers[1].publish(whole)
        while len(heard) < 2 and time.monotonic() < deadline:
            executor.spin_once(timeout_sec=0.05)
        assert heard == [filled(RelativeState)] * 2
        (report,) = node._sample_reports()
        counts = {value.key: value.value for value in report.values}
        assert report.message == "3 samples dropped" and counts == {"/first": "2", "/second": "1"}
    finally:
        executor.shutdown()
        node.destroy_node()
