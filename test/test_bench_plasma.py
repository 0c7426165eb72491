"""The bounds that the plasma benchmark prints, against estimates from drawn contents."""

from __future__ import annotations

import math
import pathlib

import numpy as np
import pytest
from scipy.optimize import least_squares

BENCHMARKS = pathlib.Path(__file__).resolve().parents[1] / "benchmarks"
SPEED, SEPARATION, SEGMENT = 250.0, 1.5e3, 12.0
CHANGE, CHANGE_SIGMA = 5e11, 1.5e10
HEIGHT = SPEED * np.arange(-60.0, 61.0)


@pytest.fixture
def wall_bounds(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    from plasma import wall_bounds

    return wall_bounds


def contents(parameters):
    """Contents of chief and deputy, 1e11/m3 km, of a numerical integral over their heights."""
    fine = np.linspace(HEIGHT[0], HEIGHT[-1], 20 * (len(HEIGHT) - 1) + 1)
    change, slope, width = parameters[:3]
    rows = []
    for craft in (0, 1):
        place, constant, line, curve = parameters[3 + craft], *parameters[5 + 3 * craft :][:3]
        part = np.clip((1e-3 * (fine - place)) / width + 0.5, 0.0, 1.0)
        density = change * part + slope * 1e-3 * np.maximum(fine - place, 0.0)
        total = np.concatenate(([0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))))
        column = 1e-3 * (fine[1] - fine[0]) * total[::20]
        at = HEIGHT / HEIGHT[-1]
        rows.append(column + constant + line * at + curve * at**2)
    return np.concatenate(rows)


def test_the_bound_of_a_wall_is_what_least_squares_reach(wall_bounds):
    """Sixty draws of white noise, and an integral of the density of its own."""
    generator = np.random.default_rng(1)
    width = 4.0
    true = np.array([1e-11 * CHANGE, 0.0, width, 0.0, 0.0, *[0.0] * 6])
    sigma = 1e-14 * SEPARATION * CHANGE_SIGMA * math.sqrt(0.25 * SEGMENT)
    errors = []
    for _ in range(60):
        observed = contents(true) + generator.normal(0.0, sigma, 2 * len(HEIGHT))
        found = least_squares(
            lambda p, o=observed: contents(p) - o,
            true,
            x_scale=[1.0, 0.1, 1.0, 1e3, 1e3, *[1.0] * 6],
            diff_step=1e-4,
        ).x
        errors.append((1e3 * (found[2] - width), found[3] - found[4]))
    scatter = np.sqrt(np.mean(np.square(errors), axis=0))
    bound = wall_bounds.wall_bound(1e3 * width, SEPARATION, SPEED, CHANGE, CHANGE_SIGMA, SEGMENT)
    assert scatter == pytest.approx([bound.width_sigma, bound.lag_sigma], rel=0.35)
