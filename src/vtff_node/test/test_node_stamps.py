"""Stamps are exact integers."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")
from hypothesis import given  # noqa: E402
from hypothesis import strategies as st  # noqa: E402

from vtff_node.stamps import to_nanoseconds, to_stamp  # noqa: E402


@given(st.integers(-(2**31) * 10**9, (2**31 - 1) * 10**9 + 999_999_999))
def test_round_trip_is_exact(nanoseconds):
    assert to_nanoseconds(to_stamp(nanoseconds)) == nanoseconds


def test_times_after_2038_are_refused():
    with pytest.raises(ValueError, match="2038"):
        to_stamp(2**31 * 10**9)
