"""Density between two drawn spacecraft when integers of the filter do not belong to the phases."""

from __future__ import annotations

import dataclasses

import numpy as np
from formation_drawing import START, DrawnFormation, layer
from formation_simulation import mean_density

from vtff_iono.formation_ionosphere import FormationIonosphere

DURATION, SLIP = 45.0, 15.0


def process(drawn, stale_prn=None, prn_without_orbit=None):
    """Return the densities by second; a satellite `stale_prn` keeps the integers of the start."""
    formation = FormationIonosphere()
    for ephemeris in drawn.ephemerides(DURATION):
        if ephemeris.prn != prn_without_orbit:
            formation.add_ephemeris(ephemeris)
    at_first, densities = None, {}
    for second in drawn.seconds(DURATION, 0.1):
        at_first = at_first or second.integers[0]
        stale = {key: cycles for key, cycles in at_first.items() if key.prn == stale_prn}
        second = dataclasses.replace(second, integers=({**second.integers[0], **stale},))
        for density in formation.process(second).density[0]:
            densities[round((density.time - START.nanoseconds) * 1e-9 + 0.45)] = density
    return densities


def test_integers_that_a_slip_has_made_wrong_are_refused_and_found_again():
    """Relative navigation keeps the integers of a satellite after a slip of 3 to 49 cycles."""
    drawn = DrawnFormation(lambda t: 500e3 - 200.0 * t, layer())
    before = process(drawn)[SLIP - 1]
    prn = int(before.prn[np.flatnonzero(np.isfinite(before.epoch.density_satellite))[-1]])
    densities = process(dataclasses.replace(drawn, slips={(1, prn): SLIP}), stale_prn=prn)
    used_again = []
    for second in range(int(SLIP) + 1, int(DURATION)):
        density = densities[second]
        chief, deputy = drawn.altitudes(np.array((density.time - START.nanoseconds) * 1e-9))
        true = mean_density(*drawn.profile, deputy, chief)
        assert abs(density.epoch.density - true) < 4.0 * density.epoch.sigma
        own = density.prn == prn
        value, sigma = density.epoch.density_satellite[own], density.epoch.sigma_satellite[own]
        if np.isfinite(value).any():
            used_again.append(second)
            # A wrong integer changes the density of the satellite by 1e12 at least.
            assert abs(value.item() - true) < 4.0 * sigma.item() < 2e12
    assert used_again and used_again[0] <= 40
    assert used_again == list(range(used_again[0], int(DURATION)))


def test_integers_are_found_beside_those_of_a_satellite_without_an_orbit():
    """Integers of a satellite without an ephemeris tell nothing of those of the others."""
    drawn = DrawnFormation(lambda t: 500e3 - 200.0 * t, layer())
    before = process(drawn)[SLIP - 1]
    prns = before.prn[np.isfinite(before.epoch.density_satellite)].tolist()
    drawn = dataclasses.replace(drawn, slips={(1, prns[-1]): SLIP})
    densities = process(drawn, stale_prn=prns[-1], prn_without_orbit=prns[0])
    last = densities[int(DURATION) - 1]
    used = last.prn[np.isfinite(last.epoch.density_satellite)].tolist()
    assert prns[-1] in used
    assert prns[0] not in used
