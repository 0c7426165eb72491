"""Horizontal edges of single rays: ROTI, gradient of TEC, and variance of the intensity."""

from __future__ import annotations

import numpy as np
import pytest
from formation_drawing import START, DrawnFormation, layer

from vtff_iono.edges.boundary import BoundaryKind, BoundarySource
from vtff_iono.edges.ray_edges import RayEdgeFinder, RayEdgeSettings
from vtff_iono.spacecraft.spacecraft_ionosphere import SpacecraftIonosphere

ALTITUDE = 250e3
DURATION = 40.0


def empty_space(**changes):
    """Return a formation in a circular orbit without electrons and noise."""
    altitude, density = layer()
    return DrawnFormation(
        lambda t: np.full_like(t, ALTITUDE),
        (altitude, 0.0 * density),
        phase_sigma=0.0,
        **changes,
    )


def edges(drawn, interval=0.5, duration=DURATION):
    """Return the edges that the chief finds, and the highest satellite."""
    spacecraft, finder = SpacecraftIonosphere(), RayEdgeFinder(0, RayEdgeSettings())
    for ephemeris in drawn.ephemerides(duration):
        spacecraft.add_ephemeris(ephemeris)
    boundaries = []
    for second in drawn.seconds(duration, interval):
        block = second.observations[0]
        position = drawn.position(0, (block.time - START.nanoseconds) * 1e-9)
        boundaries += finder.update(spacecraft.process((block,), position))[0]
    return boundaries


def highest_satellite():
    drawn = empty_space()
    spacecraft = SpacecraftIonosphere()
    for ephemeris in drawn.ephemerides(DURATION):
        spacecraft.add_ephemeris(ephemeris)
    block = next(drawn.seconds(DURATION, 1.0)).observations[0]
    position = drawn.position(0, np.ones(len(block.time)))
    (result,) = spacecraft.process((block,), position).results
    return result.epoch.links[int(np.argmax(result.epoch.elevation))].prn


@pytest.mark.parametrize(("factor", "count"), [(0.8, 0), (1.25, 1)])
def test_gradient_of_tec_against_its_threshold(factor, count):
    """0.05 TECU/km along the path of the spacecraft."""
    drawn = empty_space()
    speed = np.linalg.norm(np.diff(drawn.position(0, np.array([0.0, 1.0])), axis=0))
    rate = factor * 0.05e-3 * speed  # TECU/s
    prn = highest_satellite()
    drawn.extra_content = {prn: lambda t: rate * np.maximum(t - 10.0, 0.0)}
    # The sudden onset also shows in ROTI.
    found = [edge for edge in edges(drawn) if edge.source == BoundarySource.TEC_GRADIENT]
    assert [(edge.prn, edge.is_entry) for edge in found] == count * [(prn, True)]
    for edge in found:
        assert (edge.kind, edge.spacecraft, edge.system) == (BoundaryKind.HORIZONTAL, 0, 0)
        # The onset breaks the arc; the fifth rate after it is that of this second.
        assert (edge.time - START.nanoseconds) * 1e-9 == pytest.approx(16.0, abs=1.0)
        # Below the irregularity the place is the pierce point at 320 km.
        assert np.linalg.norm(edge.position_itrf) == pytest.approx(6378137.0 + 320e3, abs=100.0)


@pytest.mark.parametrize(("amplitude", "count"), [(0.029, 0), (0.032, 1)])
def test_roti_against_its_threshold(amplitude, count):
    """Rates of +a and -a in turn have a sample standard deviation of 1.095 a: 2 TECU/min at 0.0304.

    The deviation with n in place of n - 1 would be 0.98 a, and reach 2 TECU/min at 0.0340.
    """
    prn = highest_satellite()
    drawn = empty_space()
    # Means of seconds alternate between a and 0.
    drawn.extra_content = {
        prn: lambda t: np.where(np.ceil(t) % 2 == 0, amplitude, 0.0) * (t > 10.0)
    }
    found = edges(drawn)
    assert [(edge.source, edge.prn, edge.is_entry) for edge in found] == count * [
        (BoundarySource.ROTI, prn, True)
    ]


def test_vertical_motion_is_no_edge_of_a_ray():
    """A climb through a layer changes the contents of all rays at once, by 20 times the limits."""
    drawn = DrawnFormation(lambda t: 330e3 + 250.0 * t, layer(), phase_sigma=0.0)
    assert edges(drawn) == []


def test_fading_of_one_ray_at_20_hz():
    prn = highest_satellite()
    drawn = empty_space(fades={prn: (10.0, 20.0, 0.4)})
    found = edges(drawn, 0.05)
    assert [(edge.source, edge.prn, edge.is_entry) for edge in found] == [
        (BoundarySource.S4, prn, True),
        (BoundarySource.S4, prn, False),
    ]
    times = [(edge.time - START.nanoseconds) * 1e-9 for edge in found]
    assert times == pytest.approx([10.5, 20.5], abs=2.0)
    assert edges(empty_space(), 0.05, 20.0) == []
