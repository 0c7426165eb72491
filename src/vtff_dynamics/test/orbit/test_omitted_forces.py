"""Omitted gravity beside the harmonics that real models have."""

import math

import numpy as np
import pytest

from vtff_dynamics.constants import GM_EARTH, RADIUS_EARTH_JGM3
from vtff_dynamics.frames.earth_environment import brahe_constants
from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.orbit.omitted_forces import omitted_gravity, other_forces
from vtff_dynamics.time.timescales import GpsTime

START = GpsTime(1_400_000_000_000_000_000)
RADIUS = 6.93e6


def accelerations(positions, degree):
    """Return the accelerations of the degrees above one, up to 60, at positions, m/s2."""
    full, part = ForceModel(degree=60, order=60), ForceModel(degree=degree, order=degree)
    states = np.hstack((positions, np.zeros_like(positions)))
    return np.array([full.acceleration(START, s) - part.acceleration(START, s) for s in states])


@pytest.mark.parametrize("degree", [8, 20, 30])
def test_kaulas_rule_is_near_the_harmonics_of_jgm3(degree):
    generator = np.random.default_rng(4)
    directions = generator.standard_normal((400, 3))
    positions = RADIUS * directions / np.linalg.norm(directions, axis=1)[:, None]
    apart = 1e4 * np.eye(3)[generator.integers(0, 3, 400)]
    here, there = accelerations(positions, degree), accelerations(positions + apart, degree)
    found = omitted_gravity(degree, RADIUS)
    assert found.acceleration_sigma == pytest.approx(np.sqrt(np.mean(here**2)), rel=0.3)
    gradient = np.sqrt(np.mean((there - here) ** 2)) / 1e4
    assert found.gradient_sigma == pytest.approx(gradient, rel=0.3)


def test_single_arcs_are_up_to_twice_as_rough_as_the_rule():
    """Gradients along the track by degrees 51 to 120 of EGM2008, on drawn arcs of 900 s."""
    model_type = brahe_constants.GravityModelType.EGM2008_120
    model = brahe_constants.GravityModel.from_model_type(model_type)
    generator, between = np.random.default_rng(1), 20e3
    rate = math.sqrt(GM_EARTH / RADIUS**3)

    def omitted(first, second, angle):
        position = RADIUS * (first * math.cos(angle) + second * math.sin(angle))
        whole = model.compute_spherical_harmonics(position, 120, 120)
        return np.asarray(whole) - model.compute_spherical_harmonics(position, 50, 50)

    sizes = []
    for _ in range(100):
        first, other = generator.standard_normal((2, 3))
        first /= np.linalg.norm(first)
        second = np.cross(first, other)
        second /= np.linalg.norm(second)
        changes = [
            omitted(first, second, angle + between / RADIUS) - omitted(first, second, angle)
            for angle in rate * np.arange(0.0, 900.0, 100.0)
        ]
        sizes.append(np.sqrt(np.mean(np.square(changes))) / between)
    ratios = np.array(sizes) / omitted_gravity(50, RADIUS).gradient_sigma
    assert np.median(ratios) == pytest.approx(1.0, abs=0.2)
    assert 0.85 < np.mean(ratios < 2.0) < 0.99


def test_less_is_omitted_further_out_and_changes_more_slowly():
    low, high = omitted_gravity(30, RADIUS), omitted_gravity(30, RADIUS + 3e5)
    assert high.acceleration_sigma < 0.4 * low.acceleration_sigma
    assert high.acceleration_time > low.acceleration_time
    assert low.gradient_time < low.acceleration_time


def test_a_degree_without_a_rule_is_refused():
    with pytest.raises(ValueError, match="degree 1: 2 or more expected"):
        omitted_gravity(1, RADIUS)


def test_other_forces_are_those_of_the_moon_until_drag_is_larger():
    """Drag of NRLMSISE-00 under an active Sun, some 1e-12 kg/m3 at 550 km, 1e-11 at 400 km."""
    high, low, lowest = (other_forces(RADIUS_EARTH_JGM3 + 1e3 * height) for height in (800, 400, 1))
    assert 1.4e-6 < high < 1.6e-6
    assert 0.5 < low / (0.5 * 1e-11 * 7.67e3**2 * 2.2 * 0.01) < 2.0
    assert low < lowest < 2e-3
