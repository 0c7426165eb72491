"""A thruster is believed as far as navigation agrees."""

import numpy as np
import pytest
from safety_samples import CHIEF, relative

from vtff_control.safety.thrust_monitor import ThrustMonitor, accused_axes, describe_fault
from vtff_dynamics.frames.rtn import deputy_state_gcrf, relative_state_rtn, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.free_flight import free_flight


def fly(monitor, seconds, thrust, reported, sigma=1e-4, seed=1, step=1.0):
    """Return the step of the first difference, and it; thrust and reports are by the step."""
    generator = np.random.default_rng(seed)
    states = np.array([CHIEF, deputy_state_gcrf(CHIEF, relative(t=100.0))])
    covariance = np.diag([(100.0 * sigma) ** 2] * 3 + [sigma**2] * 3)
    before = np.zeros(3)
    for second in range(seconds):
        state = relative_state_rtn(*states)
        state[3:] += sigma * generator.standard_normal(3)
        found = monitor.update(states[0], state, covariance, before)
        if found is not None:
            return second, found
        before = np.asarray(reported(second), dtype=float)
        push = rotation_gcrf_to_rtn(states[0]).T @ np.asarray(thrust(second), dtype=float)
        states = free_flight(states, [0.0, step])[-1]
        states[1] += np.concatenate((0.5 * step**2 * push, step * push))
    return None, None


def text_of(found):
    return describe_fault(found.axes, found.residual, found.reported, float(found.age))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("size", [0.07, -1.4])
def test_stuck_on_is_seen_within_two_seconds(axis, size):
    push = np.zeros(3)
    push[axis] = size
    second, found = fly(
        ThrustMonitor(1.4), 60, lambda s: push if s >= 20 else np.zeros(3), lambda s: np.zeros(3)
    )
    assert second - 20 <= 2
    assert found.axes.tolist() == [index == axis for index in range(3)]
    assert f"stuck on along {'RTN'[axis]}" in text_of(found)


def test_small_push_is_seen_later():
    second, found = fly(ThrustMonitor(1.4), 60, lambda s: (0.0, 3e-3, 0.0), lambda s: np.zeros(3))
    assert 5 < second <= 22
    assert "stuck on" in text_of(found)


def test_stuck_off_is_seen():
    second, found = fly(
        ThrustMonitor(1.4),
        60,
        lambda s: np.zeros(3),
        lambda s: (0.0, 0.5, 0.0) if s >= 20 else np.zeros(3),
    )
    assert second - 20 <= 2
    assert "stuck off" in text_of(found)


T5_CAP = 25e-3 / 1600.0  # m/s2 an axis


@pytest.mark.parametrize("step", [1.0, 10.0])
@pytest.mark.parametrize("sigma", [3e-5, 1e-4])
def test_a_weak_engine_stuck_on_is_seen_by_navigation(step, sigma):
    """Seen as soon as the push exceeds floor and 7 sigma of both ends, a step or two later."""
    healthy, stuck = round(200.0 / step), round(200.0 / step)
    last, found = fly(
        ThrustMonitor(T5_CAP, step),
        healthy + stuck,
        lambda s: (0.0, T5_CAP if s >= healthy else 0.0, 0.0),
        lambda s: np.zeros(3),
        sigma,
        step=step,
    )
    visible = (2e-4 + 7.0 * np.sqrt(2.0) * sigma) / T5_CAP
    assert last is not None
    assert (last - healthy) * step <= 1.3 * visible + 3.0 * step
    assert found.axes.tolist() == [False, True, False]


def test_a_weak_engine_that_says_what_it_does_is_left_alone():
    """5 % too strong and 3 deg off, steps of 1 s, ten minutes with bursts of a minute."""

    def reported(second):
        return (0.0, T5_CAP, -0.5 * T5_CAP) if second % 120 < 60 else (0.0, 0.0, 0.0)

    def thrust(second):
        return 1.05 * np.array(reported(second)) + 0.05 * np.array(reported(second))[[1, 2, 0]]

    monitor = ThrustMonitor(T5_CAP)
    assert fly(monitor, 600, thrust, reported, sigma=5e-5) == (None, None)


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


def formation_monitors(thrusts, reports, seconds=40, sigma=1e-4, seed=3):
    """Fly a chief and deputies; return what is found first, by deputy, and the monitors.

    Thrust and reports by spacecraft, the chief first; the states are flown in GCRF, each by itself.
    """
    generator = np.random.default_rng(seed)
    offsets = [relative(t=100.0), relative(t=-150.0), relative(n=80.0)][: len(thrusts) - 1]
    states = np.array([CHIEF, *(deputy_state_gcrf(CHIEF, offset) for offset in offsets)])
    monitors = [ThrustMonitor(1.4) for _ in offsets]
    covariance = np.diag([(100.0 * sigma) ** 2] * 3 + [sigma**2] * 3)
    for second in range(seconds):
        found = {}
        for index, monitor in enumerate(monitors):
            state = relative_state_rtn(states[0], states[index + 1])
            state[3:] += sigma * generator.standard_normal(3)
            difference = monitor.update(
                states[0],
                state,
                covariance,
                np.asarray(reports[index + 1], dtype=float),
                reported_chief_rtn=np.asarray(reports[0], dtype=float),
            )
            if difference is not None:
                found[index] = difference
        if found:
            return second, found, monitors
        pushes = np.asarray(thrusts, dtype=float) @ rotation_gcrf_to_rtn(states[0])
        states = free_flight(states, [0.0, 1.0])[-1]
        states += np.concatenate((0.5 * pushes, pushes), axis=1)
    return None, {}, monitors


OFF = (0.0, 0.0, 0.0)
PUSH = (0.0, 0.3, -0.1)


def test_what_the_chief_reports_is_no_fault_of_the_deputies():
    _, found, _ = formation_monitors([PUSH, OFF, OFF], [PUSH, OFF, OFF])
    assert not found
    # All thrust, each another way.
    thrusts = [PUSH, (0.5, 0.0, 0.2), (-1.0, 1.4, 0.0), (0.0, 0.0, 1.4)]
    assert not formation_monitors(thrusts, thrusts)[1]


@pytest.mark.parametrize("deputies", [2, 3])
def test_all_deputies_see_a_push_of_the_chief(deputies):
    thrusts = [(0.0, -0.4, 0.0), *[OFF] * deputies]
    second, found, monitors = formation_monitors(thrusts, [OFF] * (deputies + 1))
    assert second <= 2
    for index, difference in found.items():
        others = [monitor for number, monitor in enumerate(monitors) if number != index]
        deputy, chief = accused_axes(difference, others)
        assert not deputy.any()
        assert chief.tolist() == [False, True, False]


@pytest.mark.parametrize("deputies", [2, 3])
def test_one_deputy_sees_its_own_push(deputies):
    # The chief thrusts and says so.
    thrusts = [PUSH, (0.0, 0.4, 0.0), *[OFF] * (deputies - 1)]
    reports = [PUSH, *[OFF] * deputies]
    second, found, monitors = formation_monitors(thrusts, reports)
    assert second <= 2
    assert list(found) == [0]
    deputy, chief = accused_axes(found[0], monitors[1:])
    assert deputy.tolist() == [False, True, False]
    assert not chief.any()


def test_without_a_second_deputy_both_are_accused():
    _, found, _ = formation_monitors([(0.0, -0.4, 0.0), OFF], [OFF, OFF])
    deputy, chief = accused_axes(found[0], [])
    assert deputy.tolist() == chief.tolist() == [False, True, False]
