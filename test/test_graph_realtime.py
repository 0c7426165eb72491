"""Pacing with the wall clock: the same loop, the same messages, one step a second."""

from __future__ import annotations

import numpy as np
import pytest

from vtff_bag.file.reader import BagReader
from vtff_msgs.msg import SimulatorStatus

DURATION = 6


@pytest.fixture(scope="module")
def realtime(runs):
    # A busy machine may be late; what that does has tests of its own.
    arguments = ("--realtime", "--max-lag", 0, "--duration", DURATION, "--no-report")
    return runs.make("realtime", "reference_software.yaml", *arguments)[0]


def states(run):
    messages = BagReader(run).messages("/deputy/relative_state_truth")
    return np.array([[*item.message.position, *item.message.velocity] for item in messages])


def test_every_step_is_there_and_no_command_is_late(realtime):
    statuses = [item.message for item in BagReader(realtime).messages("/sim/status")]
    assert [status.step for status in statuses] == [*range(DURATION + 1), DURATION]
    assert statuses[-1].state == SimulatorStatus.STATE_ENDED
    assert statuses[-1].pacing == SimulatorStatus.PACING_REALTIME
    assert statuses[-1].late_commands == 0


def test_realtime_flies_what_lockstep_flies(realtime, runs):
    """The one-sample delay is the thruster's, so pacing must not change the motion."""
    # The run of test_graph_determinism.py.
    arguments = ("--composed", "--duration", 600, "--no-report")
    lockstep = runs.make("composed_1", "reference_software.yaml", *arguments)[0]
    np.testing.assert_array_equal(states(realtime), states(lockstep)[: DURATION + 1])
