"""Scintillation indices against an independent generator of Rice-distributed fading."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from iono_test_support import examples
from link_simulation import START, observations, pieces
from scipy import signal

from vtff_iono.content.rate_of_tec import RateOfTecMonitor
from vtff_iono.content.slant_tec import SlantTecProcessor
from vtff_iono.scintillation.indices import (
    ScintillationMonitor,
    ScintillationSettings,
    linear_power,
    noise_s4,
    phase_deviation,
    pseudo_s4,
    s4_index,
)

RATE = 20.0
BETA = 1.2396464


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
