"""Statistics, reproducibility and frozen pattern of the scintillation model."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.frames.earth import state_gcrf_to_itrf
from vtff_dynamics.frames.rtn import deputy_state_gcrf
from vtff_dynamics.time.timescales import parse_epoch
from vtff_gnss.constants import FREQUENCY_L1, FREQUENCY_L2, FREQUENCY_L5
from vtff_sim_bridge.atmosphere.scintillation import (
    BUTTERWORTH_DECORRELATION,
    AlongTrackAxis,
    ScintillationField,
    s4_at_frequency,
    scintillation_gain,
    tapered_s4,
)
from vtff_sim_bridge.gnss.propagation import RegionCrossing, ScintillatedLinks

EPOCH_RATE = 20.0


@pytest.fixture(scope="module")
def hours():
    """Return xi of eight streams over one hour at 20 Hz, tau0 = 0.5 s, shape (8, 72000)."""
    field = ScintillationField(0.5, [7, 1])
    times = np.arange(72000) / EPOCH_RATE
    return np.stack([field.fluctuation(stream, times) for stream in range(8)])


def s4_of(gain):
    """Return the index of complex gains along the last axis."""
    power = np.abs(gain) ** 2
    return power.std(axis=-1) / power.mean(axis=-1)


@pytest.mark.parametrize("s4", [0.2, 0.4, 0.6, 0.8])
def test_s4_of_one_hour(hours, s4):
    measured = s4_of(scintillation_gain(hours, s4))
    assert measured.mean() == pytest.approx(s4, abs=0.01)
    # An hour has about 5000 independent samples of the power; 3 sigma of one hour.
    assert np.abs(measured - s4).max() < 3.0 * 0.0115 * s4


@pytest.fixture(scope="module")
def fast_hour():
    """Return xi of one stream over one hour at 20 Hz, tau0 = 0.1 s, shape (72000,)."""
    field = ScintillationField(0.1, [7, 2])
    return field.fluctuation(3, np.arange(72000) / EPOCH_RATE)


@pytest.mark.parametrize("s4", [0.2, 0.4, 0.6, 0.8])
def test_s4_of_one_hour_with_fast_fading(fast_hour, s4):
    gain = scintillation_gain(fast_hour, s4)
    assert s4_of(gain) == pytest.approx(s4, abs=0.01)


def test_limits_of_s4():
    xi = np.array([0.3 + 0.4j, -2.0j])
    assert scintillation_gain(xi, 0.0) == pytest.approx([1.0, 1.0])
    assert scintillation_gain(xi, 1.0) == pytest.approx(xi)
    with pytest.raises(ValueError, match="s4: must be within 0 and 1"):
        scintillation_gain(xi, 1.1)


def test_rice_parameter_is_that_of_the_paper():
    for s4 in (0.1, 0.5, 0.9):
        m = 1.0 / s4**2
        k = math.sqrt(m * m - m) / (m - math.sqrt(m * m - m))
        direct = scintillation_gain(0.0, s4).real
        scattered = abs(scintillation_gain(1.0, s4) - direct)
        assert direct**2 / scattered**2 == pytest.approx(k, rel=1e-9)
        assert direct**2 + scattered**2 == pytest.approx(1.0, rel=1e-12)


def test_scattered_part_is_circular_and_of_unit_variance(hours):
    assert np.mean(np.abs(hours) ** 2) == pytest.approx(1.0, abs=0.02)
    assert abs(np.mean(hours)) < 0.02
    assert abs(np.mean(hours**2)) < 0.02


def test_autocorrelation_is_that_of_the_low_pass(hours):
    a = 1.23964643681047 / 0.5
    for lag in (2, 5, 10, 20, 30):
        measured = np.mean(hours[:, lag:] * hours[:, :-lag].conj())
        argument = a * lag / EPOCH_RATE
        expected = math.exp(-argument) * (math.cos(argument) + math.sin(argument))
        assert measured.real == pytest.approx(expected, abs=0.03)
        assert abs(measured.imag) < 0.03
        if lag == 10:
            assert expected == pytest.approx(math.exp(-1.0), rel=1e-9)


def test_spectrum_is_that_of_the_low_pass():
    """Butterworth power spectrum 1 / (1 + 16 (f / Bd)^4), Bd = sqrt(2) beta0 / (pi tau0)."""
    rate, tau0, points = 100.0, 0.5, 16384
    field = ScintillationField(tau0, [3])
    segments = field.fluctuation(np.arange(64)[:, None], np.arange(points) / rate)
    transform = np.fft.fft(segments * np.hanning(points), axis=1)
    # 3/8 is the mean square of the window.
    density = np.mean(np.abs(transform) ** 2, axis=0) / (0.375 * points * rate)
    frequency = np.abs(np.fft.fftfreq(points, 1.0 / rate))
    band = math.sqrt(2.0) * 1.23964643681047 / (math.pi * tau0)
    shape = 1.0 / (1.0 + 16.0 * (frequency / band) ** 4)
    expected = shape / (band * math.pi / math.sqrt(8.0))
    for low, high in ((0.0, 0.3), (0.3, 0.6), (0.6, 1.0), (1.0, 2.0), (2.0, 4.0), (4.0, 8.0)):
        chosen = (frequency >= low) & (frequency < high)
        assert np.mean(density[chosen] / expected[chosen]) == pytest.approx(1.0, abs=0.06)


@pytest.mark.parametrize("chunk", [1, 7, 333])
def test_independent_of_chunks_and_order(chunk):
    times = np.arange(1000) / EPOCH_RATE - 17.0
    whole = ScintillationField(0.1, [5]).fluctuation(9, times)
    field = ScintillationField(0.1, [5])
    pieces = [field.fluctuation(9, times[k : k + chunk]) for k in range(0, 1000, chunk)]
    assert np.array_equal(np.concatenate(pieces), whole)
    backwards = [field.fluctuation(9, times[k : k + chunk]) for k in range(0, 1000, chunk)[::-1]]
    assert np.array_equal(np.concatenate(backwards[::-1]), whole)


def test_independent_of_what_was_stored_before():
    fresh = ScintillationField(0.1, [5]).fluctuation(9, [1.0, 2.0])
    field = ScintillationField(0.1, [5])
    # 600 streams at three places need more blocks than are stored.
    field.fluctuation(np.arange(600)[:, None], [0.0, 50.0, 100.0])
    assert np.array_equal(field.fluctuation(9, [1.0, 2.0]), fresh)


def test_continuous_across_blocks():
    field = ScintillationField(0.5, [5])
    # Blocks are 8 s long; xi turns by at most a few per second.
    for edge in (-8.0, 0.0, 8.0, 16.0):
        before, after = field.fluctuation(1, [edge - 1e-6, edge + 1e-6])
        assert abs(after - before) < 1e-4


def test_streams_and_seeds_are_independent(hours):
    times = np.arange(72000) / EPOCH_RATE
    other = ScintillationField(0.5, [7, 2]).fluctuation(0, times)
    for left, right in ((hours[0], hours[1]), (hours[0], other)):
        assert abs(np.mean(left * right.conj())) < 0.05
    again = ScintillationField(0.5, [7, 1]).fluctuation(0, times[:100])
    assert np.array_equal(again, hours[0, :100])


def test_frequencies_fade_together(hours):
    s4_l1 = 0.4
    s4 = s4_at_frequency(s4_l1, [FREQUENCY_L1, FREQUENCY_L2, FREQUENCY_L5])
    assert s4 == pytest.approx([0.4, 0.4 * (77.0 / 60.0) ** 1.5, 0.4 * (154.0 / 115.0) ** 1.5])
    power = np.abs(scintillation_gain(hours[0], s4[:, None])) ** 2
    assert np.corrcoef(power)[0, 1:].min() > 0.97
    assert s4_at_frequency(0.9, FREQUENCY_L5) == 1.0


def test_edge_of_a_region_is_smooth():
    s4 = tapered_s4(0.4, np.array([0.0, 2.5e3, 5e3, 60e3]), 5e3)
    assert s4 == pytest.approx([0.0, 0.2, 0.4, 0.4])
    steps = np.diff(tapered_s4(0.4, np.linspace(0.0, 6e3, 1000), 5e3))
    assert 0.0 <= steps.min() and steps.max() < 1e-3


def minimum_decorrelation_time(sample_rate: float, aliased_power: float = 0.01) -> float:
    """Return the shortest decorrelation time (s) that samples at a rate (Hz) can show.

    Parameters
    ----------
    sample_rate : float
        Rate of the observations, Hz.
    aliased_power : float
        Part of the power of xi that may lie above half the sample rate (upper bound).

    Notes
    -----
    0.087 s at 20 Hz. A spacecraft at 7.5 km/s meets Fresnel-scale structure in 0.01 to 0.03 s,
    which 20 Hz observations cannot follow.
    """
    # Power above x corner frequencies: at most (1 / (3 x^3)) / (pi / (2 sqrt 2)).
    corners = math.pow(2.0 * math.sqrt(2.0) / (3.0 * math.pi * aliased_power), 1.0 / 3.0)
    corner_frequency = 0.5 * sample_rate / corners
    return BUTTERWORTH_DECORRELATION / (math.sqrt(2.0) * math.pi * corner_frequency)


def test_shortest_decorrelation_time():
    tau0 = minimum_decorrelation_time(20.0)
    assert tau0 == pytest.approx(0.0867, abs=1e-3)
    corner = 1.23964643681047 / (math.sqrt(2.0) * math.pi * tau0)
    frequency = np.linspace(0.0, 4000.0, 4_000_001)
    power = 1.0 / (1.0 + (frequency / corner) ** 4)
    assert power[frequency > 10.0].sum() / power.sum() == pytest.approx(0.01, rel=0.02)


def circular_states(times, time, offset_rtn):
    """Return ITRF positions of a chief on a circular orbit and a deputy behind it, (n, 3) each."""
    radius, inclination = 6700e3, math.radians(10.0)
    rate = math.sqrt(GM_EARTH / radius**3)
    along = np.array([0.0, math.cos(inclination), math.sin(inclination)])
    chief, deputy = [], []
    for seconds in times:
        angle = rate * seconds
        position = radius * (math.cos(angle) * np.array([1.0, 0, 0]) + math.sin(angle) * along)
        velocity = (
            radius * rate * (math.cos(angle) * along - math.sin(angle) * np.array([1.0, 0, 0]))
        )
        state = np.concatenate((position, velocity))
        when = time + float(seconds)
        chief.append(state_gcrf_to_itrf(when, state))
        deputy.append(state_gcrf_to_itrf(when, deputy_state_gcrf(state, [*offset_rtn, 0, 0, 0])))
    return np.array(chief), np.array(deputy)


def test_deputy_lags_by_the_time_of_flight():
    """15 km behind at 7.3 km/s over ground: the same fades 2.0 +- 0.2 s later."""
    time = parse_epoch("2016-03-21T01:33:00 GPS")
    times = np.arange(0.0, 120.0, 1.0 / EPOCH_RATE)
    chief, deputy = circular_states(times, time, (-1000.0, -15000.0, 0.0))
    axis = AlongTrackAxis(chief[0])
    field = ScintillationField(0.5, [1, 0])
    u_chief, u_deputy = axis.coordinate(chief[:, :3]), axis.coordinate(deputy[:, :3])
    assert u_chief[0] == pytest.approx(0.0, abs=1e-9)
    assert np.diff(u_chief) == pytest.approx(1.0 / EPOCH_RATE, rel=0.01)
    levels = [
        20.0 * np.log10(np.abs(scintillation_gain(field.fluctuation(107, u), 0.4)))
        for u in (u_chief, u_deputy)
    ]
    chief_level, deputy_level = (level - level.mean() for level in levels)
    lags = np.arange(0, 100)
    correlation = [
        np.corrcoef(chief_level[: len(times) - lag], deputy_level[lag:])[0, 1] for lag in lags
    ]
    best = int(np.argmax(correlation))
    assert lags[best] / EPOCH_RATE == pytest.approx(2.0, abs=0.2)
    assert correlation[best] > 0.99


def crossing_of(s4, fluctuation):
    """Return a crossing of one ray for each column of the fluctuation, shape (epochs, rays)."""
    return [RegionCrossing(np.full(fluctuation.shape, s4), fluctuation)]


def test_phase_is_continuous_through_fades():
    field = ScintillationField(0.5, [2])
    fluctuation = field.fluctuation(1, np.arange(20000) / 200.0)
    gain = scintillation_gain(fluctuation, 0.8)
    links = ScintillatedLinks(np.array([FREQUENCY_L1]))
    link = np.array([0])
    seconds = [
        links.second(crossing_of(0.8, block[:, None]), link, link, slice(0, 20))
        for block in fluctuation.reshape(-1, 20)
    ]
    amplitude, phase = (np.concatenate(parts)[:, 0] for parts in zip(*seconds, strict=True))
    assert amplitude == pytest.approx(np.abs(gain), rel=1e-12)
    assert np.exp(1j * phase) == pytest.approx(gain / np.abs(gain), abs=1e-9)
    assert phase == pytest.approx(np.unwrap(np.angle(gain)), abs=1e-9)
    # Out of the region only the cycles that slipped in fades are left.
    links.calm()
    turns = links.settled_phase / (2.0 * math.pi)
    assert turns == pytest.approx(np.round(phase[-1:] / (2.0 * math.pi)), abs=1e-12)


def test_links_have_their_own_phase():
    links = ScintillatedLinks(np.full(3, FREQUENCY_L1))
    # The first ray runs around zero twice, the second stands still.
    turns = np.linspace(0.0, 2.0, 40)
    circle = 4.0 * np.exp(2j * math.pi * turns) - 1.0
    fluctuation = np.stack((circle, np.zeros(40)), axis=1)
    satellite, row = np.array([0, 1]), np.array([2, 0])
    gain = scintillation_gain(fluctuation, 1.0)
    _, phase = links.second(crossing_of(1.0, fluctuation), satellite, row, slice(0, 40))
    expected = np.unwrap(np.angle(gain), axis=0)
    assert phase == pytest.approx(expected, abs=1e-9)
    assert abs(phase[-1, 0] - phase[0, 0]) == pytest.approx(4.0 * math.pi, abs=1e-9)
    assert phase[-1, 1] == 0.0
    assert links.settled_phase == pytest.approx([0.0, 0.0, phase[-1, 0]], abs=1e-12)


def test_wrong_arguments_are_refused():
    with pytest.raises(ValueError, match="decorrelation_time"):
        ScintillationField(0.0, [1])
    with pytest.raises(ValueError, match="seed"):
        ScintillationField(0.5, [-1])
    field = ScintillationField(0.5, [1])
    with pytest.raises(ValueError, match="stream"):
        field.fluctuation(-1, 0.0)
    with pytest.raises(ValueError, match="coordinate"):
        field.fluctuation(1, math.nan)
    with pytest.raises(ValueError, match="state_itrf"):
        AlongTrackAxis([7e6, 0.0, 0.0, 7e3, 0.0, 0.0])
    assert field.fluctuation([], []).shape == (0,)
