"""ThrustBuffer: which thrust acts in a step, in lockstep and in real time."""

from __future__ import annotations

import numpy as np
import pytest

from vtff_sim_bridge.bridge.thrust_buffer import STALE_AFTER_STEPS, ThrustBuffer

STEP = 0.5  # s
STEP_NANOSECONDS = 500_000_000
START = 1_800_000_000 * 1_000_000_000
THRUST = (0.1, -0.2, 0.3)


def stamp(step: int) -> int:
    return START + step * STEP_NANOSECONDS


@pytest.mark.parametrize("exactly", [True, False])
def test_the_thrust_of_the_step_acts(exactly):
    buffer = ThrustBuffer(STEP)
    buffer.add(stamp(1), THRUST)
    buffer.add(stamp(2), (1.0, 1.0, 1.0))
    np.testing.assert_array_equal(buffer.starting_at(stamp(1), exactly=exactly), THRUST)
    np.testing.assert_array_equal(buffer.starting_at(stamp(2), exactly=exactly), np.ones(3))
    assert (buffer.received, buffer.late) == (2, 0)


def test_lockstep_takes_no_thrust_of_another_step():
    buffer = ThrustBuffer(STEP)
    buffer.add(stamp(0), THRUST)
    buffer.add(stamp(2), THRUST)
    assert buffer.starting_at(stamp(1), exactly=True) is None
    assert buffer.late == 0


def test_real_time_repeats_the_newest_thrust_until_it_is_stale():
    buffer = ThrustBuffer(STEP)
    buffer.add(stamp(0), (9.0, 9.0, 9.0))
    buffer.add(stamp(1), THRUST)
    for step in range(1, 1 + STALE_AFTER_STEPS + 1):  # the step itself and the last fresh one
        np.testing.assert_array_equal(buffer.starting_at(stamp(step), exactly=False), THRUST)
    assert buffer.late == STALE_AFTER_STEPS
    assert buffer.starting_at(stamp(2 + STALE_AFTER_STEPS), exactly=False) is None
    assert buffer.late == STALE_AFTER_STEPS + 1


@pytest.mark.parametrize("nanoseconds_after", [0, 1])
def test_the_limit_itself_is_still_fresh(nanoseconds_after):
    buffer = ThrustBuffer(STEP)
    buffer.add(START, THRUST)
    limit = START + STALE_AFTER_STEPS * STEP_NANOSECONDS
    thrust = buffer.starting_at(limit + nanoseconds_after, exactly=False)
    assert (thrust is None) == bool(nanoseconds_after)
    assert (buffer.received, buffer.late) == (1, 1)


def test_real_time_takes_no_thrust_that_starts_later():
    buffer = ThrustBuffer(STEP)
    buffer.add(stamp(3), THRUST)
    assert buffer.starting_at(stamp(2), exactly=False) is None
    np.testing.assert_array_equal(buffer.starting_at(stamp(3), exactly=False), THRUST)


def test_a_step_before_the_first_message_is_not_late():
    buffer = ThrustBuffer(STEP)
    assert buffer.starting_at(stamp(0), exactly=False) is None
    assert (buffer.received, buffer.late) == (0, 0)


def test_a_thrust_at_the_limit_is_kept_for_the_next_look():
    """Forgetting must not be stricter than the limit: the same step may be looked at twice."""
    buffer = ThrustBuffer(STEP)
    buffer.add(START, THRUST)
    limit = START + STALE_AFTER_STEPS * STEP_NANOSECONDS
    for _ in range(2):
        np.testing.assert_array_equal(buffer.starting_at(limit, exactly=False), THRUST)


def test_a_thrust_that_is_sent_again_replaces_the_first():
    buffer = ThrustBuffer(STEP)
    buffer.add(stamp(1), (9.0, 9.0, 9.0))
    buffer.add(stamp(1), THRUST)
    np.testing.assert_array_equal(buffer.starting_at(stamp(1), exactly=True), THRUST)
    assert buffer.received == 2


def test_old_thrust_is_forgotten():
    """Time that jumps back finds no thrust of before: it was forgotten when it became stale."""
    buffer = ThrustBuffer(STEP)
    buffer.add(stamp(0), THRUST)
    buffer.starting_at(stamp(10), exactly=True)
    assert buffer.starting_at(stamp(0), exactly=True) is None
