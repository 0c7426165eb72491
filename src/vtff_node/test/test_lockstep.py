"""StepCoordinator: when a step is complete."""

from __future__ import annotations

import random

from hypothesis import given
from hypothesis import strategies as st

from vtff_node.lockstep import StepCoordinator

SECOND = 1_000_000_000


def test_step_completes_when_every_participant_has_answered():
    coordinator = StepCoordinator(["/a", "/b"])
    coordinator.begin(0)
    assert not coordinator.complete
    assert not coordinator.acknowledge("/a", 0)
    assert coordinator.missing() == {"/b": -1}
    assert coordinator.acknowledge("/b", 0)
    assert coordinator.complete


def test_no_participants_never_wait():
    coordinator = StepCoordinator([])
    coordinator.begin(0)
    assert coordinator.complete


def test_unknown_nodes_stamps_and_repetitions_change_nothing():
    coordinator = StepCoordinator(["/a"])
    coordinator.begin(0)
    assert not coordinator.acknowledge("/stranger", 0)
    assert not coordinator.acknowledge("/a", 5)
    assert coordinator.acknowledge("/a", 0)
    assert not coordinator.acknowledge("/a", 0)
    coordinator.begin(SECOND)
    assert not coordinator.acknowledge("/a", 0)
    assert coordinator.missing() == {"/a": 0}


def test_side_branch_must_see_the_first_step_and_may_then_lag():
    coordinator = StepCoordinator([], ["/recorder"], maximum_lag=3)
    coordinator.begin(0)
    assert not coordinator.complete
    assert coordinator.acknowledge("/recorder", 0)
    for step in range(1, 4):
        coordinator.begin(step * SECOND)
        assert coordinator.complete
    coordinator.begin(4 * SECOND)
    assert coordinator.missing() == {"/recorder": 0}
    # Catching up by one step is enough to go on.
    assert coordinator.acknowledge("/recorder", 1 * SECOND)


@given(st.integers(1, 5), st.integers(1, 40), st.randoms())
def test_any_order_of_answers_completes_each_step_exactly_once(count, steps, random_source):
    names = [f"/n{number}" for number in range(count)]
    coordinator = StepCoordinator(names)
    for step in range(steps):
        coordinator.begin(step * SECOND)
        order = list(names)
        random.Random(random_source.random()).shuffle(order)
        completions = [coordinator.acknowledge(name, step * SECOND) for name in order]
        assert completions == [False] * (count - 1) + [True]


def test_memory_is_bounded():
    coordinator = StepCoordinator(["/a"])
    for step in range(20_000):
        coordinator.begin(step)
        assert coordinator.acknowledge("/a", step)
    assert len(coordinator._steps) <= 4097
