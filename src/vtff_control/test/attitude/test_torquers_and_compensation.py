"""Pulses within their limits, allocation along the field, and the paper's compensation."""

from __future__ import annotations

import numpy as np
import pytest

from vtff_control.attitude.compensation import (
    PAPER_COMPENSATION_FINAL,
    PAPER_COMPENSATION_FIRST,
    check_compensation,
    compensate_dipole,
)
from vtff_control.attitude.torquers import TorquerLimits, shift_along_field

LIMITS = TorquerLimits()


def test_pulses_of_the_paper():
    """0.8 s, 1.6 s and 4.4 s against (13), of which 4 s remain (steps of 10 ms)."""
    steps = LIMITS.pulse_steps(np.array([-0.02, -0.04, 0.11]))
    assert steps == (-79, -157, 400)
    assert LIMITS.largest_mean_moment == pytest.approx(0.1016)
    np.testing.assert_allclose(LIMITS.mean_moment(steps), [-0.02, -0.04, 0.1016], atol=1.3e-4)


def test_no_moment_is_beyond_duty_or_window():
    generator = np.random.default_rng(1)
    for moment in generator.normal(0.0, 0.2, (200, 3)):
        steps = np.array(LIMITS.pulse_steps(moment))
        assert np.abs(steps).max() <= 400
        reachable = np.abs(moment) <= LIMITS.largest_mean_moment
        error = np.abs(LIMITS.mean_moment(tuple(steps)) - moment)[reachable]
        assert (error <= 0.5001 * 0.127 * 0.01 / 5.0).all()
    assert LIMITS.pulse_steps(np.full(3, 1.0), longest=0.5) == (50, 50, 50)


def test_shift_along_the_field_keeps_the_torque_and_frees_the_axis():
    field = np.array([20e-6, 1e-6, 25e-6])
    moment = np.array([0.02, -0.04, 0.12])
    shifted = shift_along_field(moment, field, 0.1016)
    np.testing.assert_allclose(np.cross(shifted, field), np.cross(moment, field), atol=1e-15)
    assert np.abs(shifted).max() <= 0.1016 + 1e-12
    generator = np.random.default_rng(2)
    for _ in range(200):
        field, moment = generator.standard_normal(3), 0.1 * generator.standard_normal(3)
        shifted = shift_along_field(moment, field, 0.1016)
        np.testing.assert_allclose(np.cross(shifted, field), np.cross(moment, field), atol=1e-12)
        line = moment + np.linspace(-0.5, 0.5, 2001)[:, None] * field / np.linalg.norm(field)
        assert np.abs(shifted).max() <= max(0.1016, np.abs(line).max(axis=1).min()) + 1e-9
    inside = np.array([0.05, 0.0, 0.0])
    assert shift_along_field(inside, field, 0.1016) is inside


def test_compensation_of_the_paper_and_beyond_the_torquers():
    final = compensate_dipole(np.array([0.034, 0.036, -0.12]), LIMITS)
    np.testing.assert_allclose(final.moment, PAPER_COMPENSATION_FINAL, atol=0.002)
    np.testing.assert_allclose(final.residual, [0.0, 0.0, -0.0184], atol=1e-9)
    assert final.reason == "dipole beyond the torquers (0.1016 A m2): z -0.120 A m2"
    assert not compensate_dipole(np.array([0.034, 0.036, -0.1]), LIMITS).reason
    np.testing.assert_allclose(
        check_compensation("fixed_compensation", PAPER_COMPENSATION_FIRST, LIMITS),
        [-0.041, -0.015, 0.1],
    )
    with pytest.raises(ValueError, match=r"fixed_compensation: .*at most 0.1016 A m2") as caught:
        check_compensation("fixed_compensation", (0.0, 0.0, 0.12), LIMITS)
    assert "\n" not in str(caught.value)


def test_bad_limits_are_refused():
    with pytest.raises(ValueError, match="quiet_window: expected 0 or more and less"):
        TorquerLimits(quiet_window=5.0)
    with pytest.raises(ValueError, match="moment: expected a positive"):
        TorquerLimits(moment=0.0)
