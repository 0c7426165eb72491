"""Thrusts that were told, as the attitude filter takes them over a period."""

from __future__ import annotations

import numpy as np
import pytest

from vtff_nav.attitude.thrust_memory import ThrustMemory

SECOND = 10**9
START = 1_458_521_983 * SECOND
MASS = 6.5


def told(count: int, step: float = 1.0) -> ThrustMemory:
    """Return a memory of steps from START on; thrust `number` is (number + 1, 0, 0) m/s2."""
    memory = ThrustMemory(MASS, step)
    for number in range(count):
        memory.add(START + round(number * step * SECOND), np.array([number + 1.0, 0.0, 0.0]))
    return memory


@pytest.mark.parametrize("step", [1.0, 0.5, 0.1])
def test_forces_of_a_period_are_those_of_its_steps_in_the_order_of_time(step):
    memory, steps = told(60, step), round(2.0 / step)
    forces = memory.forces(START + 2 * SECOND, START + 4 * SECOND)
    assert forces.shape == (steps, 3)
    np.testing.assert_allclose(forces[:, 0], MASS * (steps + 1.0 + np.arange(steps)))
    assert not forces[:, 1:].any()


def test_thrusts_may_come_in_any_order_and_the_last_word_on_a_step_counts():
    memory = ThrustMemory(MASS, 1.0)
    for number in (2, 0, 1):
        memory.add(START + number * SECOND, np.full(3, float(number)))
    memory.add(START + SECOND, np.full(3, -1.0))
    np.testing.assert_array_equal(
        memory.forces(START, START + 3 * SECOND), MASS * np.outer([0.0, -1.0, 2.0], np.ones(3))
    )


def test_a_period_is_told_once_its_last_step_is():
    memory = told(5)
    assert memory.reaches(START + 5 * SECOND)
    assert not memory.reaches(START + 6 * SECOND)
    assert not ThrustMemory(MASS, 1.0).reaches(START)


def test_a_step_that_was_not_told_is_one_without_thrust():
    memory = told(5)
    np.testing.assert_array_equal(
        memory.forces(START + 3 * SECOND, START + 7 * SECOND)[:, 0], MASS * np.array([4, 5, 0, 0])
    )
    np.testing.assert_array_equal(memory.forces(START, START), np.zeros((1, 3)))


@pytest.mark.parametrize("thrust", [[np.nan, 0.0, 0.0], [np.inf, 0.0, 0.0], [1.0, 2.0]])
def test_what_is_no_thrust_is_not_told(thrust):
    memory = ThrustMemory(MASS, 1.0)
    memory.add(START, np.array(thrust))
    assert not memory.reaches(START + SECOND)


def test_what_is_kept_does_not_change_with_the_array_that_was_given():
    memory, thrust = ThrustMemory(MASS, 1.0), np.ones(3)
    memory.add(START, thrust)
    thrust[:] = 7.0
    np.testing.assert_array_equal(memory.forces(START, START + SECOND), np.full((1, 3), MASS))


def test_a_long_flight_keeps_its_last_minutes_and_no_more():
    memory = told(5000)
    forces = memory.forces(START, START + 5000 * SECOND)
    kept = np.flatnonzero(forces[:, 0])
    assert 100 <= len(kept) <= 300 and kept[-1] == 4999
    np.testing.assert_array_equal(np.diff(kept), 1)
