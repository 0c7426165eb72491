"""Orbits from fixes: exact without errors, honest with slow ones and with forces not modelled."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from vtff_dynamics.orbit.elements import ClassicalElements
from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.orbit.mean_elements import elements_from_state, mean_elements
from vtff_dynamics.orbit.propagator import Propagator
from vtff_dynamics.relative.relative_elements import relative_elements_of
from vtff_dynamics.time.timescales import parse_epoch
from vtff_nav.orbit.determination import OrbitFitModel, average_mean_elements, determine_orbit

EPOCH = parse_epoch("2000-09-01T00:00:00 UTC")
SPACING = 20.0
MODEL = OrbitFitModel(force_model=ForceModel(degree=8, order=8))
REAL_FORCES = ForceModel(
    degree=36,
    order=36,
    drag="harris_priester",
    solar_radiation_pressure=True,
    third_bodies=("sun", "moon"),
    mass=6.5,
    drag_area=0.1,
    radiation_area=0.1,
)


def fly(seed: int, forces: ForceModel, orbits: float, along: float = 0.0) -> np.ndarray:
    """Return the states of a drawn orbit, one row for each fix."""
    generator = np.random.default_rng(seed)
    start = ClassicalElements(
        7.082e6 + generator.uniform(-2e3, 2e3),
        1e-3 * generator.uniform(0.3, 3.0),
        math.radians(98.1),
        *generator.uniform(0.0, 2.0 * math.pi, 3),
    ).to_state()
    propagator = Propagator(EPOCH, start, forces, step=SPACING)
    states = [start]
    for _ in range(round(orbits * 5931.0 / SPACING)):
        velocity = states[-1][3:]
        states.append(propagator.advance(along * velocity / np.linalg.norm(velocity)))
    return np.array(states)


def slow_errors(generator: np.random.Generator, rows: int, sigma: float, time: float) -> np.ndarray:
    """Return a first-order process on three axes."""
    decay = math.exp(-SPACING / time)
    errors = np.empty((rows, 3))
    errors[0] = generator.standard_normal(3)
    for row in range(1, rows):
        fresh = math.sqrt(1.0 - decay**2) * generator.standard_normal(3)
        errors[row] = decay * errors[row - 1] + fresh
    return sigma * errors


def draw_fixes(states: np.ndarray, seed: int, white: float = 3.0, slow: float = 5.0) -> np.ndarray:
    generator = np.random.default_rng((seed, 1))
    fixes = states + 0.1 * generator.standard_normal(states.shape)
    fixes[:, :3] += white * generator.standard_normal((len(states), 3))
    fixes[:, :3] += slow_errors(generator, len(states), slow, 1800.0)
    return fixes


def true_elements(states: np.ndarray) -> np.ndarray:
    """Return those of the middle of the arc."""
    return average_mean_elements(states, (len(states) - 1) // 2, SPACING)


def seconds_of(states: np.ndarray) -> np.ndarray:
    return SPACING * np.arange(float(len(states)))


def test_fixes_without_errors_give_the_orbit_and_its_decay():
    """In the model's own forces; a thrust along the track of 2e-7 m/s2 is a decay."""
    states = fly(1, MODEL.force_model, 2.0, along=-2e-7)
    velocity = np.array([0.0, 0.0, 0.0, 0.3, -0.3, 0.3])  # of the start of the search
    orbit = determine_orbit(EPOCH, seconds_of(states), states + velocity, MODEL)
    true = true_elements(states)
    error = relative_elements_of(orbit.elements_mean, true)
    assert np.abs(error).max() < 0.1
    motion = math.sqrt(3.986e14 / 7.082e6**3)
    assert orbit.axis_rate == pytest.approx(-2.0 * 2e-7 / motion, rel=0.02)
    assert orbit.residual < 0.1


def test_errors_are_those_of_the_covariance():
    """Slow errors of fixes, drag, radiation and gravity beyond the model: drawn arcs."""
    squares, axes = [], []
    for seed in range(6):
        states = fly(seed, REAL_FORCES, 2.0)
        orbit = determine_orbit(EPOCH, seconds_of(states), draw_fixes(states, seed))
        true = true_elements(states)
        error = relative_elements_of(orbit.elements_mean, true)
        squares.append(error @ np.linalg.solve(orbit.covariance[:6, :6], error) / 6.0)
        axes.append(error[0] / orbit.axis_sigma)
        assert orbit.weighted_residual == pytest.approx(1.0, abs=0.15)
    assert 0.5 < np.mean(squares) < 1.7  # 36 numbers
    assert 0.4 < np.sqrt(np.mean(np.square(axes))) < 1.7


def test_gaps_widen_the_covariance_and_worse_fixes_are_seen():
    states = fly(3, REAL_FORCES, 2.0)
    seconds, fixes = seconds_of(states), draw_fixes(states, 3)
    whole = determine_orbit(EPOCH, seconds, fixes)
    kept = (seconds < 3000.0) | (seconds > 10500.0)
    part = determine_orbit(EPOCH, seconds[kept], fixes[kept])
    assert part.time - EPOCH == pytest.approx(whole.time - EPOCH, abs=SPACING)
    assert np.all(np.diag(part.covariance) > np.diag(whole.covariance))
    apart = relative_elements_of(whole.elements_mean, part.elements_mean)
    sigma = np.sqrt(np.diag(part.covariance)[:6])
    assert np.all(np.abs(apart) < 4.0 * sigma)
    worse = determine_orbit(EPOCH, seconds, draw_fixes(states, 3, white=12.0))
    assert worse.weighted_residual > 3.0


def test_the_average_over_an_orbit_is_steadier_than_mean_elements_of_a_moment():
    """Tesseral harmonics of degree 8 move the mean axis of a moment by metres."""
    states = fly(4, MODEL.force_model, 2.5)
    rows = range(len(states) // 2 - 60, len(states) // 2 + 60, 20)
    averages = [average_mean_elements(states, row, SPACING)[0] for row in rows]
    moments = [mean_elements(elements_from_state(states[row]))[0] for row in rows]
    assert np.ptp(averages) < 0.3 * np.ptp(moments)


@pytest.mark.parametrize(
    ("seconds", "change", "message"),
    [
        ([0.0, 20.0, 40.0], None, "five or more rows"),
        ([0.0, 20.0, 41.0, 60.0, 80.0], None, "rising multiples of 20 s"),
        ([0.0, 20.0, 20.0, 60.0, 80.0], None, "rising multiples of 20 s"),
        ([0.0, 20.0, 40.0, 60.0, 80.0], math.nan, "finite"),
        ([0.0, 20.0, 40.0, 60.0, 80.0], None, "half an orbit"),
    ],
)
def test_fixes_that_are_no_arc_are_refused(seconds, change, message):
    states = fly(1, MODEL.force_model, 0.02)[: len(seconds)]
    if change is not None:
        states[0, 0] = change
    with pytest.raises(ValueError, match=message):
        determine_orbit(EPOCH, seconds, states, MODEL)


@pytest.mark.parametrize("name", ["white_sigma", "correlation_time", "empirical_sigma", "step"])
def test_numbers_of_the_model_are_checked(name):
    with pytest.raises(ValueError, match=f"{name}: more than 0"):
        dataclasses.replace(MODEL, **{name: 0.0})
    with pytest.raises(ValueError, match="slow_sigma: 0 or more"):
        dataclasses.replace(MODEL, slow_sigma=-1.0)
