"""Usable signals, single differences, group delays, lines of sight at the time of reception."""

from __future__ import annotations

import numpy as np
import pytest
from cdgps_test_support import CHIEF, START, broadcast_ephemerides

from vtff_dynamics.constants import GM_EARTH, SPEED_OF_LIGHT
from vtff_dynamics.frames.earth import state_gcrf_to_itrf
from vtff_dynamics.orbit.force_model import ForceModel
from vtff_dynamics.orbit.propagator import Propagator
from vtff_gnss import constants as c
from vtff_gnss.observations import OBSERVATION_COLUMNS as TYPES
from vtff_gnss.observations import ObservationEpoch
from vtff_gnss.orbits.ephemeris_selection import EphemerisStore
from vtff_gnss.orbits.line_of_sight import lines_of_sight
from vtff_gnss.signals import satellite_number, signal_from_number
from vtff_nav.relative.common.measurements import (
    DEFAULT_BANDS,
    MeasurementNoise,
    SignalReader,
    code_group_delay,
    compute_geometry,
    form_single_differences,
    satellite_mask,
    satellite_numbers,
    upper_median,
)
from vtff_nav.relative.common.signal_bands import parse_bands

USABLE = c.FLAG_CODE_VALID | c.FLAG_PHASE_VALID | c.FLAG_PARITY_KNOWN
# System, PRN, RINEX code and flags, in the order of a receiver, which is no order.
SIGNALS = [
    (c.SYSTEM_GALILEO, 11, "5Q", USABLE),
    (c.SYSTEM_GPS, 7, "2W", USABLE),
    (c.SYSTEM_GPS, 7, "1C", USABLE | c.FLAG_HALF_CYCLE_ADDED),
    (c.SYSTEM_GPS, 7, "2S", USABLE),
    (c.SYSTEM_GPS, 3, "1C", USABLE & ~c.FLAG_PHASE_VALID),
    (c.SYSTEM_GPS, 3, "2W", USABLE | c.FLAG_LOCK_LOST),
    (c.SYSTEM_GLONASS, 7, "1C", USABLE),
    (c.SYSTEM_GPS, 9, "1C", USABLE),
]


def epoch_of(signals=SIGNALS, offset: float = 0.0, sigma: float = 0.0) -> ObservationEpoch:
    """Return an epoch; row k has the pseudorange 2e7 + 1000 k + offset and 1e8 + k cycles."""
    count = len(signals)
    rows = np.arange(count)
    columns = {
        "system": [s[0] for s in signals],
        "prn": [s[1] for s in signals],
        "band": [int(s[2][0]) for s in signals],
        "attribute": [ord(s[2][1]) for s in signals],
        "glonass_channel": np.zeros(count),
        "pseudorange": 2e7 + 1000.0 * rows + offset,
        "carrier_phase_cycles": 1e8 + rows,
        "doppler_hz": np.full(count, -100.0),
        "cn0_dbhz": np.full(count, 45.0),
        "pseudorange_sigma": np.full(count, sigma),
        "carrier_phase_sigma_cycles": np.full(count, sigma),
        "lock_time": np.full(count, 30.0),
        "flags": [s[3] for s in signals],
    }
    columns = {name: np.array(columns[name], dtype=kind) for name, kind in TYPES.items()}
    return ObservationEpoch(START, 180, 0, "RANGE", **columns)


def read(epoch: ObservationEpoch, noise: MeasurementNoise | None = None):
    satellites = [(s[0], s[1]) for s in SIGNALS if s[1] != 9]
    numbers = satellite_number(*np.array(satellites).T)
    reader = SignalReader(noise or MeasurementNoise(), DEFAULT_BANDS)
    return reader.read(epoch, satellite_mask(numbers))


def test_one_usable_signal_of_each_carrier_is_read():
    """In the order of satellites and bands; P(Y) before L2C; neither GLONASS nor G09."""
    signals = read(epoch_of())
    assert signals.band.tolist() == [2, 1, 2, 5]
    assert signals.system.tolist() == [c.SYSTEM_GPS] * 3 + [c.SYSTEM_GALILEO]
    expected = satellite_number([0, 0, 0, c.SYSTEM_GALILEO], [3, 7, 7, 11])
    # G03 has no phase on L1.
    assert signals.satellite.tolist() == expected.tolist()
    assert chr(signal_from_number(signals.signal[2]).attribute) == "W"
    assert (np.diff(signals.signal) > 0).all()


def test_columns_of_a_signal():
    signals = read(epoch_of())
    row = int(np.flatnonzero(signals.system == c.SYSTEM_GALILEO)[0])
    wavelength = SPEED_OF_LIGHT / c.FREQUENCY_L5
    assert signals.pseudorange[row] == 2e7
    assert signals.carrier_range[row] == pytest.approx(wavelength * 1e8, rel=1e-15)
    assert signals.range_rate[row] == pytest.approx(100.0 * wavelength)
    assert signals.frequency_hz[row] == c.FREQUENCY_L5


def test_sigmas_are_those_of_the_receiver_or_of_the_configuration():
    noise = MeasurementNoise(0.4, 0.002, True, 0.05, 0.0003)
    silent = read(epoch_of(), noise)
    assert set(silent.code_sigma.tolist()) == {0.4}
    assert set(silent.phase_sigma.tolist()) == {0.002}
    stated = read(epoch_of(sigma=0.25), noise)
    assert set(stated.code_sigma.tolist()) == {0.25}
    np.testing.assert_allclose(stated.phase_sigma, 0.25 * stated.wavelength)
    small = read(epoch_of(sigma=1e-4), noise)
    assert set(small.code_sigma.tolist()) == {0.05}
    assert set(small.phase_sigma.tolist()) == {0.0003}
    ignored = read(epoch_of(sigma=0.25), MeasurementNoise(0.4, 0.002, False))
    assert set(ignored.code_sigma.tolist()) == {0.4}


def test_noise_grows_towards_the_horizon():
    """a^2 + (b / sin E)^2 with a = b: half of the variance at the zenith is of each."""
    elevation = np.radians([90.0, 30.0, 10.0])
    noise = MeasurementNoise(elevation_noise_ratio=1.0)
    np.testing.assert_allclose(noise.growth(elevation) ** 2, [1.0, 2.5, 17.082], rtol=1e-4)
    np.testing.assert_array_equal(MeasurementNoise().growth(elevation), 1.0)


def test_single_differences_are_deputy_less_chief():
    deputy_signals = [s for s in SIGNALS if s[2] != "5Q"]
    chief = read(epoch_of())
    deputy = read(epoch_of(deputy_signals, offset=12.5))
    differences = form_single_differences(chief, deputy)
    assert [str(key) for key in differences.keys] == ["G03 L2W", "G07 L1C", "G07 L2W"]
    # The rows of the deputy are one less: its first signal is missing.
    np.testing.assert_allclose(differences.code, 12.5 - 1000.0)
    np.testing.assert_allclose(differences.phase, -differences.wavelength, atol=1e-7)
    np.testing.assert_allclose(differences.code_variance, 2.0 * 0.3**2)
    np.testing.assert_allclose(differences.phase_variance, 2.0 * 0.001**2)
    assert differences.half_cycles.tolist() == [0, 3, 0]
    assert differences.is_lock_lost.tolist() == [True, False, False]
    assert differences.is_parity_known.all()
    second = differences.select(np.array([1]))
    assert [str(key) for key in second.keys] == ["G07 L1C"]
    assert second.lock_time.shape == (2, 1)


def test_receivers_with_half_a_cycle_are_told_apart():
    plain = [(*s[:3], USABLE) for s in SIGNALS]
    chief_only = form_single_differences(read(epoch_of()), read(epoch_of(plain)))
    deputy_only = form_single_differences(read(epoch_of(plain)), read(epoch_of()))
    assert max(chief_only.half_cycles) == 1
    assert max(deputy_only.half_cycles) == 2


def test_group_delays_are_those_of_the_interface_documents():
    """IS-GPS-200, 20.3.3.3.3.2, and Galileo OS SIS ICD, 5.1.5, with the I/NAV clock."""
    table = EphemerisStore(broadcast_ephemerides(START, 60.0)).table(START)
    for row, ephemeris in enumerate(table.ephemerides):
        first, second = ephemeris.group_delay, ephemeris.group_delay_secondary
        if ephemeris.system == c.SYSTEM_GPS:
            expected = {1: first, 2: (77 / 60) ** 2 * first, 5: (154 / 115) ** 2 * first}
        else:
            # E1 and E5b of the clock's pair; E5a by its own BGD: BGD(E1,E5b) on E1, from which
            # BGD(E1,E5a) leads to E5a.
            e1 = second
            expected = {1: e1, 7: (154 / 118) ** 2 * second}
            expected[5] = e1 + ((154 / 115) ** 2 - 1.0) * first
        for band, delay in expected.items():
            assert code_group_delay(table, band)[row] == pytest.approx(
                SPEED_OF_LIGHT * delay, rel=1e-12, abs=1e-12
            )
    assert len({e.group_delay for e in table.ephemerides}) > 10


def test_ionosphere_free_pair_of_the_clock_has_no_group_delay():
    """The broadcast clock of GPS is that of L1 and L2, the one of I/NAV that of E1 and E5b."""
    table = EphemerisStore(broadcast_ephemerides(START, 60.0)).table(START)
    for system, band, ratio in ((c.SYSTEM_GPS, 2, 77 / 60), (c.SYSTEM_GALILEO, 7, 154 / 118)):
        rows = table.system == system
        gamma = ratio**2
        first, second = (code_group_delay(table, b)[rows] for b in (1, band))
        np.testing.assert_allclose((gamma * first - second) / (gamma - 1.0), 0.0, atol=1e-9)


@pytest.mark.parametrize("offset", [-1e-3, 1e-3])
def test_receivers_fall_until_the_time_of_reception(offset):
    """Positions are moved as a propagator moves them: 4 um of free fall in a millisecond."""
    table = EphemerisStore(broadcast_ephemerides(START, 60.0)).table(START)
    state = state_gcrf_to_itrf(START, CHIEF)
    seen = compute_geometry(table, START, np.full(2, offset), np.array([state] * 2), np.eye(3))
    crafts = Propagator(START, CHIEF, ForceModel("two_body"), step=abs(offset))
    velocity, position = CHIEF[3:], CHIEF[:3]
    gravity = -GM_EARTH / np.linalg.norm(position) ** 3 * position
    moved = np.concatenate(
        (position + offset * velocity + 0.5 * offset**2 * gravity, velocity + offset * gravity)
    )
    if offset > 0.0:
        np.testing.assert_allclose(crafts.advance(), moved, rtol=0, atol=1e-7)
    at_reception = state_gcrf_to_itrf(START + offset, moved)
    expected = lines_of_sight(
        table, START, np.full(2, offset), np.array([at_reception[:3]] * 2), np.zeros((2, 3))
    )
    np.testing.assert_allclose(seen.range, expected.range, rtol=0, atol=1e-7)
    np.testing.assert_array_equal(seen.satellite, satellite_numbers(table))
    columns = seen.columns(seen.satellite[[4, 2]])
    assert columns.tolist() == [4, 2]


def test_receivers_on_the_ground_do_not_fall():
    table = EphemerisStore(broadcast_ephemerides(START, 60.0)).table(START)
    state = np.array([4157177.0, 671230.0, 4774767.0, 30.0, 0.0, 0.0])
    states = np.array([state] * 2)
    offset = 1e-3
    seen = compute_geometry(table, START, np.full(2, offset), states, np.eye(3))
    moved = states[:, :3] + offset * states[:, 3:]
    expected = lines_of_sight(table, START, np.full(2, offset), moved, states[:, 3:])
    np.testing.assert_array_equal(seen.range, expected.range)


def test_upper_median():
    assert upper_median(np.array([3.0, 1.0, 2.0])) == 2.0
    assert upper_median(np.array([4.0, 1.0, 3.0, 2.0])) == 3.0


def test_names_of_carriers():
    assert parse_bands(["G5", "g1", "E7", "G1"]) == {c.SYSTEM_GPS: (1, 5), c.SYSTEM_GALILEO: (7,)}
    for names, words in (
        (["R1"], "'R1': G or E"),
        (["G1C"], "'G1C'"),
        (["G9"], "no such carrier"),
        ([], "at least one"),
    ):
        with pytest.raises(ValueError, match=words):
            parse_bands(names)
