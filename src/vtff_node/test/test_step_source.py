"""StepSource: acknowledgements, readiness, patience, and the text that names who is missing."""

from __future__ import annotations

import dataclasses

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from vtff_msgs.msg import StepDone  # noqa: E402
from vtff_node.stamps import to_stamp  # noqa: E402
from vtff_node.step_source import STEPS_AT_ONCE, StepSource, StepSourceParameters  # noqa: E402

SECOND = 1_000_000_000
PARAMETERS = StepSourceParameters(
    lockstep_participants=["/a", "/b"],
    lockstep_side_branches=["/recorder"],
    expected_nodes=["/a", "/b", "/recorder"],
    maximum_lag=2,
    start_timeout=30.0,
    step_timeout=5.0,
)


class Node:
    """A node as far as a step source knows it."""

    def __init__(self, lockstep=True, present=("/a", "/b", "/recorder")):
        self.lockstep = lockstep
        self.present = present
        self.finished = False
        self.subscriptions = []

    def subscribe(self, message_type, topic, callback, *, latched=False):
        self.subscriptions.append((message_type, topic, latched))

    def absent_nodes(self, expected):
        return [name for name in expected if name not in self.present]


class Bench:
    """A step source with a wall clock set by hand."""

    def __init__(self, node=None, parameters=PARAMETERS, **options):
        self.node = node or Node()
        self.now = 0.0
        self.acknowledged = 0
        self.source = StepSource(
            self.node, parameters, self._note, steady_clock=lambda: self.now, **options
        )

    def _note(self):
        self.acknowledged += 1

    def acknowledge(self, stamp, *names):
        for name in names:
            message = StepDone(node=name)
            message.header.stamp = to_stamp(stamp)
            self.source.acknowledge(message)


def test_a_step_is_complete_when_all_participants_have_acknowledged_it():
    bench = Bench()
    bench.source.begin(SECOND)
    assert (bench.source.step, bench.source.is_complete) == (0, False)
    bench.acknowledge(SECOND, "/a", "/b")
    assert not bench.source.is_complete  # the first step waits for the side branch too
    bench.acknowledge(SECOND, "/recorder")
    assert bench.source.is_complete
    assert bench.acknowledged == 3
    bench.source.begin(2 * SECOND)
    bench.acknowledge(2 * SECOND, "/a", "/b")
    assert (bench.source.step, bench.source.is_complete) == (1, True)


def test_a_step_also_waits_for_its_data():
    awaited = ["thrust on /deputy"]
    bench = Bench(awaited_data=lambda: awaited)
    bench.source.begin(SECOND)
    bench.acknowledge(SECOND, "/a", "/b", "/recorder")
    assert not bench.source.is_complete
    bench.now = 30.1
    text = bench.source.describe_hanging_step()
    for part in ("step 0", "30 s (start_timeout)", "waiting for thrust on /deputy"):
        assert part in text
    awaited.clear()
    assert bench.source.is_complete
    assert bench.source.describe_hanging_step() == ""


def test_patience_is_longer_in_the_first_step_and_missing_nodes_are_named():
    bench = Bench(Node(present=("/a", "/recorder")))
    bench.now = 100.0  # the time before the first step does not count
    bench.source.begin(SECOND)
    bench.acknowledge(SECOND, "/a", "/recorder")
    bench.now = 130.0
    assert bench.source.describe_hanging_step() == ""
    bench.now = 130.1
    text = bench.source.describe_hanging_step()
    for part in ("step 0", "30 s (start_timeout)", "/b (never answered)", "not in the graph: /b"):
        assert part in text
    bench.acknowledge(SECOND, "/b")
    bench.node.present = ("/a", "/b", "/recorder")
    bench.source.begin(2 * SECOND)
    bench.acknowledge(2 * SECOND, "/a")
    bench.now = 135.1
    assert bench.source.describe_hanging_step() == ""
    bench.now = 135.2
    text = bench.source.describe_hanging_step()
    for part in ("step 1 ", "5 s (step_timeout)", "/b (last did step 0)"):
        assert part in text
    assert "not in the graph" not in text


def test_a_complete_step_never_hangs():
    bench = Bench()
    bench.source.begin(SECOND)
    bench.acknowledge(SECOND, "/a", "/b", "/recorder")
    bench.now = 1e6
    assert bench.source.describe_hanging_step() == ""


@pytest.mark.parametrize("lockstep", [True, False])
def test_a_zero_stamp_reports_that_a_node_is_ready(lockstep):
    bench = Bench(Node(lockstep, present=("/b",)), preparing=["/a", "/b", "/c"])
    assert bench.node.subscriptions == [(StepDone, "/sim/step_done", True)]
    bench.acknowledge(0, "/a", "/stranger")
    assert bench.source.unprepared == {"/b", "/c"}
    text = bench.source.describe_unprepared_nodes()
    for part in ("30 s (start_timeout)", "/b did not report ready", "/c is not in the graph"):
        assert part in text
    assert bench.acknowledged == 0


def test_without_lockstep_steps_are_counted_but_not_acknowledged():
    bench = Bench(Node(lockstep=False))
    assert bench.node.subscriptions == []
    bench.source.begin(SECOND)
    bench.acknowledge(SECOND, "/a")
    assert (bench.source.step, bench.acknowledged) == (0, 0)


def test_steps_without_participants_leave_the_executor_its_turn():
    bench = Bench(parameters=StepSourceParameters())
    bench.source.begin(SECOND)
    begun = []

    def begin_next():
        begun.append(bench.source.step)
        bench.source.begin((2 + len(begun)) * SECOND)

    bench.source.advance(begin_next)
    assert begun == list(range(STEPS_AT_ONCE))
    bench.node.finished = True
    bench.source.advance(begin_next)
    assert len(begun) == STEPS_AT_ONCE


def test_advance_begins_one_step_and_then_waits_for_it():
    bench = Bench(parameters=dataclasses.replace(PARAMETERS, lockstep_side_branches=[]))
    bench.source.begin(SECOND)
    begun = []

    def begin_next():
        begun.append(bench.source.step)
        bench.source.begin(2 * SECOND)

    bench.source.advance(begin_next)
    assert begun == []
    bench.acknowledge(SECOND, "/a", "/b")
    bench.source.advance(begin_next)
    assert begun == [0]
