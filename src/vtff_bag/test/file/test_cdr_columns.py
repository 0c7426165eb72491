"""Columns of many messages: the same numbers as message by message."""

import numpy as np
import pytest
from observation_messages import random_observations
from rclpy.serialization import serialize_message

from vtff_bag.file.cdr_columns import ColumnCollector
from vtff_bag.file.errors import BagReadError
from vtff_msgs.msg import RelativeState

TYPE = "vtff_msgs/msg/GnssObservations"


def test_more_messages_than_a_batch(monkeypatch):
    monkeypatch.setattr("vtff_bag.file.cdr_columns._BATCH", 3)
    generator = np.random.default_rng(1)
    collector = ColumnCollector(TYPE, "here")
    messages = [random_observations(count, "a", generator) for count in (2, 0, 1, 2, 5, 1, 0)]
    for message in messages:
        collector.add(serialize_message(message))
    assert collector.columns().lengths["prn"].tolist() == [2, 0, 1, 2, 5, 1, 0]
    assert collector.columns().sequences["flags"].tolist() == [
        value for message in messages for value in message.flags
    ]


def test_arrays_of_fixed_length_and_nested_fields():
    state = RelativeState(position=np.array([1.0, 2.0, 3.0]))
    collector = ColumnCollector("vtff_msgs/msg/RelativeState", "here")
    collector.add(serialize_message(state))
    assert collector.columns().numbers["position"].tolist() == [[1.0, 2.0, 3.0]]


@pytest.mark.parametrize("end", [3, 30, 60, -1])
def test_a_message_that_is_cut_off(end):
    collector = ColumnCollector(TYPE, "bag: topic '/x'")
    collector.add(
        serialize_message(random_observations(4, "frame", np.random.default_rng(0)))[:end]
    )
    with pytest.raises(BagReadError, match="bag: topic '/x'.*GnssObservations"):
        collector.columns()


def test_a_sequence_of_messages_cannot_be_a_column():
    with pytest.raises(TypeError, match="'status' is sequence"):
        ColumnCollector("diagnostic_msgs/msg/DiagnosticArray", "here")
