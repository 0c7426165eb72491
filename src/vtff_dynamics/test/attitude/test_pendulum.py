"""The swing of a dipole in the field, against an integration of its motion."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from vtff_dynamics.attitude.pendulum import swing_peak

INERTIA, DIPOLE = 0.058, 0.2


def test_from_rest_it_is_the_formula_of_the_paper():
    field = np.array([0.0, 0.0, 32.5e-6])
    rate = 1.9e-4 * 3.0 / INERTIA
    peak = swing_peak(np.array([0.0, 0.0, 1.0]), np.array([0.0, rate, 0.0]), field, DIPOLE, INERTIA)
    frequency = math.sqrt(32.5e-6 * DIPOLE / INERTIA)
    assert peak == pytest.approx(2.0 * math.asin(rate / 2.0 / frequency), abs=1e-9)
    assert math.degrees(peak) == pytest.approx(55.3, abs=0.1)


@pytest.mark.parametrize("seed", range(8))
def test_any_start_peaks_where_its_integrated_motion_does(seed):
    generator = np.random.default_rng(seed)
    field = 3e-5 * generator.standard_normal(3)
    direction = field / np.linalg.norm(field) + 0.4 * generator.standard_normal(3)
    direction /= np.linalg.norm(direction)
    rate = 0.006 * generator.standard_normal(3)
    rate -= direction * (rate @ direction)  # a spin about the dipole is not part of the pendulum

    def motion(_, values):
        dipole, turn = values[:3], values[3:]
        return np.concatenate((np.cross(turn, dipole), DIPOLE * np.cross(dipole, field) / INERTIA))

    flown = solve_ivp(
        motion, (0.0, 3000.0), np.concatenate((direction, rate)),
        rtol=1e-9, atol=1e-12, max_step=5.0,
    )  # fmt: skip
    cosine = flown.y[:3].T @ field / np.linalg.norm(field)
    angle = math.acos(float(np.clip(cosine.min(), -1.0, 1.0)))
    assert swing_peak(direction, rate, field, DIPOLE, INERTIA) == pytest.approx(angle, abs=2e-3)
