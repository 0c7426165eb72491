"""Emulated edges of rays: those that count lie at the walls, errors are as stated, runs repeat."""

import math

import numpy as np
import pytest

from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.time.timescales import parse_epoch
from vtff_sim_bridge.atmosphere.irregularity import IrregularityRegion
from vtff_sim_bridge.atmosphere.ray_edge_emulation import (
    RayEdgeEmulation,
    RayEdgeEmulationSettings,
)

START = parse_epoch("2016-03-21T01:00:00 GPS")
STEP = 10.0
DRIFT = 120.0
REGION = IrregularityRegion(
    "bubble", -0.3, 0.3, 20.0, 20.5, 250e3, 600e3, 0.6, 0.5, drift_east=DRIFT
)


def fly(seed, detection=1.0, time_sigma=0.0):
    """Return emulation, edges, windows, and the times at which the walls are truly crossed."""
    settings = RayEdgeEmulationSettings(detection=detection, time_sigma=time_sigma)
    emulation = RayEdgeEmulation([REGION], START, ["chief"], seed, settings)
    radius, speed = 6.79e6, math.sqrt(3.986e14 / 6.79e6)
    # Over the equator, 6 deg west of the western wall.
    west, width = REGION.longitude_limits(START)
    longitude = west - math.radians(6.0)
    east = np.array([-math.sin(longitude), math.cos(longitude), 0.0])
    position = radius * np.array([math.cos(longitude), math.sin(longitude), 0.0])
    turn = rotation_gcrf_to_itrf(START).T
    state = np.concatenate((turn @ position, turn @ (speed * east)))
    times = np.arange(0.0, 420.0, STEP)
    flown = free_flight(state[np.newaxis], times)[:, 0]
    edges, windows, ahead = [], [], []
    for time, gcrf in zip(times.tolist(), flown, strict=True):
        told, closed = emulation.advance(time, {"chief": gcrf})
        edges += told
        windows += closed
        fixed = rotation_gcrf_to_itrf(START + time) @ gcrf[:3]
        ahead.append(math.atan2(fixed[1], fixed[0]))
    drifted = DRIFT * times / (6378137.0 + 425e3)
    walls = []
    for wall in (west, west + width):
        beyond = (np.array(ahead) - wall - drifted + math.pi) % (2.0 * math.pi) - math.pi
        walls.append(float(np.interp(0.0, beyond, times)))
    return emulation, edges, windows, walls


def test_rays_behind_enter_and_rays_ahead_leave_at_the_walls():
    emulation, edges, _, (entry, exit_) = fly(3)
    is_ahead = np.cos(emulation.azimuths - 0.5 * math.pi) > 0.0
    low_cut = 2.5e3 / 7e3 + 1.5  # half of the taper of a ray, and a second of sampling
    entries = {e.ray: e.time for e in edges if e.is_entry}
    exits = {e.ray: e.time for e in edges if not e.is_entry}
    assert set(entries) == set(range(10))
    for ray in range(10):
        if is_ahead[ray]:
            assert entries[ray] <= entry + low_cut
            assert abs(exits[ray] - exit_) <= low_cut + 0.5
        else:
            assert abs(entries[ray] - entry) <= low_cut + 0.5
            assert exits.get(ray, math.inf) >= exit_ - low_cut


def test_indices_are_those_of_the_region():
    _, _, windows, (entry, exit_) = fly(3)
    inside = [w for w in windows if entry + 15.0 < w.time < exit_ - 5.0]
    outside = [w for w in windows if w.time < entry - 100.0]
    assert inside
    assert np.mean([w.s4 for w in inside]) == pytest.approx(0.6, abs=0.03)
    assert all((w.s4 < 0.2).all() for w in outside)


def test_errors_are_as_stated():
    times, told = [], 0
    for seed in range(6):
        _, exact, _, _ = fly(seed)
        _, edges, _, _ = fly(seed, detection=0.8, time_sigma=2.0)
        reference = {(e.ray, e.is_entry): e.time for e in exact}
        told += len(edges) / len(exact)
        times += [e.time - reference[e.ray, e.is_entry] for e in edges]
    assert 0.65 < told / 6.0 < 0.95
    assert 1.5 < np.std(times) < 2.5


def test_equal_seeds_repeat():
    first, second, other = (fly(seed, 0.9, 1.0)[1] for seed in (4, 4, 5))
    assert [(e.time, e.ray) for e in first] == [(e.time, e.ray) for e in second]
    assert [(e.time, e.ray) for e in first] != [(e.time, e.ray) for e in other]
