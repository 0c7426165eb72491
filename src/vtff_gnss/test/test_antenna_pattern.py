"""Antenna patterns."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from vtff_gnss.antenna_pattern import ParabolicPattern, parabolic_gain_db


def gains_db(pattern: ParabolicPattern, off_boresight) -> np.ndarray:
    """Return the gains at angles from boresight, rad."""
    settings = dataclasses.astuple(pattern)
    return np.array([parabolic_gain_db(float(angle), *settings) for angle in off_boresight])


def test_half_power_is_half_the_beamwidth_off_boresight():
    pattern = ParabolicPattern(3.0, np.radians(80.0), 25.0)
    gains = gains_db(pattern, [0.0, np.radians(40.0), np.radians(80.0), np.pi])
    assert gains == pytest.approx([3.0, 0.0, -9.0, -22.0])


def test_default_is_a_hemispherical_patch():
    gains = gains_db(ParabolicPattern(), np.radians([0.0, 90.0, 180.0]))
    assert gains[0] == 5.0
    assert -4.5 < gains[1] < -3.5
    assert gains[2] == -15.0
    assert np.all(np.diff(gains_db(ParabolicPattern(), np.linspace(0, np.pi, 50))) <= 0.0)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: ParabolicPattern(half_power_beamwidth=0.0), "half_power_beamwidth 0.0"),
        (lambda: ParabolicPattern(front_to_back_db=-1.0), "front_to_back_db -1.0"),
    ],
)
def test_impossible_patterns_are_refused(make, text):
    with pytest.raises(ValueError, match=text):
        make()
