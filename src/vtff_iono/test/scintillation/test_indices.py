"""Scintillation indices against an independent generator of Rice-distributed fading."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from iono_test_support import examples
from link_simulation import START, observations, pieces
from scipy import signal

from vtff_gnss import constants as c
from vtff_iono.content.rate_of_tec import RateOfTecMonitor
from vtff_iono.content.slant_tec import SlantTecProcessor
from vtff_iono.scintillation.indices import (
    ScintillationMonitor,
    ScintillationSettings,
    default_phase_cutoff_hz,
    linear_power,
    noise_s4,
    phase_deviation,
    pseudo_s4,
    s4_index,
)

RATE = 20.0
BETA = 1.2396464
# Ratio to the cut-off at which each of two passes of a third-order filter is 1.5 dB down.
CORNER_RATIO = (np.sqrt(2.0) - 1.0) ** (1.0 / 6.0)


def fading(s4, minutes, seed, decorrelation=0.5, sub_samples=8):
    """Complex gains of mean power 1, Rice with index S4, shape (minutes, 1200).

    Humphreys et al. (2009): white noise through a second-order Butterworth filter (scipy's, by
    its bilinear transform) and a constant; K from m = 1 / S4^2.
    """
    generator = np.random.default_rng(seed)
    fine = RATE * sub_samples
    corner = BETA / (np.sqrt(2.0) * np.pi * decorrelation)
    sections = signal.butter(2, corner, fs=fine, output="sos")
    size = (minutes, int(60 * fine) + int(20 * fine))
    noise = generator.standard_normal(size) + 1j * generator.standard_normal(size)
    scattered = signal.sosfilt(sections, noise)[:, int(20 * fine) :: sub_samples]
    scattered /= np.sqrt(np.mean(np.abs(scattered) ** 2))
    m = 1.0 / s4**2
    rice = np.sqrt(m**2 - m) / (m - np.sqrt(m**2 - m))
    return np.sqrt(rice / (1.0 + rice)) + scattered / np.sqrt(1.0 + rice)


def measured_power(gain, cn0_dbhz, seed, samples_averaged=50):
    """C/N0 as a receiver measures it from 1 ms correlations, noise included (ratio in Hz)."""
    generator = np.random.default_rng(seed)
    snr = linear_power(cn0_dbhz) / RATE
    size = gain.shape
    noise = generator.standard_normal(size) + 1j * generator.standard_normal(size)
    return np.abs(np.sqrt(snr) * gain + noise / np.sqrt(2.0)) ** 2 * RATE


@pytest.mark.parametrize("s4", [0.2, 0.4, 0.6, 0.8])
def test_s4_at_20_hz_and_45_dbhz(s4):
    """Bias of at most 0.02 over 200 minutes, for unsmoothed C/N0 with and without noise."""
    gain = fading(s4, 200, seed=17)
    clean = np.abs(gain) ** 2 * linear_power(45.0)
    assert abs(s4_index(clean).mean() - s4) <= 0.02
    assert abs(pseudo_s4(clean).mean() - s4) <= 0.02
    noisy = measured_power(gain, 45.0, seed=18)
    raw = s4_index(noisy)
    corrected = np.sqrt(np.maximum(raw**2 - noise_s4(45.0, 1.0 / RATE) ** 2, 0.0))
    assert abs(corrected.mean() - s4) <= 0.02


def test_s4_of_noise_alone_is_the_floor():
    noisy = measured_power(np.ones((300, 1200)), 45.0, seed=1)
    assert s4_index(noisy).mean() == pytest.approx(float(noise_s4(45.0, 0.05)), rel=0.02)
    # The numbers of the literature: 0.056 at 50 Hz.
    assert noise_s4(45.0, 0.02) == pytest.approx(0.0563, abs=2e-4)
    assert noise_s4(45.0, 0.05) == pytest.approx(0.0356, abs=2e-4)


@pytest.mark.parametrize("cn0_dbhz", [10.0, 15.0, 20.0, 25.0, 30.0, 45.0])
def test_noise_s4_is_the_formula_of_the_literature(cn0_dbhz):
    """Van Dierendonck et al. (1993) write it for 50 Hz; both terms scale with the sample length."""
    ratio = 10.0 ** (cn0_dbhz / 10.0)
    squared = 100.0 / ratio * (1.0 + 500.0 / (19.0 * ratio))
    assert noise_s4(cn0_dbhz, 0.02) == pytest.approx(np.sqrt(squared), rel=1e-12)
    longer = 40.0 / ratio * (1.0 + 200.0 / (19.0 * ratio))
    assert noise_s4(cn0_dbhz, 0.05) == pytest.approx(np.sqrt(longer), rel=1e-12)


def test_decibels_would_hide_scintillation():
    gain = fading(0.4, 50, seed=2)
    decibels = 45.0 + 20.0 * np.log10(np.abs(gain))
    assert pseudo_s4(decibels).mean() < 0.06
    assert pseudo_s4(linear_power(decibels)).mean() > 0.35


@examples(30)
@given(st.floats(1e-3, 1e6), st.floats(-0.3, 0.3))
def test_s4_knows_neither_unit_nor_slow_gain(scale, slope):
    power = np.abs(fading(0.5, 1, seed=3)[0]) ** 2
    tilted = power * scale * (1.0 + slope * np.linspace(-1.0, 1.0, 1200))
    assert s4_index(tilted) == pytest.approx(float(s4_index(power)), abs=0.03)
    assert s4_index(scale * power) == pytest.approx(float(s4_index(power)), rel=1e-9)


@pytest.mark.parametrize("cutoff", [0.1, 1.0])
def test_phase_filter_passes_and_stops(cutoff):
    seconds = np.arange(1200) / RATE
    motion = 1e8 + 4e3 * seconds + 12.0 * seconds**2 - 0.02 * seconds**3
    for factor, low, high in ((0.25, 0.0, 0.02), (1.0, 0.63, 0.78), (4.0, 0.95, 1.02)):
        wave = np.sin(2.0 * np.pi * factor * cutoff * seconds)
        ratio = phase_deviation(motion + wave, RATE, cutoff).std() / wave.std()
        if factor * cutoff * 60.0 > 5.0:
            assert low <= ratio <= high


def test_phase_filter_is_of_sixth_order():
    """In the middle of a long series the power of a wave is that of the Butterworth filter.

    Forward and backward filtering gives the response of one filter of third order twice.
    """
    seconds = np.arange(6000) / RATE
    middle = slice(2000, 4000)
    for frequency in (0.3, 0.5, 0.7, 1.0, 2.0):
        wave = np.sin(2.0 * np.pi * frequency * seconds)
        ratio = phase_deviation(wave, RATE, 0.7)[middle].std() / wave[middle].std()
        # Bilinear transform: tangents of half the angles.
        corner, angle = (np.tan(np.pi * f / RATE) for f in (0.7 * CORNER_RATIO, frequency))
        assert ratio == pytest.approx(1.0 / (1.0 + (corner / angle) ** 6), abs=2e-3)
        if frequency == 0.7:
            assert ratio == pytest.approx(np.sqrt(0.5), abs=5e-3)


def test_phase_filter_removes_a_polynomial_of_fifth_degree():
    """The motion within a minute; a sixth degree would be left."""
    abscissa = np.linspace(-1.0, 1.0, 1200)
    for degree in range(1, 6):
        assert np.abs(phase_deviation(1e8 + 1e6 * abscissa**degree, RATE, 0.1)).max() < 1e-4
    assert np.abs(phase_deviation(1e6 * abscissa**6, RATE, 0.1)).max() > 1.0


def test_too_few_phases_are_refused():
    assert phase_deviation(np.zeros(13), RATE, 1.0).tolist() == [0.0] * 13
    with pytest.raises(ValueError, match="12"):
        phase_deviation(np.zeros(12), RATE, 1.0)


@pytest.mark.parametrize(("altitude", "cutoff"), [(0.0, 0.1), (149e3, 0.1), (151e3, 1.0)])
def test_cut_off_follows_the_motion_of_the_receiver(altitude, cutoff):
    assert default_phase_cutoff_hz(altitude) == cutoff
    assert ScintillationSettings().phase_cutoff_hz == 1.0


def test_a_long_fade_at_the_end_leaves_the_line_positive():
    """The line is a tenth of the mean at least: without it S4 would have no bound."""
    power = np.concatenate((np.full(600, 1.0), np.full(600, 1e-3)))
    abscissa = np.linspace(-1.0, 1.0, 1200)
    slope, mean = np.polyfit(abscissa, power, 1)
    line = np.maximum(mean + slope * abscissa, 0.1 * power.mean())
    assert line.min() == pytest.approx(0.1 * power.mean())
    expected = (power / line).std() / (power / line).mean()
    assert s4_index(power) == pytest.approx(expected, rel=1e-9)


def one_window(columns, time, elevation=0.5, azimuth=1.0, **settings):
    """Return the indices of a window of 60 s that begins with the first observation."""
    monitor = ScintillationMonitor(ScintillationSettings(**settings))
    count = len(time)
    angles = np.broadcast_to(elevation, count), np.broadcast_to(azimuth, count)
    (window,) = [*monitor.update(time, columns, *angles), *monitor.flush()]
    return window


def minute(satellites=2, seconds=60.0, **changes):
    """Return observations at 20 Hz from the beginning of a window."""
    count = round(seconds * RATE)
    time, columns = observations(
        np.arange(count) / RATE, np.full((count, satellites), 20.0), **changes
    )
    return time - START % 60_000_000_000, columns


def test_noise_is_taken_off_by_the_mean_power():
    """At 22 dB-Hz the second term of the noise is a sixth of it."""
    time, columns = minute()
    weak = (columns["prn"] == 1) & (columns["band"] == 1)
    draws = np.random.default_rng(4).normal(1.0, 0.2, np.count_nonzero(weak))
    power = linear_power(22.0) * np.abs(draws)
    columns["cn0_dbhz"] = columns["cn0_dbhz"].astype(float)
    columns["cn0_dbhz"][weak] = 10.0 * np.log10(power)
    window = one_window(columns, time)
    row = np.flatnonzero((window.prn == 1) & (window.band == 1))[0]
    assert window.cn0_dbhz[row] == pytest.approx(10.0 * np.log10(power.mean()))
    assert window.s4_pseudo[row] == pytest.approx(power.std() / power.mean())
    ratio = power.mean()
    noise = np.sqrt(40.0 / ratio * (1.0 + 200.0 / (19.0 * ratio)))
    # S4 below the noise is none.
    assert window.s4[row] < noise and window.s4_corrected[row] == 0.0
    strong = 10.0 * np.log10(linear_power(22.0) * np.exp(1.5 * (draws - 1.0) / 0.2))
    columns["cn0_dbhz"][weak] = strong
    window = one_window(columns, time)
    ratio = linear_power(strong).mean()
    noise_squared = 40.0 / ratio * (1.0 + 200.0 / (19.0 * ratio))
    expected = np.sqrt(window.s4[row] ** 2 - noise_squared)
    assert window.s4_corrected[row] == pytest.approx(expected, rel=1e-9)


def test_a_window_tells_signals_rate_and_directions():
    time, columns = minute()
    window = one_window(columns, time, elevation=1e-9 * (time - time[0]), azimuth=columns["prn"])
    assert window.time == time[0] + 60_000_000_000
    assert window.sample_rate_hz == pytest.approx(20.0)
    names = [*zip(window.prn.tolist(), window.band.tolist(), strict=True)]
    assert names == [(1, 1), (1, 2), (2, 1), (2, 2)]
    assert window.attribute.tolist() == [ord(code) for code in "CWCW"]
    assert window.samples.tolist() == [1200] * 4
    assert window.elevation == pytest.approx(30.0)
    assert window.azimuth.tolist() == window.prn.tolist()


@pytest.mark.parametrize(("seconds", "is_enough"), [(48.0, True), (47.9, False)])
def test_four_fifths_of_a_window_are_enough(seconds, is_enough):
    time, columns = minute(seconds=seconds)
    window = one_window(columns, time)
    assert np.isfinite(window.s4).all() == np.isfinite(window.sigma_phi).all() == is_enough


def test_sigma_phi_needs_a_continuous_phase():
    """A lock that was lost before the window does not matter; within it, it does."""
    time, columns = minute(satellites=5)
    rows = [np.flatnonzero((columns["prn"] == prn) & (columns["band"] == 1)) for prn in range(1, 6)]
    columns["flags"][rows[0][0]] |= c.FLAG_LOCK_LOST
    columns["flags"][rows[1][1]] |= c.FLAG_LOCK_LOST
    columns["flags"][rows[2][7]] &= ~np.uint16(c.FLAG_PHASE_VALID)
    kept = np.ones(len(time), dtype=bool)
    kept[rows[3][100]] = False
    window = one_window({n: column[kept] for n, column in columns.items()}, time[kept])
    assert np.isfinite(window.sigma_phi[window.band == 1]).tolist() == [
        True,
        False,
        False,
        False,
        True,
    ]
    assert np.isfinite(window.sigma_phi[window.band == 2]).all()
    assert np.isfinite(window.s4).all()


@pytest.mark.parametrize(("cutoff", "is_enough"), [(5.0, True), (5.01, False)])
def test_sigma_phi_needs_four_samples_per_period_of_the_cut_off(cutoff, is_enough):
    time, columns = minute()
    window = one_window(columns, time, phase_cutoff_hz=cutoff)
    assert np.isfinite(window.sigma_phi).all() == is_enough


@pytest.mark.parametrize(("satellites", "is_removed"), [(2, True), (1, False)])
def test_the_median_of_four_signals_removes_the_clock(satellites, is_removed):
    """Two satellites have two signals each; with fewer signals the median would be the signal."""
    time, columns = minute(satellites=satellites, phase_sigma=0.0)
    epoch = np.round(1e-9 * (time - time[0]) * RATE).astype(int)
    clock = 0.1 * np.sin(2.0 * np.pi * 3.0 * epoch / RATE)
    frequency = np.where(columns["band"] == 1, 1575.42e6, 1227.60e6)
    columns["carrier_phase_cycles"] += clock * frequency / 299_792_458.0
    sigma_phi = one_window(columns, time).sigma_phi
    amplitude = 0.1 * 2.0 * np.pi * 1575.42e6 / 299_792_458.0
    if is_removed:
        assert sigma_phi.max() < 1e-3 * amplitude
    else:
        assert sigma_phi[0] == pytest.approx(amplitude / np.sqrt(2.0), rel=0.02)


def test_steps_must_be_even():
    """A gap of an epoch in the middle is a step twice as long."""
    time, columns = minute()
    kept = time != time[0] + 30_000_000_000
    window = one_window({n: column[kept] for n, column in columns.items()}, time[kept])
    assert np.isnan(window.sigma_phi).all() and np.isfinite(window.s4).all()


def test_a_single_epoch_has_no_index():
    time, columns = minute(seconds=0.05)
    window = one_window(columns, time)
    assert np.isnan(window.s4).all() and np.isnan(window.s4_corrected).all()
    assert np.isnan(window.sigma_phi).all()
    assert window.cn0_dbhz == pytest.approx(45.0)


def test_monitor_gives_each_signal_its_index():
    """One of six satellites scintillates, all share a bad receiver clock."""
    seconds = np.arange(2400) / RATE
    time, columns = observations(seconds, np.full((2400, 6), 20.0), seed=5)
    gain = fading(0.6, 2, seed=6).ravel()
    hit = (columns["prn"] == 3) & (columns["band"] == 1)
    columns["cn0_dbhz"][hit] = 45.0 + 20.0 * np.log10(np.abs(gain))
    phase = np.unwrap(np.angle(gain))
    columns["carrier_phase_cycles"][hit] += phase / (2.0 * np.pi)
    clock = 0.3 * np.cumsum(np.random.default_rng(7).standard_normal(2400)) / RATE
    epoch = np.round(1e-9 * (time - START) * RATE).astype(int)
    frequency = np.where(columns["band"] == 1, 1575.42e6, 1227.60e6)
    columns["carrier_phase_cycles"] += clock[epoch] * frequency / 299_792_458.0
    monitor = ScintillationMonitor(ScintillationSettings(phase_cutoff_hz=0.2))
    angle = np.zeros(len(time))
    windows = [*monitor.update(time, columns, angle, angle), *monitor.flush()]
    whole = [window for window in windows if window.samples.max() == 1200]
    assert whole
    for window in whole:
        assert window.sample_rate_hz == pytest.approx(20.0)
        is_hit = (window.prn == 3) & (window.band == 1)
        part = slice(*(np.array([0, 1200]) + round((window.time - START) / 5e7) - 1200).tolist())
        assert window.s4[is_hit] == pytest.approx(
            float(s4_index(np.abs(gain[part]) ** 2)), abs=1e-4
        )
        truth = phase_deviation(phase[part], RATE, 0.2).std()
        assert window.sigma_phi[is_hit] == pytest.approx(truth, rel=0.1)
        assert window.s4[~is_hit] == pytest.approx(0.0, abs=1e-6)
        assert window.sigma_phi[~is_hit].max() < 0.1 * truth


@pytest.mark.parametrize("epochs", [1, 13, 1000])
def test_online_and_offline_give_the_same_bytes(epochs):
    content = 20.0 + np.cumsum(np.random.default_rng(1).normal(0.0, 0.03, (600, 3)), axis=0)
    time, columns = observations(np.arange(600) * 0.25, content, seed=8)
    columns["cn0_dbhz"] = (45.0 + np.random.default_rng(2).normal(0, 1, len(time))).astype("f4")
    elevation = np.full(len(time), 1.0)

    def results(calls):
        scintillation, processor = ScintillationMonitor(), SlantTecProcessor()
        roti = RateOfTecMonitor(1.0, 60.0)
        windows, rates = [], []
        for when, part, angle in calls:
            windows += scintillation.update(when, part, angle, angle)
            rates += roti.update(processor.update(when, part, angle))
        return [*windows, *scintillation.flush()], [*rates, *roti.flush()]

    offline = results([(time, columns, elevation)])
    online = results(pieces(time, columns, elevation, epochs))
    for kind, names in zip(
        (0, 1),
        (("time", "s4", "s4_corrected", "sigma_phi", "samples"), ("time", "roti_tecu_per_minute")),
        strict=True,
    ):
        assert len(offline[kind]) == len(online[kind]) >= 3
        for one, other in zip(offline[kind], online[kind], strict=True):
            for name in names:
                assert np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True)


def test_signals_that_were_not_there_have_no_index():
    time, columns = observations(np.arange(1200) / RATE, np.full((1200, 2), 20.0))
    time = time - START % 60_000_000_000
    kept = ~((columns["prn"] == 2) & (time > time[0] + 20_000_000_000))
    columns = {name: column[kept] for name, column in columns.items()}
    angle = np.zeros(kept.sum())
    monitor = ScintillationMonitor()
    list(monitor.update(time[kept], columns, angle, angle))
    (window,) = monitor.flush()
    assert np.isfinite(window.s4[window.prn == 1]).all()
    assert np.isnan(window.s4[window.prn == 2]).all()
    assert np.isnan(window.sigma_phi[window.prn == 2]).all()


def test_roti_of_a_known_wave():
    """The rate of a sine of period 20 s and 1 TECU, sampled each second."""
    seconds = np.arange(2400) / RATE
    wave = np.sin(2.0 * np.pi * seconds / 20.0)
    time, columns = observations(seconds, 20.0 + np.tile(wave[:, None], (1, 2)), phase_sigma=0.0)
    rows = SlantTecProcessor().update(time, columns, np.full(len(time), 1.0))
    monitor = RateOfTecMonitor(1.0, 60.0)
    windows = [*monitor.update(rows), *monitor.flush()]
    expected = 60.0 * 2.0 * np.sin(np.pi / 20.0) / np.sqrt(2.0)
    for window in windows:
        if window.rates.max() == 60:
            assert window.roti_tecu_per_minute == pytest.approx(expected, rel=0.02)
            return
    pytest.fail("no whole window")
