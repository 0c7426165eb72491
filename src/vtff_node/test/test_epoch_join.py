"""Epochs of several sources: joined by stamp, in order, whatever arrives late or never."""

from __future__ import annotations

import random

import pytest

from vtff_node.epoch_join import EpochJoin


def taken(join, now):
    found = []
    while (epoch := join.take(now)) is not None:
        found.append((epoch.stamp_nanoseconds, epoch.measured))
    return found


def test_an_epoch_is_complete_when_all_sources_have_it():
    join = EpochJoin(["chief", "deputy"], patience=0.3)
    join.add("chief", 1, "c1", 0.0)
    assert not taken(join, 0.1)
    join.add("deputy", 1, "d1", 0.1)
    assert taken(join, 0.1) == [(1, {"chief": "c1", "deputy": "d1"})]
    assert not taken(join, 9.0)


def test_a_source_that_is_already_further_is_not_waited_for():
    join = EpochJoin(["chief", "deputy"], patience=1e9)
    join.add("chief", 1, "c1", 0.0)
    join.add("deputy", 2, "d2", 0.0)
    join.add("chief", 2, "c2", 0.0)
    assert [stamp for stamp, _ in taken(join, 0.0)] == [1, 2]
    assert join.incomplete == {"chief": 0, "deputy": 1}


def test_patience_ends_and_a_late_measurement_is_counted():
    join = EpochJoin(["chief", "deputy"], patience=0.3)
    join.add("chief", 1, "c1", 0.0)
    assert not taken(join, 0.29)
    assert taken(join, 0.31) == [(1, {"chief": "c1"})]
    join.add("deputy", 1, "d1", 0.4)
    assert not taken(join, 9.0)
    assert join.late == 1


def test_an_expected_epoch_without_any_measurement_is_given_too():
    join = EpochJoin(["chief", "deputy"], patience=0.3)
    join.expect(5, 0.0)
    assert taken(join, 0.4) == [(5, {})]


def test_closing_starts_the_patience():
    join = EpochJoin(["chief", "deputy"], patience=0.05, waits_for_closing=True)
    join.expect(1, 0.0)
    join.add("chief", 1, "c1", 0.0)
    assert not taken(join, 1e6)
    join.close("deputy", 1, 100.0)
    assert not taken(join, 100.04)
    assert taken(join, 100.06) == [(1, {"chief": "c1"})]


def test_a_measurement_that_its_closing_overtook_is_used():
    join = EpochJoin(["chief", "deputy"], patience=0.05, waits_for_closing=True)
    join.add("chief", 1, "c1", 0.0)
    join.close("deputy", 1, 0.0)
    assert not taken(join, 0.01)
    join.add("deputy", 1, "d1", 0.02)
    assert taken(join, 0.02) == [(1, {"chief": "c1", "deputy": "d1"})]


def test_time_may_start_anew():
    join = EpochJoin(["chief"], patience=0.1)
    join.add("chief", 100, "c", 0.0)
    assert taken(join, 0.0)
    join.restart()
    join.add("chief", 1, "c1", 0.0)
    assert taken(join, 0.0) == [(1, {"chief": "c1"})]


@pytest.mark.parametrize("seed", range(20))
def test_in_lockstep_the_order_of_arrival_changes_nothing(seed):
    """Chief and deputy of a step in any order, some missing, closings anywhere behind /clock."""
    order = random.Random(seed)
    join = EpochJoin(["chief", "deputy"], patience=0.05, waits_for_closing=True)
    now, found = 0.0, []
    for stamp in range(1, 40):
        join.expect(stamp, now)
        events = [("close", "chief"), ("close", "deputy"), ("add", "chief")]
        if stamp % 7:
            events.append(("add", "deputy"))
        order.shuffle(events)
        for kind, name in events:
            now += order.uniform(0.0, 0.01)
            if kind == "add":
                join.add(name, stamp, f"{name}{stamp}", now)
            else:
                join.close(name, stamp, now)
            found += taken(join, now)
        found += taken(join, now := now + 0.06)
    expected = [
        (s, {"chief": f"chief{s}"} | ({"deputy": f"deputy{s}"} if s % 7 else {}))
        for s in range(1, 40)
    ]
    assert found == expected
    assert join.late == 0
