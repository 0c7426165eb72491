"""Observables of simulated receivers without noise against geometry computed another way."""

from __future__ import annotations

import dataclasses

import gnss_emulator_support as support
import numpy as np
import pytest

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.vectors import FloatArray
from vtff_gnss import constants as c
from vtff_gnss.constants import EARTH_ROTATION_RATE_BROADCAST
from vtff_gnss.orbits.broadcast_orbit import EphemerisTable
from vtff_gnss.signals import carrier_wavelength
from vtff_sim_bridge.atmosphere.density_models import ChapmanLayer, chapman_profile
from vtff_sim_bridge.gnss.receiver_clock import ClockModel
from vtff_sim_bridge.receiver.measurements import Measurements

SECONDS = 8


def reference_ranges(run: support.Run, measured: Measurements, index: int, motion) -> FloatArray:
    """Return range less satellite clock, m, of all satellites at an epoch of the last second."""
    last = measured.first_epoch + len(measured.signals.clock_offset) - 1
    before = (measured.first_epoch + index - last) / 20.0 - measured.signals.clock_offset[index]
    state = motion.extrapolate(before + 1.0)
    time = run.start + last / 20.0
    table = EphemerisTable(measured.signals.plan.ephemerides)
    result = []
    for row in range(len(table)):
        distance, clock = emission_at(table, row, time, before, np.array(state.position_itrf))
        result.append(distance - SPEED_OF_LIGHT * clock)
    return np.array(result)


def emission_at(table, row, time, before, position) -> tuple[float, float]:
    """Return range and satellite clock for reception at ``time + before``."""
    travel = 0.07
    for _ in range(8):
        states = table.states(time, before - travel)
        angle = EARTH_ROTATION_RATE_BROADCAST * travel
        x, y, z = states.position_itrf[row]
        turned = np.array(
            [
                np.cos(angle) * x + np.sin(angle) * y,
                np.cos(angle) * y - np.sin(angle) * x,
                z,
            ]
        )
        distance = float(np.linalg.norm(turned - position))
        travel = distance / SPEED_OF_LIGHT
    return distance, float(states.clock_offset[row])


@pytest.fixture(scope="module")
def motions():
    return support.orbit_motions([support.CHIEF_GCRF, support.DEPUTY_GCRF], SECONDS)


@pytest.fixture(scope="module")
def free_run(motions) -> support.Run:
    """Run without noise but with real clocks, group delays and all signals."""
    base = support.with_receivers(
        support.configuration(),
        clock=ClockModel("TCXO", initial_offset=3e-7),
        cn0_zenith_dbhz={n: 45.0 for n in ("G1C", "G2W", "G5Q", "E1C", "E5Q", "E7Q")},
    )
    return support.Run(base, motions, support.LOGS).all()


def test_double_differences_are_integers_and_code_is_exact(free_run, motions):
    index = 13
    singles = {}
    for number, name in enumerate(("chief", "deputy")):
        measured = free_run.measurements(name)
        geometry = reference_ranges(free_run, measured, index, motions[SECONDS - 1][number])
        epoch = free_run.epochs(name)[measured.first_epoch + index]
        place = {satellite: k for k, satellite in enumerate(measured.signals.plan.satellites)}
        wavelength = carrier_wavelength(epoch.system, epoch.band)
        for key, row in support.signal_index(epoch).items():
            base = geometry[place[key[:2]]]
            phase = epoch.carrier_phase_cycles[row] * wavelength[row] - base
            singles[name, key] = (phase, epoch.pseudorange[row] - base, wavelength[row])
    common = {key for _, key in singles if ("chief", key) in singles and ("deputy", key) in singles}
    compared = 0
    for system, band in {(key[0], key[2]) for key in common}:
        keys = sorted(key for key in common if (key[0], key[2]) == (system, band))
        for key in keys[1:]:
            phase, code, wavelength = (
                np.array(singles["chief", key])
                - singles["deputy", key]
                - (np.array(singles["chief", keys[0]]) - singles["deputy", keys[0]])
            )
            wavelength = singles["chief", key][2]
            cycles = phase / wavelength
            assert abs(cycles - round(cycles)) * wavelength < 1e-4, key
            assert abs(code) < 1e-3, key
            compared += 1
    assert compared >= 36


def test_pseudorange_has_clock_and_group_delay(free_run, motions):
    """Undifferenced: range, both clocks and TGD as the interface documents define them."""
    index = 13
    measured = free_run.measurements("chief")
    geometry = reference_ranges(free_run, measured, index, motions[SECONDS - 1][0])
    epoch = free_run.epochs("chief")[measured.first_epoch + index]
    place = {satellite: k for k, satellite in enumerate(measured.signals.plan.satellites)}
    clock = SPEED_OF_LIGHT * measured.signals.clock_offset[index]
    gamma = (c.FREQUENCY_L1 / c.FREQUENCY_L2) ** 2
    checked = 0
    for key, row in support.signal_index(epoch).items():
        ephemeris = measured.signals.plan.ephemerides[place[key[:2]]]
        factor = {(0, 1): 1.0, (0, 2): gamma}.get((key[0], key[2]))
        if factor is None:
            continue
        expected = (
            geometry[place[key[:2]]] + clock + SPEED_OF_LIGHT * factor * ephemeris.group_delay
        )
        assert epoch.pseudorange[row] == pytest.approx(expected, abs=1e-3)
        checked += 1
    assert checked >= 16


def test_group_delay_of_the_ionosphere(free_run):
    signals = free_run.measurements("chief").signals
    plan, content = signals.plan, np.full(signals.slant_tec_tecu.shape, 10.0)
    receiver = free_run.set.receivers["chief"].configuration
    _, code, phase = plan.levels_and_delays(signals.line_of_sight, content, receiver)
    delay = [code[:, plan.frequency == each] for each in (c.FREQUENCY_L1, c.FREQUENCY_L2)]
    # 9.51775 TECU for a metre between L1 and L2; 0.1624 m per TECU on L1.
    assert 10.0 / (delay[1].min() - delay[0].max()) == pytest.approx(9.51775, rel=1e-5)
    assert 10.0 / (delay[1].max() - delay[0].min()) == pytest.approx(9.51775, rel=1e-5)
    assert delay[0] == pytest.approx(1.624, abs=1e-3)
    assert np.array_equal(phase, -code)


def test_doppler_is_the_rate_of_the_phase(free_run):
    epochs = free_run.epochs("chief")
    for before, epoch in zip(epochs[100:120], epochs[101:121], strict=True):
        first, second = support.signal_index(before), support.signal_index(epoch)
        for key in first.keys() & second.keys():
            i, j = first[key], second[key]
            change = epoch.carrier_phase_cycles[j] - before.carrier_phase_cycles[i]
            doppler = -change / 0.05
            wavelength = float(carrier_wavelength([key[0]], [key[2]])[0])
            # The Doppler is that at the end of the interval: half an interval of acceleration.
            mean = 0.5 * (float(before.doppler_hz[i]) + float(epoch.doppler_hz[j]))
            assert doppler * wavelength == pytest.approx(mean * wavelength, abs=1.0)


def test_doppler_without_clock_noise_is_exact(motions):
    run = support.Run(support.configuration(), motions, support.LOGS).all()
    epochs = run.epochs("deputy")
    first, second = epochs[100], epochs[101]
    places, later = support.signal_index(first), support.signal_index(second)
    for key, i in places.items():
        j = later[key]
        wavelength = float(carrier_wavelength([key[0]], [key[2]])[0])
        change = second.carrier_phase_cycles[j] - first.carrier_phase_cycles[i]
        mean = 0.5 * (float(first.doppler_hz[i]) + float(second.doppler_hz[j]))
        # Doppler is a 32-bit number: 2e-3 Hz at 30 kHz.
        assert -change / 0.05 * wavelength == pytest.approx(mean * wavelength, abs=1e-3)


def test_slant_tec_delays_code_and_advances_phase(motions):
    profile = chapman_profile([ChapmanLayer(9e11, 378e3, 35e3, 55e3)])
    base = support.configuration()
    calm = support.Run(base, motions, support.LOGS).all()
    dense = support.Run(dataclasses.replace(base, profile=profile), motions, support.LOGS).all()
    epoch, reference = dense.epochs("chief")[77], calm.epochs("chief")[77]
    frequency = {1: c.FREQUENCY_L1, 2: c.FREQUENCY_L2}
    places = support.signal_index(epoch)
    geometry = ray_integrals(dense, motions, profile)
    assert places.keys() == support.signal_index(reference).keys()
    wavelength = carrier_wavelength(epoch.system, epoch.band)
    delays = epoch.pseudorange - reference.pseudorange
    advances = (reference.carrier_phase_cycles - epoch.carrier_phase_cycles) * wavelength
    for key, row in places.items():
        per_metre = frequency[key[2]] ** 2 / 40.308e16
        expected = geometry[key[:2]]
        assert delays[row] * per_metre == pytest.approx(expected, abs=0.01)
        assert advances[row] * per_metre == pytest.approx(expected, abs=0.01)
        assert expected > 1.0


def ray_integrals(run, motions, profile) -> dict[tuple[int, int], float]:
    """Return slant TEC at epoch 77 by summing the density along straight rays, TECU."""
    index, second = 77, 3
    state = motions[second][0].extrapolate(index / 20.0 - second)
    receiver = np.array(state.position_itrf)
    measured = run.measurements("chief")
    table = EphemerisTable(measured.signals.plan.ephemerides)
    time = run.start + index / 20.0
    # Altitude as the ellipsoidal model has it: spheroids through 350 km above WGS-84.
    semi_major, semi_minor, height = 6378137.0, 6356752.314245, 350e3
    stretch = np.array([1.0, 1.0, (semi_major + height) / (semi_minor + height)])
    result = {}
    for row, satellite in enumerate(measured.signals.plan.satellites):
        travel = emission_at(table, row, time, 0.0, receiver)[0] / SPEED_OF_LIGHT
        states = table.states(time, -travel)
        angle = EARTH_ROTATION_RATE_BROADCAST * travel
        x, y, z = states.position_itrf[row]
        position = np.array(
            [np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x, z]
        )
        length = float(np.linalg.norm(position - receiver))
        distance = np.linspace(0.0, min(length, 1.2e7), 400_001)
        points = receiver + distance[:, None] * (position - receiver) / length
        altitude = np.linalg.norm(points * stretch, axis=1) - semi_major
        density = profile.density(altitude)
        step = distance[1]
        result[satellite] = float(density.sum() - 0.5 * (density[0] + density[-1])) * step / 1e16
    return result
