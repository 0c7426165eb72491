"""Losses of lock show in the lock times of consecutive epochs."""

from __future__ import annotations

import numpy as np
import pytest
from gnss_test_support import events_of, range_frame, range_records

from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.constants import FLAG_LOCK_LOST
from vtff_gnss.novatel.range.lock_time import LockTimeTracker, lock_key

START = GpsTime.from_week_tow(2200, 345600)


def lost_of(series: list[tuple[float, float]], bound_factor: float = 1.0) -> list[bool]:
    """Return the verdict for each (time, lock time) of one signal."""
    tracker, lost = LockTimeTracker(), []
    for time, lock_time in series:
        lock = np.array([lock_time])
        zero = np.zeros(1, dtype=np.intp)
        key = lock_key(zero, zero + 5, zero)
        lost.append(bool(tracker.update(START + time, key, lock, lock * bound_factor)[0]))
    return lost


@pytest.mark.parametrize("step", [0.02, 0.05, 0.1, 1.0, 30.0])
def test_growth_with_time_is_no_loss(step):
    assert lost_of([(k * step, 7.0 + k * step) for k in range(50)]) == [False] * 50


@pytest.mark.parametrize("step", [0.05, 0.1, 1.0])
def test_lock_time_in_quanta_is_no_loss(step):
    series = [(k * step, np.floor((7.0 + k * step) * 32.0) / 32.0) for k in range(200)]
    assert not any(lost_of(series))


@pytest.mark.parametrize("step", [0.02, 0.05, 1.0])
def test_restart_is_a_loss_once(step):
    series = [(0.0, 100.0), (step, 100.0 + step), (2 * step, 0.0), (3 * step, step)]
    assert lost_of(series) == [False, False, True, False]


def test_standstill_is_a_loss():
    assert lost_of([(0.0, 5.0), (1.0, 5.0)]) == [False, True]


def test_gap_in_tracking_is_a_loss_and_gap_in_the_log_is_not():
    assert lost_of([(0.0, 50.0), (20.0, 70.0)]) == [False, False]
    assert lost_of([(0.0, 50.0), (20.0, 12.0)]) == [False, True]


def test_bound_of_a_class_of_lock_times_is_used():
    # Classes of a factor 2: no growth within a class proves nothing until its width has passed.
    assert lost_of([(0.0, 1.024), (0.5, 1.024), (1.0, 1.024)], bound_factor=2.0) == [False] * 3
    assert lost_of([(0.0, 1.024), (1.5, 1.024)], bound_factor=2.0) == [False, True]
    assert lost_of([(0.0, 1.024), (0.5, 0.128)], bound_factor=2.0) == [False, True]


def test_saturated_lock_time_is_no_loss():
    assert not any(lost_of([(0.0, 65535.97), (1.0, 65535.97)], bound_factor=np.inf))


def test_float32_lock_time_after_weeks_is_no_loss():
    series = [(0.05 * k, float(np.float32(2.0e6 + 0.05 * k))) for k in range(100)]
    assert not any(lost_of(series))


def test_each_signal_has_its_own_history():
    first, second = range_records(6), range_records(6)
    second["lock_time"] += 1.0
    second["lock_time"][4] = 0.2
    events = events_of(range_frame(first, 1000) + range_frame(second, 2000))
    lost = [(event.flags & FLAG_LOCK_LOST) > 0 for event in events]
    assert not lost[0].any()
    assert lost[1].tolist() == [False, False, False, False, True, False]
