"""Observations of a recording as one table: the same numbers as message by message."""

import array

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from observation_messages import random_observations
from rclpy.serialization import serialize_message

from vtff_analysis.recordings.observation_recording import observation_table
from vtff_bag.file.cdr_columns import ColumnCollector
from vtff_bag.file.errors import BagReadError
from vtff_gnss.observation_table import ObservationTable
from vtff_node.conversions.gnss import observations_from_message

TYPE = "vtff_msgs/msg/GnssObservations"


@settings(deadline=None, max_examples=50)
@given(
    st.lists(
        st.tuples(st.integers(0, 9), st.sampled_from(["", "a", "chief/antenna"])), max_size=30
    ),
    st.integers(0, 2**32),
)
def test_columns_are_those_of_the_messages(shapes, seed):
    generator = np.random.default_rng(seed)
    messages = [random_observations(count, frame, generator) for count, frame in shapes]
    collector = ColumnCollector(TYPE, "here")
    for message in messages:
        collector.add(serialize_message(message))
    columns = collector.columns()
    table = observation_table(columns)
    expected = ObservationTable.from_epochs(observations_from_message(m) for m in messages)
    assert table.time_nanoseconds.tolist() == expected.time_nanoseconds.tolist()
    assert table.first_row.tolist() == expected.first_row.tolist()
    for name, column in expected.columns.items():
        assert table.columns[name].dtype == column.dtype
        assert table.columns[name].tobytes() == column.tobytes(), name
    assert table.receiver_status.tolist() == expected.receiver_status.tolist()


def test_unequal_lengths_are_refused():
    observations = random_observations(3, "frame", np.random.default_rng(0))
    observations.flags = array.array("H", [1])
    collector = ColumnCollector(TYPE, "here")
    collector.add(serialize_message(observations))
    with pytest.raises(BagReadError, match="'flags' of message 0 has 1 elements, 'prn' has 3"):
        observation_table(collector.columns())
