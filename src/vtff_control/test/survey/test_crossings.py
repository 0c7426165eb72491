"""Crossings of walls from edges of rays: which rays count, what supports them, what is false."""

import math

import numpy as np
import pytest

from vtff_control.survey.crossings import CrossingFinder, RayEdge

# Eight rays: four ahead (east) and four behind (west), as azimuths from north over east.
AZIMUTHS = {(0, n): math.radians(a) for n, a in enumerate((45, 70, 100, 130, 220, 250, 280, 310))}
AHEAD = [(0, n) for n in range(4)]
BEHIND = [(0, n) for n in range(4, 8)]


def finder(s4=0.5, ahead=(950.0, 2000.0), behind=(1000.0, 2000.0)):
    """Return a finder that has heard windows of 10 s; rays scintillate between two times."""
    found = CrossingFinder()
    for end in np.arange(800.0, 1300.0, 10.0):
        values = {
            ray: s4 if begin < end and end - 10.0 < until else 0.02
            for rays, (begin, until) in ((AHEAD, ahead), (BEHIND, behind))
            for ray in rays
        }
        found.add_scintillation(end - 10.0, end, "chief", AZIMUTHS, values)
    return found


def add(found, rays, times, is_entry=True):
    for ray, time in zip(rays, times, strict=True):
        found.add_edge(RayEdge(time, 1.0, "chief", ray, is_entry))


def test_entry_is_that_of_the_rays_behind():
    found = finder()
    # Rays ahead meet the wall up to 40 s earlier; they do not move the crossing.
    add(found, AHEAD, (960.0, 970.0, 980.0, 990.0))
    add(found, BEHIND, (1000.5, 999.0, 1001.0, 1000.0))
    (crossing,) = found.take(1100.0)
    assert crossing.is_supported
    assert crossing.is_entry
    assert crossing.support == 4
    assert abs(crossing.time - 1000.25) < 0.3
    assert 0.4 < crossing.time_sigma < 1.0


def test_exit_is_that_of_the_rays_ahead():
    found = finder(ahead=(0.0, 1000.0), behind=(0.0, 1040.0))
    add(found, AHEAD, (1000.0, 1001.0, 1000.0, 999.0), is_entry=False)
    add(found, BEHIND, (1010.0, 1020.0, 1030.0, 1035.0), is_entry=False)
    (crossing,) = found.take(1200.0)
    assert (crossing.is_entry, crossing.is_supported) == (False, True)
    assert abs(crossing.time - 1000.0) < 0.6


def test_nothing_is_taken_before_others_may_have_told():
    found = finder()
    add(found, BEHIND, (1000.0,) * 4)
    assert found.take(1059.0) == []
    assert len(found.take(1060.0)) == 1
    assert found.take(1200.0) == []


@pytest.mark.parametrize(
    ("rays", "scintillation"),
    [
        (BEHIND[:1], {}),  # one ray alone, although there is scintillation
        (BEHIND, {"s4": 0.05}),  # all rays, but no scintillation
        (BEHIND, {"ahead": (1000.0, 2000.0)}),  # interference: all rays at once
        (BEHIND, {"ahead": (0.0, 2000.0), "behind": (0.0, 2000.0)}),  # within a bubble
        (BEHIND, {"behind": (2000.0, 2000.0)}),  # the rays behind stay quiet
    ],
)
def test_false_edge_has_no_support(rays, scintillation):
    found = finder(**scintillation)
    add(found, rays, (1000.0,) * len(rays))
    (crossing,) = found.take(1200.0)
    assert not crossing.is_supported


def test_interference_has_no_end_either():
    found = finder(ahead=(990.0, 1010.0), behind=(990.0, 1010.0))
    add(found, AHEAD, (1010.0,) * 4, is_entry=False)
    (crossing,) = found.take(1200.0)
    assert not crossing.is_supported


def test_edges_without_scintillation_messages_have_no_support():
    found = CrossingFinder()
    add(found, BEHIND, (1000.0,) * 4)
    (crossing,) = found.take(1200.0)
    assert not crossing.is_supported


def test_a_late_ray_is_another_crossing():
    found = finder()
    add(found, BEHIND, (1000.0, 1000.0, 1000.0, 1020.0))
    first, second = found.take(1200.0)
    assert (first.support, second.support) == (3, 1)
    assert first.is_supported
    assert not second.is_supported


def test_an_edge_that_is_told_an_hour_late_is_no_crossing():
    found = finder()
    add(found, BEHIND, (1000.0,) * 4)
    assert len(found.take(1100.0)) == 1
    add(found, BEHIND[:1], (1001.0,))
    assert found.take(4700.0) == []
