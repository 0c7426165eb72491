"""Two spacecraft cross the lower edge of a bubble at 20 Hz: the whole chain against the truth.

This is the short form of the slow tests of `vtff run esf` (test/test_graph_ionosphere.py), with
their bounds: edge, separation, density and its sigma, a broken arc, a ray that scintillates.
"""

from __future__ import annotations

import types

import numpy as np
import pytest
from formation_drawing import START, DrawnFormation
from formation_simulation import chapman, mean_density

from vtff_iono.edges.boundary import NO_SYSTEM, BoundarySource
from vtff_iono.formation_ionosphere import FormationIonosphere

EDGE = 290e3
SPEED = 256.0
BEGIN = 276e3
DURATION = 112.0


def bubble():
    """A dense layer below 290 km, 1 % of it above up to 350 km; the edge is 100 m wide."""
    altitude = np.unique(
        np.concatenate((np.arange(150e3, 1000e3, 2e3), EDGE + np.array([-50.0, 50.0])))
    )
    inside = np.interp(altitude, [EDGE - 50.0, EDGE + 50.0, 349e3, 351e3], [0.0, 1.0, 1.0, 0.0])
    density = chapman(altitude, 1.9e12)
    return altitude, (1.0 - 0.99 * inside) * density


@pytest.fixture(scope="module")
def flight():
    """Seconds of the crossing and their results."""
    probe = DrawnFormation(lambda t: BEGIN + SPEED * t, bubble())
    visible = _prns_above(probe, 30.0)
    drawn = DrawnFormation(
        lambda t: BEGIN + SPEED * t,
        bubble(),
        slips={(1, visible[0]): 25.0},
        fades={visible[1]: (30.0, 60.0, 0.4)},
    )
    formation = FormationIonosphere()
    for ephemeris in drawn.ephemerides(DURATION):
        formation.add_ephemeris(ephemeris)
    results = [formation.process(second) for second in drawn.seconds(DURATION, 0.05)]
    return types.SimpleNamespace(
        drawn=drawn,
        densities=[density for result in results for density in result.density[0]],
        boundaries=[boundary for result in results for boundary in result.boundaries[0]],
        slipped=visible[0],
        fading=visible[1],
    )


def _prns_above(drawn, elevation_deg):
    """Return the satellites above an elevation at the beginning, the lowest first."""
    formation = FormationIonosphere()
    for ephemeris in drawn.ephemerides(DURATION):
        formation.add_ephemeris(ephemeris)
    epoch = formation.process(next(drawn.seconds(DURATION, 0.5))).spacecraft[0].epoch
    order = np.argsort(epoch.elevation)
    high = [row for row in order if np.degrees(epoch.elevation[row]) > elevation_deg]
    return [epoch.links[row].prn for row in high]


def seconds(nanoseconds):
    return (nanoseconds - START.nanoseconds) * 1e-9


def crossing_time(flight, craft):
    shift = flight.drawn.offset if craft == 1 else 0.0
    return (EDGE - BEGIN - shift) / SPEED


def vertical(flight):
    return [b for b in flight.boundaries if b.source == BoundarySource.DENSITY]


def test_both_spacecraft_find_the_edge(flight):
    found = vertical(flight)
    assert [(b.spacecraft, b.is_entry, b.system) for b in found] == [
        (0, True, NO_SYSTEM),
        (1, True, NO_SYSTEM),
    ]
    for boundary in found:
        error = seconds(boundary.time) - crossing_time(flight, boundary.spacecraft)
        assert abs(error) <= 0.1
        assert abs(error) <= 4.0 * boundary.time_sigma
        altitude = np.linalg.norm(boundary.position_itrf) - 6378137.0
        assert altitude == pytest.approx(EDGE, abs=100.0)


def test_separation_from_the_times_of_the_edge(flight):
    chief, deputy = vertical(flight)
    separation = (seconds(chief.time) - seconds(deputy.time)) * SPEED
    assert separation == pytest.approx(flight.drawn.offset, rel=0.05)


def errors(flight):
    """Return time, error and sigma of the combined densities, and the separation."""
    rows = []
    for density in flight.densities:
        epoch, time = density.epoch, seconds(density.time)
        chief, deputy = flight.drawn.altitudes(np.array(time))
        assert epoch.altitude == pytest.approx(0.5 * (chief + deputy), abs=5.0)
        assert epoch.separation == pytest.approx(flight.drawn.offset, abs=1.0)
        true = mean_density(*flight.drawn.profile, min(chief, deputy), max(chief, deputy))
        rows.append((time, epoch.density - true, epoch.sigma))
    return np.array(rows).T


def test_density_within_its_sigma(flight):
    time, error, sigma = errors(flight)
    assert len(time) >= DURATION - 2
    # At first low satellites have to separate the common constant from the density.
    settled = time > 20.0
    assert np.abs(error[settled]).mean() < 4e10
    assert np.sqrt(np.mean((error[settled] / sigma[settled]) ** 2)) < 2.0
    content = error[settled] * flight.drawn.offset / 1e16
    assert np.sqrt(np.mean(content**2)) <= 0.005


def test_a_satellite_with_a_broken_arc_takes_part_again(flight):
    """Relative navigation never fixes its integers again."""
    used = {
        round(seconds(density.time) + 0.4): density.epoch.density_satellite[
            density.prn == flight.slipped
        ]
        for density in flight.densities
    }
    assert all(np.isfinite(used[second]).all() and len(used[second]) for second in range(5, 24))
    assert any(len(used[second]) == 0 for second in (27, 28))
    again = [second for second in range(29, 100) if len(used[second])]
    assert again and again[0] <= 60
    assert all(len(used[second]) for second in range(again[0], 110))


def test_the_ray_that_scintillates_has_two_edges(flight):
    found = [b for b in flight.boundaries if b.source == BoundarySource.S4]
    for craft in (0, 1):
        own = [b for b in found if b.spacecraft == craft]
        assert [(b.prn, b.is_entry) for b in own] == [
            (flight.fading, True),
            (flight.fading, False),
        ]
        assert [seconds(b.time) for b in own] == pytest.approx([30.5, 60.5], abs=5.0)
