"""Steering of the receiver clock: exact motion between the commands of two seconds."""

from __future__ import annotations

import numpy as np
import pytest

from vtff_sim_bridge.gnss.receiver_clock import ClockModel, ReceiverClock

TIMES = np.arange(1, 21) / 20.0


def steered_clock(frequency: float) -> ReceiverClock:
    """Return a clock without noise, a microsecond fast and with a drift."""
    model = ClockModel(
        oscillator="perfect",
        initial_offset=1e-6,
        initial_drift=3e-7,
        is_steered=True,
        steering_frequency=frequency,
        steering_sigma=0.0,
    )
    return ReceiverClock(model, seed=1, receiver=1)


@pytest.mark.parametrize("frequency", [0.1, 0.5])
def test_steering_is_a_constant_acceleration_within_a_second(frequency):
    clock = steered_clock(frequency)
    offset, drift = 1e-6, 3e-7
    for second in (1, 2, 3):
        acceleration = -frequency * (frequency * offset + 2.0 * drift)
        offsets, drifts = clock.second(second)
        expected = offset + drift * TIMES + 0.5 * acceleration * TIMES**2
        np.testing.assert_allclose(offsets, expected, rtol=1e-12)
        # The drift is the mean over the 0.05 s before each epoch.
        steps = np.diff(np.concatenate(([offset], expected)))
        np.testing.assert_allclose(drifts, 20.0 * steps, rtol=0.0, atol=1e-18)
        offset, drift = expected[-1], drift + acceleration


def test_steering_takes_offset_and_drift_away():
    offsets, drifts = steered_clock(0.5).second(60)
    assert abs(offsets).max() < 1e-12 and abs(drifts).max() < 1e-12
