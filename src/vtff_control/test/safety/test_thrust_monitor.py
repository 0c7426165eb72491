"""A thruster is believed as far as navigation agrees."""

import numpy as np
import pytest
from safety_samples import CHIEF, relative

from vtff_control.safety.thrust_monitor import ThrustMonitor
from vtff_dynamics.frames.rtn import deputy_state_gcrf, relative_state_rtn, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.free_flight import free_flight


def fly(monitor, seconds, thrust, reported, sigma=1e-4, seed=1):
    """Return the first fault and its second; thrust and reports are functions of the second."""
    generator = np.random.default_rng(seed)
    states = np.array([CHIEF, deputy_state_gcrf(CHIEF, relative(t=100.0))])
    covariance = np.diag([(100.0 * sigma) ** 2] * 3 + [sigma**2] * 3)
    before = np.zeros(3)
    for second in range(seconds):
        state = relative_state_rtn(*states)
        state[3:] += sigma * generator.standard_normal(3)
        fault = monitor.update(states[0], state, covariance, before)
        if fault is not None:
            return second, fault
        before = np.asarray(reported(second), dtype=float)
        push = rotation_gcrf_to_rtn(states[0]).T @ np.asarray(thrust(second), dtype=float)
        states = free_flight(states, [0.0, 1.0])[-1]
        states[1] += np.concatenate((0.5 * push, push))
    return None, None


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("size", [0.07, -1.4])
def test_stuck_on_is_seen_within_two_seconds(axis, size):
    push = np.zeros(3)
    push[axis] = size
    second, fault = fly(
        ThrustMonitor(1.4), 60, lambda s: push if s >= 20 else np.zeros(3), lambda s: np.zeros(3)
    )
    assert second - 20 <= 2
    assert fault.is_stuck_on
    assert fault.axes.tolist() == [index == axis for index in range(3)]
    assert f"stuck on along {'RTN'[axis]}" in fault.text


def test_small_push_is_seen_later():
    second, fault = fly(ThrustMonitor(1.4), 60, lambda s: (0.0, 3e-3, 0.0), lambda s: np.zeros(3))
    assert 5 < second <= 22
    assert fault.is_stuck_on


def test_stuck_off_is_seen():
    second, fault = fly(
        ThrustMonitor(1.4),
        60,
        lambda s: np.zeros(3),
        lambda s: (0.0, 0.5, 0.0) if s >= 20 else np.zeros(3),
    )
    assert second - 20 <= 2
    assert not fault.is_stuck_on
    assert "stuck off" in fault.text


def test_a_healthy_thruster_is_left_alone():
    """5 % too strong, 3 deg off, navigation of 1 mm/s, bursts and pauses for five minutes."""
    turn = np.radians(3.0)

    def reported(second):
        return (0.9, -1.4, 0.3) if second % 50 < 20 else (0.0, 0.0, 0.0)

    def thrust(second):
        r, t, n = reported(second)
        return 1.05 * np.array(
            [r * np.cos(turn) - t * np.sin(turn), r * np.sin(turn) + t * np.cos(turn), n]
        )

    assert fly(ThrustMonitor(1.4), 300, thrust, reported, sigma=1e-3) == (None, None)


def test_after_a_reset_the_past_does_not_count():
    monitor = ThrustMonitor(1.4)
    fly(monitor, 30, lambda s: np.zeros(3), lambda s: np.zeros(3))
    monitor.reset()
    elsewhere = relative(t=500.0, vt=30.0)
    assert monitor.update(CHIEF, elsewhere, np.zeros((6, 6)), np.zeros(3)) is None
