"""Density between two drawn spacecraft whose phases are interrupted."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from formation_drawing import START, DrawnFormation, layer
from formation_simulation import mean_density

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_gnss.constants import SYSTEM_GPS
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.signals import SignalKey, carrier_frequency_hz
from vtff_iono.density import constant_check
from vtff_iono.density.constant_check import ConstantCheck
from vtff_iono.density.filter.settings import DensitySettings
from vtff_iono.density.formation_density import FormationDensity
from vtff_iono.density.integer_resolution import IntegerResolver
from vtff_iono.density.link_means import LinkMeans, StretchRows
from vtff_iono.density.phase_differences import DEVIATION_SQUARED
from vtff_iono.density.phase_stretches import LinkSignals, PhaseStretch
from vtff_iono.edges.vertical_edges import VerticalEdgeFinder
from vtff_iono.formation_ionosphere import FormationIonosphere
from vtff_iono.geometry.satellite_geometry import satellite_geometry

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


@pytest.mark.parametrize(("relative_sigma", "latest"), [(0.02, 2), (np.inf, 40)])
def test_relative_navigation_gives_integers_back_at_once(relative_sigma, latest):
    """After a slip of a satellite that relative navigation does not fix again.

    A wide lane of the codes is off by a third of a cycle; a range is known to centimetres.
    """
    drawn = DrawnFormation(lambda t: 500e3 - 200.0 * t, layer(), relative_sigma=relative_sigma)
    before = process(drawn)[SLIP - 1]
    prn = int(before.prn[np.flatnonzero(np.isfinite(before.epoch.density_satellite))[-1]])
    densities = process(dataclasses.replace(drawn, slips={(1, prn): SLIP}))
    seconds = [
        second
        for second, density in densities.items()
        if second > SLIP and np.isfinite(density.epoch.density_satellite[density.prn == prn]).any()
    ]
    assert SLIP + 1 <= seconds[0] <= SLIP + latest
    assert seconds == list(range(seconds[0], seconds[-1] + 1))


def test_the_constant_outlives_an_interruption_of_all_satellites():
    """Relative navigation fixes the integers of phases that all begin anew, with another reference.

    The density goes on in the same datum, long before patience with integers that nothing connects
    would end.
    """
    drawn = DrawnFormation(lambda t: 500e3 - 200.0 * t, layer(), relative_sigma=0.02)
    slips = {(1, e.prn): SLIP for e in drawn.ephemerides(DURATION)}
    drawn = dataclasses.replace(drawn, slips=slips, fixed_again=SLIP + 2.0)
    densities = {
        second: density
        for second, density in process(drawn).items()
        if np.isfinite(density.epoch.density)
    }
    after = [second for second in densities if second > SLIP]
    assert SLIP + 2 <= after[0] <= SLIP + 5
    assert len({density.datum for density in densities.values()}) == 1
    for second in after:
        density = densities[second]
        chief, deputy = drawn.altitudes(np.array((density.time - START.nanoseconds) * 1e-9))
        true = mean_density(*drawn.profile, deputy, chief)
        assert abs(density.epoch.density - true) < 4.0 * density.epoch.sigma


def test_a_cycle_of_both_signals_by_which_all_integers_are_off_is_found(monkeypatch):
    """All integers are found again one too large, which neither wide lanes nor codes contradict."""
    find_shift = IntegerResolver.find_shift

    def find_wrong_shift(resolver, *arguments):
        found = find_shift(resolver, *arguments)
        return None if found is None else (found[0] + 1.0, found[1] + 1.0)

    monkeypatch.setattr(IntegerResolver, "find_shift", find_wrong_shift)
    slips = {(1, prn): SLIP for prn in range(1, 33)}
    drawn = DrawnFormation(
        lambda t: 500e3 - 200.0 * t,
        layer(),
        relative_sigma=0.02,
        slips=slips,
        fixed_again=SLIP + 2.0,
    )
    densities = {
        second: density
        for second, density in process(drawn).items()
        if np.isfinite(density.epoch.density)
    }
    after = [second for second in densities if second > SLIP]
    assert len(after) > 20
    # Densities before and after are not compared: they have not the same constant.
    assert {densities[second].datum for second in after} == {densities[SLIP - 1].datum + 1}
    for second in after:
        density = densities[second]
        chief, deputy = drawn.altitudes(np.array((density.time - START.nanoseconds) * 1e-9))
        true = mean_density(*drawn.profile, deputy, chief)
        assert abs(density.epoch.density - true) < 4.0 * density.epoch.sigma


def test_what_all_contents_may_be_off_by_is_in_the_sigma_until_that_is_decided(monkeypatch):
    """All integers are found again one too large, and whatever contents say decides nothing."""
    find_shift = IntegerResolver.find_shift

    def find_wrong_shift(resolver, *arguments):
        found = find_shift(resolver, *arguments)
        return None if found is None else (found[0] + 1.0, found[1] + 1.0)

    monkeypatch.setattr(IntegerResolver, "find_shift", find_wrong_shift)
    monkeypatch.setattr(constant_check, "_MARGIN_OF_SHIFT", np.inf)
    monkeypatch.setattr(constant_check, "_DOUBT_OF_SHIFT", np.inf)
    slips = {(1, prn): SLIP for prn in range(1, 33)}
    drawn = DrawnFormation(
        lambda t: 500e3 - 200.0 * t,
        layer(),
        relative_sigma=0.02,
        slips=slips,
        fixed_again=SLIP + 2.0,
    )
    densities = process(drawn)
    after = [s for s in densities if s > SLIP and np.isfinite(densities[s].epoch.density)]
    assert len(after) > 10
    for second in after:
        density = densities[second]
        chief, deputy = drawn.altitudes(np.array((density.time - START.nanoseconds) * 1e-9))
        error = density.epoch.density - mean_density(*drawn.profile, deputy, chief)
        assert abs(error) > 4.0 * density.epoch.common_sigma
        assert abs(error) < 2.0 * density.epoch.sigma < 4.0 * abs(error)
        # Nothing of it is in what edges use.
        parts = density.epoch.fast_sigma, density.epoch.common_sigma
        assert np.hypot(*parts) < 0.5 * density.epoch.sigma


def test_integers_that_become_wrong_while_phases_go_on_are_counted(monkeypatch):
    """The content of a satellite leaves the others by a cycle of both signals within two seconds.

    Nothing jumps, and a wrong integer that relative navigation brings is none that has changed.
    """
    counted = []
    add_steps = ConstantCheck.add_steps

    def see(check, steps, satellites):
        counted.append((steps, satellites))
        add_steps(check, steps, satellites)

    monkeypatch.setattr(ConstantCheck, "add_steps", see)
    drawn = DrawnFormation(lambda t: 500e3 - 200.0 * t, layer(), relative_sigma=0.02)
    before = process(drawn)[SLIP - 1]
    prn = int(before.prn[np.flatnonzero(np.isfinite(before.epoch.density_satellite))[-1]])
    assert [steps for steps, _ in counted if steps] == []
    counted.clear()
    process(dataclasses.replace(drawn, slips={(1, prn): SLIP}), stale_prn=prn)
    assert [steps for steps, _ in counted if steps] == []
    counted.clear()
    wound = {prn: lambda t: 0.513 / drawn.lag * np.maximum(t - SLIP, 0.0)}
    process(dataclasses.replace(drawn, extra_content=wound))
    assert [steps for steps, _ in counted if steps] == [1]
    assert sum(satellites for _, satellites in counted) < 10


def test_a_constant_is_not_given_up_for_integers_that_codes_contradict():
    """All phases begin anew; relative navigation is 10 m off then, and its integers fit that."""
    slips = {(1, prn): SLIP for prn in range(1, 33)}
    drawn = DrawnFormation(
        lambda t: 500e3 - 200.0 * t, layer(), slips=slips, fixed_again=SLIP + 2.0, code_sigma=3.0
    )
    store = EphemerisStore(drawn.ephemerides(DURATION))
    prns = np.arange(1, 33, dtype=np.uint8)
    at = np.full(len(prns), (START + SLIP).nanoseconds)
    place = np.repeat(drawn.position(0, np.array([SLIP])), len(prns), axis=0)
    elevation = satellite_geometry(store, at, np.zeros_like(prns), prns, place).elevation
    error = dict(zip(prns.tolist(), 10.0 * np.sin(elevation), strict=True))
    formation = FormationIonosphere()
    for ephemeris in drawn.ephemerides(DURATION):
        formation.add_ephemeris(ephemeris)
    densities = []
    for second in drawn.seconds(DURATION, 0.1):
        wrong = {
            key: cycles + round(error[key.prn] * carrier_frequency_hz(0, key.band) / SPEED_OF_LIGHT)
            for key, cycles in second.integers[0].items()
        }
        if second.time > (START + SLIP).nanoseconds:
            second = dataclasses.replace(second, integers=(wrong,))
        densities += formation.process(second).density[0]
    assert {density.datum for density in densities} == {densities[0].datum}
    for density in densities:
        chief, deputy = drawn.altitudes(np.array((density.time - START.nanoseconds) * 1e-9))
        true = mean_density(*drawn.profile, deputy, chief)
        # Nothing, NaN, is told where nothing is known.
        assert not abs(density.epoch.density - true) > 4.0 * density.epoch.sigma


def test_integers_tell_the_densities_of_the_seconds_before_they_were_found(monkeypatch):
    """Signals that an interruption of all has made new go on until relative navigation fixes them.

    Walls are looked for in the densities of these seconds too, but nobody is told them late.
    """
    drawn = DrawnFormation(lambda t: 500e3 - 200.0 * t, layer(), relative_sigma=0.02)
    slips = {(1, e.prn): SLIP for e in drawn.ephemerides(DURATION)}
    fixed_again = SLIP + 6.0
    drawn = dataclasses.replace(drawn, slips=slips, fixed_again=fixed_again)
    seen = []
    update = VerticalEdgeFinder.update

    def see(finder, positions, results, links, densities):
        seen.extend(densities)
        return update(finder, positions, results, links, densities)

    monkeypatch.setattr(VerticalEdgeFinder, "update", see)
    told = process(drawn)
    times = [density.time for density in seen if np.isfinite(density.epoch.density)]
    assert times == sorted(set(times))
    late = [density for density in seen if density.is_late]
    seconds = [(density.time - START.nanoseconds) * 1e-9 for density in late]
    assert len(late) >= 3
    assert SLIP < seconds[0] < SLIP + 3.0
    assert not any(density.is_late for density in told.values())
    for second, density in zip(seconds, late, strict=True):
        chief, deputy = drawn.altitudes(np.array(second))
        true = mean_density(*drawn.profile, deputy, chief)
        assert abs(density.epoch.density - true) < 4.0 * density.epoch.sigma < 1e12


def test_fluctuations_that_have_ended_do_not_make_densities_unsure():
    """Contents of all satellites fluctuate for 25 s. The deputy is two seconds behind."""

    def fluctuation(prn):
        return lambda t: np.where(t < 25.0, 0.1 * np.sin(2.0 * t + prn), 0.0)

    drawn = DrawnFormation(lambda t: 500e3 - 200.0 * t, layer())
    prns = sorted({e.prn for e in drawn.ephemerides(DURATION)})
    drawn = dataclasses.replace(drawn, extra_content={prn: fluctuation(prn) for prn in prns})
    densities = process(drawn)
    fast_sigma = {second: density.epoch.fast_sigma for second, density in densities.items()}
    before = np.mean([fast_sigma[second] for second in range(15, 24)])
    assert max(fast_sigma[second] for second in range(33, int(DURATION))) < 0.3 * before


def test_each_link_of_a_satellite_adds_to_the_memory_of_its_fluctuation():
    """A satellite has two links in a second, the first of which alone fluctuates."""

    def means(*scatters):
        """Return means of links of one satellite with scatters in TECU^2."""
        signals = [
            LinkSignals(
                *(SignalKey(SYSTEM_GPS, 7, int(code[0]), ord(code[1])) for code in ("1C", second))
            )
            for second in ("2W", "2L")
        ]
        stretches = [
            PhaseStretch(number, of_link, (1, 1), (1, 1), (0.0, 0.0))
            for number, of_link in enumerate(signals)
        ]
        columns = np.zeros((8, 2))
        columns[DEVIATION_SQUARED] = scatters
        return LinkMeans(StretchRows(stretches), np.full(2, 20), columns, least_noise=4e-5)

    def sigma_of_quiet(first_scatter):
        """Return the sigma of a quiet second after one in which the first link fluctuated."""
        density = FormationDensity(DensitySettings(), (1, 2), 0.001)
        density._sigma(means(first_scatter, 0.0))
        return density._sigma(means(0.0, 0.0))

    assert (sigma_of_quiet(1.0) > 10.0 * sigma_of_quiet(0.0)).all()
