"""Stamps are exact integers."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")
from hypothesis import given  # noqa: E402
from hypothesis import strategies as st  # noqa: E402

from vtff_dynamics.constants import NANOSECONDS_PER_SECOND  # noqa: E402
from vtff_node.stamps import StampOrder, to_nanoseconds, to_stamp  # noqa: E402


@given(st.integers(-(2**31) * 10**9, (2**31 - 1) * 10**9 + 999_999_999))
def test_round_trip_is_exact(nanoseconds):
    assert to_nanoseconds(to_stamp(nanoseconds)) == nanoseconds


def test_times_after_2038_are_refused():
    with pytest.raises(ValueError, match="2038"):
        to_stamp(2**31 * 10**9)


def test_each_stamp_is_accepted_once_and_in_order():
    order = StampOrder()
    accepted = [order.accepts(second * NANOSECONDS_PER_SECOND) for second in (0, 1, 1, 3, 2, 4)]
    assert accepted == [True, True, False, True, False, True]
    assert order.refused == 2
    assert order.refused_since_last_look()
    assert not order.refused_since_last_look()


def test_a_jump_far_back_starts_anew():
    order = StampOrder()
    assert order.accepts(1000 * NANOSECONDS_PER_SECOND)
    assert order.accepts(900 * NANOSECONDS_PER_SECOND)
    assert not order.accepts(900 * NANOSECONDS_PER_SECOND)
    assert order.accepts(901 * NANOSECONDS_PER_SECOND)
