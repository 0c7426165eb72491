"""Columns of many messages: the same numbers as message by message."""

import array

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from std_msgs.msg import Header

from vtff_analysis.recordings.observation_recording import observation_table, stamps
from vtff_bag.file.cdr_columns import ColumnCollector
from vtff_bag.file.errors import BagReadError
from vtff_gnss.observation_table import ObservationTable
from vtff_gnss.observations import OBSERVATION_COLUMNS
from vtff_msgs.msg import GnssObservations, RelativeState
from vtff_node.conversions.gnss import observations_from_message

TYPE = "vtff_msgs/msg/GnssObservations"


def message(count, frame, generator):
    """Return observations whose bytes are random, NaN and infinity among them."""
    columns = {
        name: array.array(np.dtype(kind).char, generator.bytes(count * np.dtype(kind).itemsize))
        for name, kind in OBSERVATION_COLUMNS.items()
    }
    found = GnssObservations(
        header=Header(frame_id=frame),
        gps_week=int(generator.integers(0, 3000)),
        gps_time_of_week=float(generator.uniform(0.0, 604800.0)),
        time_status=160,
        receiver_status=int(generator.integers(0, 2**32)),
        **columns,
    )
    found.header.stamp.sec = int(generator.integers(0, 2**31))
    found.header.stamp.nanosec = int(generator.integers(0, 10**9))
    return found


@settings(deadline=None, max_examples=50)
@given(
    st.lists(
        st.tuples(st.integers(0, 9), st.sampled_from(["", "a", "chief/antenna"])), max_size=30
    ),
    st.integers(0, 2**32),
)
def test_columns_are_those_of_the_messages(shapes, seed):
    generator = np.random.default_rng(seed)
    messages = [message(count, frame, generator) for count, frame in shapes]
    collector = ColumnCollector(TYPE, "here")
    for one in messages:
        collector.add(serialize_message(one))
    columns = collector.columns()
    table = observation_table(columns)
    expected = ObservationTable.from_epochs(observations_from_message(m) for m in messages)
    assert table.time_nanoseconds.tolist() == expected.time_nanoseconds.tolist()
    assert table.first_row.tolist() == expected.first_row.tolist()
    for name, column in expected.columns.items():
        assert table.columns[name].dtype == column.dtype
        assert table.columns[name].tobytes() == column.tobytes(), name
    assert table.receiver_status.tolist() == expected.receiver_status.tolist()
    seconds = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in messages]
    assert stamps(columns).tolist() == seconds


def test_more_messages_than_a_batch(monkeypatch):
    monkeypatch.setattr("vtff_bag.file.cdr_columns._BATCH", 3)
    generator = np.random.default_rng(1)
    collector = ColumnCollector(TYPE, "here")
    messages = [message(count, "a", generator) for count in (2, 0, 1, 2, 5, 1, 0)]
    for one in messages:
        collector.add(serialize_message(one))
    assert collector.columns().lengths["prn"].tolist() == [2, 0, 1, 2, 5, 1, 0]
    assert collector.columns().sequences["flags"].tolist() == [
        value for one in messages for value in one.flags
    ]


def test_arrays_of_fixed_length_and_nested_fields():
    one = RelativeState(position=np.array([1.0, 2.0, 3.0]))
    collector = ColumnCollector("vtff_msgs/msg/RelativeState", "here")
    collector.add(serialize_message(one))
    assert collector.columns().numbers["position"].tolist() == [[1.0, 2.0, 3.0]]


@pytest.mark.parametrize("end", [3, 30, 60, -1])
def test_a_message_that_is_cut_off(end):
    collector = ColumnCollector(TYPE, "bag: topic '/x'")
    collector.add(serialize_message(message(4, "frame", np.random.default_rng(0)))[:end])
    with pytest.raises(BagReadError, match="bag: topic '/x'.*GnssObservations"):
        collector.columns()


def test_unequal_lengths_and_what_cannot_be_a_column():
    one = message(3, "frame", np.random.default_rng(0))
    one.flags = array.array("H", [1])
    collector = ColumnCollector(TYPE, "here")
    collector.add(serialize_message(one))
    with pytest.raises(BagReadError, match="'flags' of message 0 has 1 elements, 'prn' has 3"):
        observation_table(collector.columns())
    with pytest.raises(TypeError, match="'status' is sequence"):
        ColumnCollector("diagnostic_msgs/msg/DiagnosticArray", "here")
