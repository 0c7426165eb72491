"""Irregularity regions against point-by-point sampling with the frames of vtff_dynamics."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import numpy as np
import numpy.typing as npt
import pytest

from vtff_dynamics.frames.geodetic import geodetic_from_itrf, itrf_from_geodetic
from vtff_dynamics.time.local_time import mean_solar_local_time_hours
from vtff_dynamics.time.timescales import parse_epoch
from vtff_sim_bridge.atmosphere.irregularity import (
    IrregularityRegion,
    path_length_in_region,
)

TIME = parse_epoch("2016-03-21T01:30:00 GPS")


def region_of(**changes):
    """Return the region of the equatorial spread F scenario, with changes."""
    fields = {
        "name": "esf",
        "latitude_south": math.radians(-10.0),
        "latitude_north": 0.0,
        "local_time_start_hours": 20.0,
        "local_time_end_hours": 22.0,
        "altitude_bottom": 290e3,
        "altitude_top": 350e3,
        "s4": 0.4,
        "decorrelation_time": 0.5,
    }
    return IrregularityRegion(**{**fields, **changes})


def longitude_at(local_time_hours):
    """Return the longitude (rad) that has a local time at TIME."""
    greenwich = mean_solar_local_time_hours(TIME, 0.0)
    return (local_time_hours - greenwich) * math.pi / 12.0


def contains_by_definition(region, positions):
    """Return whether positions (n, 3) are inside, from geodetic coordinates and local time."""
    latitude, longitude, height = geodetic_from_itrf(positions).T
    hours = (mean_solar_local_time_hours(TIME, 0.0) + np.degrees(longitude) / 15.0) % 24.0
    start, end = region.local_time_start_hours, region.local_time_end_hours
    in_time = (hours - start) % 24.0 <= ((end - start) % 24.0 or 24.0)
    return (
        in_time
        & (latitude >= region.latitude_south)
        & (latitude <= region.latitude_north)
        & (height >= region.altitude_bottom)
        & (height <= region.altitude_top)
    )


def random_rays(generator, count):
    """Return receivers and satellites (count, 3) in and around the region."""
    receivers = itrf_from_geodetic(
        np.stack(
            [
                np.radians(generator.uniform(-14.0, 4.0, count)),
                longitude_at(generator.uniform(19.0, 23.0, count)),
                generator.uniform(200e3, 420e3, count),
            ],
            axis=-1,
        )
    )
    direction = generator.normal(size=(count, 3))
    satellites = 26.56e6 * direction / np.linalg.norm(direction, axis=1)[:, None]
    return receivers, satellites


REGIONS = {
    "esf": region_of(),
    "midnight": region_of(local_time_start_hours=21.5, local_time_end_hours=1.0),
    "all_hours": region_of(local_time_start_hours=0.0, local_time_end_hours=24.0),
    "both_sides": region_of(latitude_south=math.radians(-5.0), latitude_north=math.radians(7.0)),
    "more_than_half_a_day": region_of(local_time_start_hours=21.0, local_time_end_hours=14.0),
}


def is_inside(time, position):
    """Return whether a metre of the zenith ray from a position lies in the region."""
    end = position * (1.0 + 1.0 / np.linalg.norm(position))
    return bool(path_length_in_region(region_of(), time, position, end[None])[0] > 0.5)


def crossing_intervals(
    crosses_at: Callable[[float], npt.ArrayLike],
    times: Iterable[float],
    tolerance: float = 1e-3,
) -> list[list[tuple[float, float]]]:
    """Return the intervals of time in which links cross a region.

    Parameters
    ----------
    crosses_at : callable
        Returns, for a time in s, an array (n,) that is greater than zero (or True) for each link
        that crosses: for example `path_length_in_region` of interpolated positions.
    times : iterable of float
        Increasing times, s, at which is looked; crossings that begin and end between two of them
        are missed.
    tolerance : float
        Width to which each beginning and end is bisected, s.

    Returns
    -------
    list of list of (float, float)
        For each link the beginnings and ends, s. An interval that is open at the first or the last
        time ends there.
    """
    previous_time, previous = math.nan, np.zeros(0, dtype=bool)
    intervals: list[list[tuple[float, float]]] = []
    begins: list[float] = []
    for time in times:
        crossing = np.asarray(crosses_at(time)) > 0
        if not intervals:
            intervals = [[] for _ in crossing]
            begins = [time if inside else math.nan for inside in crossing]
        else:
            for link in np.flatnonzero(crossing != previous).tolist():
                change = _bisected(crosses_at, link, previous_time, time, tolerance)
                if crossing[link]:
                    begins[link] = change
                else:
                    intervals[link].append((begins[link], change))
        previous_time, previous = time, crossing
    for link in np.flatnonzero(previous).tolist():
        intervals[link].append((begins[link], previous_time))
    return intervals


def _bisected(
    crosses_at: Callable[[float], npt.ArrayLike],
    link: int,
    low: float,
    high: float,
    tolerance: float,
) -> float:
    """Return the time between `low` and `high` at which a link starts or stops to cross."""
    crossing_high = bool(np.asarray(crosses_at(high))[link] > 0)
    while high - low > tolerance:
        middle = 0.5 * (low + high)
        if bool(np.asarray(crosses_at(middle))[link] > 0) == crossing_high:
            high = middle
        else:
            low = middle
    return 0.5 * (low + high)


@pytest.mark.parametrize("name", REGIONS)
def test_length_equals_sampling_along_the_ray(name):
    region = REGIONS[name]
    receivers, satellites = random_rays(np.random.default_rng(11), 150)
    lengths = path_length_in_region(region, TIME, receivers, satellites)
    spacing = 2e3
    crossed = 0
    for receiver, satellite, length in zip(receivers, satellites, lengths, strict=True):
        distance = np.linalg.norm(satellite - receiver)
        # Rays through the Earth come out at the other side and leave the shell within 14000 km.
        along = np.arange(0.5 * spacing, min(distance, 14000e3), spacing)
        points = receiver + along[:, None] * (satellite - receiver) / distance
        inside = contains_by_definition(region, points)
        changes = np.count_nonzero(np.diff(inside.astype(int))) + 1
        expected = spacing * np.count_nonzero(inside)
        # A grazing shell is met at a slope of at least 0.01 here: 1 m of height are 100 m.
        assert length == pytest.approx(expected, abs=changes * (spacing + 200.0))
        crossed += expected > 0.0
    assert crossed > 10


def test_shapes_broadcast():
    receivers, satellites = random_rays(np.random.default_rng(2), 6)
    both = path_length_in_region(region_of(), TIME, receivers[:2, None], satellites[None])
    assert both.shape == (2, 6)
    alone = path_length_in_region(region_of(), TIME, receivers[1], satellites[4])
    assert both[1, 4] == pytest.approx(float(alone), abs=1e-6)


def test_vertical_ray_measures_the_thickness():
    place = [math.radians(-5.0), longitude_at(21.0)]
    low, high = itrf_from_geodetic([[*place, 200e3], [*place, 20000e3]])
    assert path_length_in_region(region_of(), TIME, low, high) == pytest.approx(60e3, abs=2.0)
    inside = itrf_from_geodetic([*place, 330e3])
    assert path_length_in_region(region_of(), TIME, inside, high) == pytest.approx(20e3, abs=2.0)
    above = itrf_from_geodetic([*place, 351e3])
    assert path_length_in_region(region_of(), TIME, above, high) == 0.0


@pytest.mark.parametrize(
    ("latitude_deg", "hours", "height", "inside"),
    [
        (-5.0, 21.0, 320e3, True),
        (-9.999, 20.001, 290.01e3, True),
        (-0.001, 21.999, 349.99e3, True),
        (-10.001, 21.0, 320e3, False),
        (0.001, 21.0, 320e3, False),
        (-5.0, 19.999, 320e3, False),
        (-5.0, 22.001, 320e3, False),
        (-5.0, 21.0, 289.99e3, False),
        (-5.0, 21.0, 350.01e3, False),
    ],
)
def test_rays_that_start_inside_are_inside(latitude_deg, hours, height, inside):
    position = itrf_from_geodetic([math.radians(latitude_deg), longitude_at(hours), height])
    assert is_inside(TIME, position) is inside


def test_region_follows_the_sun():
    place = itrf_from_geodetic([math.radians(-5.0), longitude_at(21.0), 320e3])
    assert is_inside(TIME, place)
    assert is_inside(TIME + 3599, place)
    assert not is_inside(TIME + 3601, place)


def test_intervals_of_a_pass_through_the_vertical_edges():
    """A receiver that rises at 300 m/s: its zenith ray crosses until it leaves by the top."""
    place = [math.radians(-5.0), longitude_at(21.0)]
    zenith_satellite = itrf_from_geodetic([[*place, 20000e3]])

    def lengths(seconds):
        receiver = itrf_from_geodetic([*place, 280e3 + 300.0 * seconds])
        return path_length_in_region(region_of(), TIME, receiver, zenith_satellite)

    (zenith,) = crossing_intervals(lengths, np.arange(0.0, 400.0, 1.0))
    assert zenith == [(0.0, pytest.approx(70e3 / 300.0, abs=0.01))]


def test_intervals_of_a_pass_through_the_western_edge():
    """A receiver at 320 km that moves east: the zenith ray enters where the local time does."""
    latitude, height = math.radians(-5.0), 320e3
    start, rate = longitude_at(19.9), math.radians(0.065)

    def lengths(seconds):
        place = [latitude, start + rate * seconds]
        receiver, satellite = itrf_from_geodetic([[*place, height], [*place, 20000e3]])
        when = TIME + float(seconds)
        return path_length_in_region(region_of(), when, receiver, satellite[None])

    (zenith,) = crossing_intervals(lengths, np.arange(0.0, 300.0, 1.0))
    # Local time advances with the longitude and with the clock (15 deg per hour).
    expected = math.radians(1.5) / (rate + math.radians(15.0) / 3600.0)
    assert zenith == [(pytest.approx(expected, abs=0.01), 299.0)]


def test_intervals_begin_and_end_where_the_link_does():
    def lengths(seconds):
        return np.array([math.sin(seconds), -1.0, 1.0])

    first, never, always = crossing_intervals(lengths, np.arange(0.5, 13.0, 0.5), 1e-6)
    turns = [(0.5, math.pi), (2.0 * math.pi, 3.0 * math.pi), (4.0 * math.pi, 12.5)]
    assert len(first) == 2
    for interval, expected in zip(first, turns, strict=False):
        assert interval == pytest.approx(expected, abs=1e-5)
    assert never == []
    assert always == [(0.5, 12.5)]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"latitude_north": math.radians(-11.0)}, "latitude_south must be below"),
        ({"local_time_end_hours": 25.0}, "local_time_end_hours must be within"),
        ({"local_time_end_hours": 20.0}, "equals local_time_end_hours"),
        ({"altitude_top": 200e3}, "altitude_bottom must be below"),
        ({"s4": 1.2}, "s4 must be within 0 and 1, got 1.2"),
        ({"decorrelation_time": 0.0}, "decorrelation_time must be positive"),
    ],
)
def test_impossible_region_is_refused(changes, message):
    with pytest.raises(ValueError, match=f"region 'esf': .*{message}"):
        region_of(**changes)
