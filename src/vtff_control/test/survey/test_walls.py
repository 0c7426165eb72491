"""Walls over passes: association, drift and its covariance, ambiguity, walls that come and go."""

import math

import numpy as np
import pytest

from vtff_control.survey.walls import LocatedCrossing, WallSettings, estimate_walls

RADIUS = WallSettings.radius
PERIOD = 5570.0
ORBIT_RATE = 2.0 * math.pi / PERIOD
EARTH_RATE = 7.292e-5


def night(places, drifts, passes, sigma, random, spacecraft=("chief", "deputy")):
    """Return crossings of walls at places (m east at time 0) by an even motion, and the last time.

    Longitudes are computed from time by a motion of its own, not with the package.
    """
    crossings = []
    rate = (ORBIT_RATE - EARTH_RATE) * RADIUS
    for lap in range(passes):
        for number, (place, drift) in enumerate(zip(places, drifts, strict=True)):
            # Where the spacecraft and the wall meet in this lap.
            time = (place + lap * 2.0 * math.pi * RADIUS) / (rate - drift)
            for behind, name in enumerate(spacecraft):
                east = place + drift * time + sigma * random.standard_normal()
                longitude = (east / RADIUS + math.pi) % (2.0 * math.pi) - math.pi
                crossings.append(
                    LocatedCrossing(
                        time + 0.3 * behind, name, number % 2 == 0, longitude, 0.1, 4e5, sigma
                    )
                )
    return crossings


PLACES = np.array([1.0e6, 1.5e6, 2.6e6, 3.0e6, 4.2e6, 4.8e6])


@pytest.mark.parametrize("drift", [5.0, 60.0, 145.0])
def test_drift_after_two_passes(drift):
    random = np.random.default_rng(3)
    crossings = night(PLACES, drift + np.zeros(6), 2, 5e3, random)
    estimate = estimate_walls(crossings)
    assert len(estimate.walls) == 6
    assert all(wall.passes == 2 for wall in estimate.walls)
    assert abs(estimate.drift - drift) < 3.0 * estimate.drift_sigma < 9.0
    assert estimate.probability > 0.9


def test_normalised_errors_of_places_to_come():
    """The error of the next crossing over its sigma, over drawn nights, is about one."""
    random = np.random.default_rng(5)
    squares = []
    for _ in range(30):
        settings = WallSettings()
        common = random.normal(settings.drift_mean, 30.0)
        drifts = common + settings.drift_spread * random.standard_normal(6)
        # Walls that are no meridian planes: shape errors of each pass are in the crossings.
        crossings = night(PLACES, drifts, 3, 4e3, random, spacecraft=("chief",))
        coming = crossings[12].time + 5000.0
        estimate = estimate_walls(crossings[:12])
        for wall, place, drift in zip(estimate.walls, PLACES, drifts, strict=True):
            true = (place + drift * coming) / RADIUS
            error = (wall.longitude_at(coming) - true + math.pi) % (2 * math.pi) - math.pi
            squares.append((RADIUS * error / wall.sigma_at(coming)) ** 2)
            spread = (wall.drift - drift) / math.sqrt(float(wall.covariance[1, 1]))
            assert abs(spread) < 4.5
    assert 0.5 < np.mean(squares) < 1.5


def test_one_pass_leaves_the_drift_to_the_prior():
    estimate = estimate_walls(night(PLACES, 100.0 + np.zeros(6), 1, 5e3, np.random.default_rng(1)))
    assert estimate.drift == pytest.approx(75.0)
    assert estimate.drift_sigma == pytest.approx(45.0)
    assert estimate.passes == 1
    assert all(wall.spacecraft == {"chief", "deputy"} for wall in estimate.walls)


def test_even_walls_are_ambiguous():
    """Walls as far apart as a drift of 150 m/s goes in an orbit can be taken for each other."""
    places = 1e6 + 300e3 * np.arange(6)
    crossings = night(places, 75.0 + np.zeros(6), 2, 5e3, np.random.default_rng(2))
    one_kind = [
        LocatedCrossing(c.time, c.spacecraft, True, c.longitude, c.latitude, c.altitude, c.sigma)
        for c in crossings
    ]
    # Each pass lacks one end wall, so that a shift by one wall explains the rest as well.
    first_pass = [c for c in one_kind if c.time < 4000.0]
    second_pass = [c for c in one_kind if c.time >= 4000.0]
    shifted = first_pass[2:] + second_pass[:-2]
    assert estimate_walls(shifted).probability < 0.99


def test_a_wall_that_was_missed_and_one_that_is_new():
    random = np.random.default_rng(4)
    crossings = night(PLACES, 90.0 + np.zeros(6), 3, 5e3, random)
    pass_two = sorted(crossings, key=lambda c: c.time)[12:24]
    missed = {id(c) for c in pass_two[4:6]}
    kept = [c for c in crossings if id(c) not in missed]
    new = LocatedCrossing(pass_two[0].time - 200.0, "chief", False, 0.05, 0.1, 4e5, 5e3)
    estimate = estimate_walls([*kept, new])
    assert len(estimate.walls) == 7
    passes = sorted(wall.passes for wall in estimate.walls)
    assert passes == [1, 2, 3, 3, 3, 3, 3]
    assert abs(estimate.drift - 90.0) < 10.0


def test_no_crossings_no_walls():
    assert estimate_walls([]).walls == []
