"""Gradients and travelling disturbances of TEC against their definitions."""

import math

import numpy as np
import pytest

from vtff_dynamics.constants import RADIUS_EARTH_JGM3
from vtff_sim_bridge.atmosphere.horizontal_structure import (
    HorizontalGradient,
    HorizontalStructure,
    TravellingDisturbance,
)

START = np.array([RADIUS_EARTH_JGM3 + 550e3, 0.0, 0.0])
"""First vehicle: above the equator at longitude 0, where east is y and north is z."""
SHELL = 700e3


def vertical(structures, latitude_deg=0.0, longitude_deg=0.0, elapsed=0.0, seed=1) -> float:
    """Return the vertical TEC that structures add above a place, TECU."""
    latitude, longitude = math.radians(latitude_deg), math.radians(longitude_deg)
    up = np.array(
        [
            math.cos(latitude) * math.cos(longitude),
            math.cos(latitude) * math.sin(longitude),
            math.sin(latitude),
        ]
    )
    structure = HorizontalStructure(structures, seed, START)
    position = np.linalg.norm(START) * up
    tecu = structure.slant_tec_tecu(position[None], up[None, None], np.array([elapsed]))
    return float(tecu[0, 0])


def test_gradient_grows_along_its_direction_to_its_extent() -> None:
    north = [HorizontalGradient(0.5, 0.0, SHELL)]
    assert vertical(north) == pytest.approx(0.0, abs=1e-9)
    assert vertical(north, latitude_deg=4.0) == pytest.approx(2.0)
    assert vertical(north, latitude_deg=-4.0) == pytest.approx(-2.0)
    assert vertical(north, longitude_deg=4.0) == pytest.approx(0.0, abs=1e-9)
    assert vertical(north, latitude_deg=35.0) == pytest.approx(10.0)
    shifted = [HorizontalGradient(0.5, 0.0, SHELL, content_tecu=3.0)]
    assert vertical(shifted) == pytest.approx(3.0)
    assert vertical(shifted, latitude_deg=-4.0) == pytest.approx(1.0)
    east = [HorizontalGradient(0.5, 90.0, SHELL)]
    assert vertical(east, longitude_deg=4.0) == pytest.approx(2.0)
    assert vertical([*north, *east], 3.0, 0.0) == pytest.approx(1.5)


def test_slant_is_vertical_by_the_sine_of_the_elevation_at_the_shell() -> None:
    structure = HorizontalStructure([HorizontalGradient(1.0, 90.0, SHELL)], 1, START)
    elevation = np.radians([10.0, 40.0, 170.0])
    directions = np.column_stack((np.sin(elevation), np.cos(elevation), 0.0 * elevation))
    tecu = structure.slant_tec_tecu(START[None], directions[None], np.zeros(1))[0]
    shell = RADIUS_EARTH_JGM3 + SHELL
    for slope, direction, value in zip(elevation, directions, tecu, strict=True):
        sine = math.sqrt(1.0 - (START[0] * math.cos(slope) / shell) ** 2)
        # The pierce point by bisection along the ray.
        low, high = 0.0, 5e6
        for _ in range(100):
            middle = 0.5 * (low + high)
            inside = np.linalg.norm(START + middle * direction) < shell
            low, high = (middle, high) if inside else (low, middle)
        point = START + low * direction
        angle_deg = math.degrees(math.atan2(point[1], point[0]))
        assert value == pytest.approx(angle_deg / sine, rel=1e-9)
    assert tecu[2] < 0.0 < tecu[1] < tecu[0]


def test_disturbance_has_its_amplitude_wavelength_period_and_direction() -> None:
    length = math.radians(2.0) * (RADIUS_EARTH_JGM3 + SHELL)
    wave = [TravellingDisturbance(0.4, length, 1200.0, 0.0, SHELL)]
    along = [vertical(wave, latitude_deg=x) for x in np.arange(0.0, 2.0, 0.05)]
    assert max(along) == pytest.approx(0.4, rel=0.01)
    assert np.sqrt(np.mean(np.square(along))) == pytest.approx(0.4 / math.sqrt(2.0), rel=1e-3)
    assert vertical(wave, 0.3) == pytest.approx(vertical(wave, 2.3), abs=1e-9)
    assert vertical(wave, 0.3) == pytest.approx(vertical(wave, 0.3, elapsed=1200.0), abs=1e-9)
    # After a quarter of the period the crest is a quarter of the wavelength further north.
    assert vertical(wave, 0.3) == pytest.approx(vertical(wave, 0.8, elapsed=300.0), abs=1e-9)
    assert vertical(wave, 0.3, 5.0) == pytest.approx(vertical(wave, 0.3), abs=0.01)


def test_phases_of_disturbances_and_seeds_differ() -> None:
    wave = TravellingDisturbance(1.0, 2e5, 1200.0, 0.0, SHELL)
    values = [vertical([wave], seed=seed) for seed in range(400)]
    assert np.mean(values) == pytest.approx(0.0, abs=0.12)
    assert np.mean(np.square(values)) == pytest.approx(0.5, abs=0.06)
    both = vertical([wave, wave])
    assert both != pytest.approx(2.0 * vertical([wave]), abs=1e-3)


def test_shell_below_the_receivers_and_values_out_of_range_are_refused() -> None:
    with pytest.raises(ValueError, match=r"shell_altitude: above the receivers expected \(550 km"):
        HorizontalStructure([HorizontalGradient(0.5, 0.0, 400e3)], 1, START)
    with pytest.raises(ValueError, match="extent_deg"):
        HorizontalGradient(0.5, 0.0, SHELL, extent_deg=0.0)
    with pytest.raises(ValueError, match="content_tecu: 0 or more expected, got -1"):
        HorizontalGradient(0.5, 0.0, SHELL, content_tecu=-1.0)
    with pytest.raises(ValueError, match="wavelength"):
        TravellingDisturbance(1.0, -1.0, 1200.0, 0.0, SHELL)
    with pytest.raises(ValueError, match="amplitude_tecu"):
        TravellingDisturbance(-1.0, 1e5, 1200.0, 0.0, SHELL)
