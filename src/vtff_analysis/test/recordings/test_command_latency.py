"""Latency of commands in real time, from what drivers and thrusters tell on /diagnostics."""

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from vtff_analysis.recordings.recording_details import DetailCollector
from vtff_node.step_moments import COMMAND_SENT, SECOND_RECEIVED, StepMoments


def collect(*reports):
    collector = DetailCollector()
    add = collector.handler("/diagnostics")
    for name, spacecraft, values in reports:
        pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
        status = DiagnosticStatus(name=name, hardware_id=spacecraft, values=pairs)
        add(DiagnosticArray(status=[status]))
    return collector.command_latency()


def told(name, *moments):
    collected = StepMoments()
    for stamp, moment in moments:
        collected.note(stamp, moment)
    return collected.values(name)


def test_the_later_receiver_counts():
    latency = collect(
        ("driver", "a", told(SECOND_RECEIVED, (1, 10.000), (2, 11.000), (3, 12.0))),
        ("driver", "b", told(SECOND_RECEIVED, (1, 10.002), (2, 10.990))),
        ("thruster", "deputy", told(COMMAND_SENT, (1, 10.005), (2, 11.001))),
        ("thruster", "deputy", told(COMMAND_SENT, (2, 11.001), (4, 13.5))),  # step 2 again
    )
    assert list(latency) == ["deputy"]
    np.testing.assert_allclose(latency["deputy"], [0.003, 0.001], atol=1e-9)


@pytest.mark.parametrize("received", ["other 1:10.0", "", "x", "1:10.0", "other"])
def test_another_clock_and_other_texts_give_no_latency(received):
    sent = told(COMMAND_SENT, (1, 10.0))
    assert collect(("driver", "a", {SECOND_RECEIVED: received}), ("thruster", "deputy", sent)) == {}
