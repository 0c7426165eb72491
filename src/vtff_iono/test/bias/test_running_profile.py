"""The running profile: its model, how measurements replace it, and what is scaled."""

import numpy as np
import pytest
from formation_simulation import RADIUS

from vtff_iono.bias.running_profile import (
    CONSTANT,
    SHAPE,
    SIZE,
    RunningProfile,
    means_of_samples,
)
from vtff_iono.geometry.mapping import contents_of_rays, profile_content


def slant_contents(profile, elevation, altitude):
    """Return the contents of rays with each of the densities of a profile, (6, n), as they fly."""
    radius = np.full(len(elevation), RADIUS + altitude)
    perigee = radius * np.cos(elevation)
    return contents_of_rays(perigee, radius, profile.altitude, profile.densities())


def mean_derivatives(profile, low, high):
    """Return the means of the derivatives of a profile between two altitudes, (5,), as they fly."""
    return means_of_samples(low, high, profile.altitude, profile.densities()[1:])


def test_the_model_is_a_chapman_layer_of_20_tecu():
    profile = RunningProfile(350e3, 40e3, 80e3)
    assert profile.altitude[[0, -1]].tolist() == [100e3, 2000e3]
    assert np.diff(profile.altitude)[:700] == pytest.approx(1e3)
    assert np.diff(profile.altitude)[-10:] == pytest.approx(20e3)
    assert profile.altitude[np.argmax(profile.density)] == 350e3
    peak = profile.density.max()
    for altitude, scale in ((310e3, 40e3), (430e3, 80e3)):
        z = (altitude - 350e3) / scale
        value = profile.density[profile.altitude == altitude][0]
        assert value / peak == pytest.approx(np.exp(0.5 * (1.0 - z - np.exp(-z))))
    assert profile.content_above(100e3) == pytest.approx(20.0)
    total = np.trapezoid(profile.density, profile.altitude) / 1e16
    assert total == pytest.approx(20.0, rel=1e-4)


def test_contents_are_integrals_of_the_table():
    profile = RunningProfile()
    elevation = np.array([0.3, 1.0, 0.5 * np.pi])
    expected = profile_content(elevation, RADIUS + 400e3, profile.altitude, profile.density)
    contents = slant_contents(profile, elevation, 400e3)[0]
    assert contents == pytest.approx(expected, rel=1e-12)
    assert contents[-1] == pytest.approx(profile.content_above(400e3), rel=1e-12)


def test_mean_density_is_that_between_altitudes():
    profile = RunningProfile()
    inside = (profile.altitude >= 400e3) & (profile.altitude <= 420e3)
    mean = np.trapezoid(profile.density[inside], profile.altitude[inside]) / 20e3
    for altitudes in ((400e3, 420e3), (420e3, 400e3)):
        assert profile.mean_density(*altitudes) == pytest.approx(mean, rel=1e-3)
    exact = profile.density[profile.altitude == 410e3][0]
    assert profile.mean_density(410e3, 410e3 + 0.5) == pytest.approx(exact, rel=1e-4)


def test_the_first_measurement_replaces_the_model():
    profile = RunningProfile()
    before = profile.density.copy()
    profile.absorb(411e3, 409e3, 7e11, 1e10)
    is_between = np.abs(profile.altitude - 410e3) <= 1e3
    assert is_between.sum() == 3
    assert profile.density[is_between] == pytest.approx(7e11)
    assert np.array_equal(profile.density[~is_between], before[~is_between])
    # Two altitudes that are the same: the row of the table that is nearest.
    profile.absorb(430.2e3, 430.2e3, 3e11, 1e10)
    assert np.flatnonzero(profile.density == 3e11).tolist() == [330]
    profile.absorb(450e3, 450e3, -1e11, 1e10)
    assert profile.density[350] == 0.0


def test_measurements_are_weighted_with_a_short_memory():
    """1/9 and 1 for sigmas of 3 and 1; of many, as much as ten count."""
    profile = RunningProfile()
    profile.absorb(410e3, 410e3, 4e11, 3e10)
    profile.absorb(410e3, 410e3, 8e11, 1e10)
    assert profile.density[310] == pytest.approx(8e11 - 0.1 * 4e11)
    profile = RunningProfile()
    for _ in range(50):
        profile.absorb(410e3, 410e3, 4e11, 1e10)
    profile.absorb(410e3, 410e3, 8e11, 1e10)
    assert profile.density[310] == pytest.approx(4e11 + 4e11 / 11.0)


def test_what_is_measured_is_not_resized():
    profile = RunningProfile()
    profile.resize(30.0 / profile.content_above(300e3))
    assert profile.content_above(300e3) == pytest.approx(30.0)
    profile.absorb(395e3, 405e3, 5e11, 1e10)
    is_measured = profile.density == 5e11
    assert is_measured.sum() == 11
    before = profile.density.copy()
    size = profile.densities()[SIZE]
    profile.resize(1.2)
    assert np.array_equal(profile.density[is_measured], before[is_measured])
    assert profile.density[~is_measured] == pytest.approx(1.2 * before[~is_measured])
    assert profile.density - before == pytest.approx(0.2 * size)


def test_what_was_measured_follows_the_constant():
    """Means of measurements with their weights; what the constant drifted by is none of theirs."""
    profile = RunningProfile()
    before = profile.density.copy()
    profile.absorb(410e3, 410e3, 4e11, 3e10, -5e12)
    profile.absorb(410e3, 410e3, 8e11, 1e10, -1e12)
    profile.absorb(420e3, 420e3, 1e11, 1e10, -5e12)
    per_constant = profile.densities()[CONSTANT]
    assert np.flatnonzero(per_constant).tolist() == [310, 320]
    assert per_constant[310] == pytest.approx(-1e12 - 0.1 * 4e12)
    mean = profile.density[310]
    profile.move_constant(-0.1)
    assert profile.density[310] == pytest.approx(mean + 1.4e11)
    assert profile.density[320] == pytest.approx(6e11)
    # No density is negative.
    profile.move_constant(0.2)
    assert profile.density[320] == 0.0
    profile.loosen_constant(0.5)
    assert profile.densities()[CONSTANT, 310] == pytest.approx(-0.7e12)
    profile.move_constant(-0.1)
    assert profile.density[310] == pytest.approx(mean - 1.4e11 + 0.7e11)
    is_model = np.delete(np.arange(len(before)), [310, 320])
    assert np.array_equal(profile.density[is_model], before[is_model])


@pytest.mark.parametrize("place", range(3))
def test_shape_densities_are_derivatives(place):
    profile, other = RunningProfile(), RunningProfile()
    change = np.zeros(3)
    change[place] = 1e-4
    derivative = profile.densities()[SHAPE][place]
    other.reshape(change)
    assert (other.density - profile.density) / 1e-4 == pytest.approx(
        derivative, abs=2e-3 * np.abs(derivative).max()
    )
    slant = slant_contents(profile, np.array([0.3, 1.2]), 300e3)[SHAPE][place]
    expected = slant_contents(other, np.array([0.3, 1.2]), 300e3)[0]
    expected = (expected - slant_contents(profile, np.array([0.3, 1.2]), 300e3)[0]) / 1e-4
    assert slant == pytest.approx(expected, abs=2e-3 * np.abs(expected).max() + 1e-6)
    between = (other.mean_density(300e3, 310e3) - profile.mean_density(300e3, 310e3)) / 1e-4
    mean = mean_derivatives(profile, 300e3, 310e3)[SHAPE.start - 1 + place]
    assert mean == pytest.approx(between, rel=5e-3, abs=1e6)


def test_what_was_measured_keeps_its_shape_and_the_model_its_limits():
    profile = RunningProfile()
    profile.absorb(411e3, 409e3, 7e11, 1e10)
    is_measured = profile.density == 7e11
    assert is_measured.sum() == 3
    assert (profile.densities()[1:, is_measured] == 0.0).all()
    before = profile.density.copy()
    profile.reshape(np.array([0.3, -0.2, 0.1]))
    assert (profile.density[is_measured] == 7e11).all()
    profile.reshape(np.array([-0.3, 0.2, -0.1]))
    assert profile.density == pytest.approx(before)
    profile.reshape(np.array([-50.0, 50.0, 50.0]))
    assert np.isfinite(profile.density).all() and (profile.density >= 0.0).all()


def test_compiled_layer_means_and_derivatives_are_those_of_arrays():
    profile = RunningProfile(380e3, 50e3, 70e3)
    profile.resize(30.0 / profile.content_above(300e3))
    profile.absorb(421e3, 419e3, 3e11, 1e10, -2e12)
    altitude, density = profile.altitude, profile.density
    height = np.where(altitude < 380e3, 50e3, 70e3)
    argument = (altitude - 380e3) / height
    slope = np.where(density == 3e11, 0.0, 0.5 * density * (1.0 - np.exp(-argument)))
    of_height = argument * slope
    expected = [
        density,
        np.where(density == 3e11, 0.0, density),
        np.where(argument < 0.0, of_height, 0.0),
        np.where(argument < 0.0, 0.0, of_height),
        slope * 100e3 / height,
        np.where(density == 3e11, -2e12, 0.0),
    ]
    np.testing.assert_allclose(profile.densities(), expected, rtol=1e-12)
    for low, high in ((400.2e3, 400.7e3), (417.5e3, 423.1e3), (399e3, 401e3)):
        inside = altitude[(altitude > low) & (altitude < high)]
        points = np.array([low, *inside, high])
        tables = [np.interp(points, altitude, row) for row in expected]
        mean = np.trapezoid(tables[0], points) / (high - low)
        assert profile.mean_density(high, low) == pytest.approx(mean, rel=1e-12)
        means = np.mean(tables[1:], axis=1)
        np.testing.assert_allclose(mean_derivatives(profile, low, high), means, rtol=1e-12)
    for place in altitude[[0, 50, -1]]:
        there = [np.interp(place, altitude, row) for row in expected[1:]]
        np.testing.assert_allclose(mean_derivatives(profile, place, place), there, rtol=1e-12)
