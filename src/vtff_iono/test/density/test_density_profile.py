"""Noise in wavenumber spectra of density profiles, and what may be concluded below it."""

import math

import numpy as np
import pytest

from vtff_iono.density.density_profile import (
    deconvolved_profile,
    departure_scale,
    noise_scale,
    wavenumber_spectrum,
    white_noise_spectrum,
)

ALTITUDE = np.arange(0.0, 400e3, 250.0)


def structures(seed=0):
    """Return a profile with a spectrum of k^-2.5."""
    random = np.random.default_rng(seed)
    k = np.fft.rfftfreq(len(ALTITUDE), 250.0)
    amplitude = np.zeros_like(k)
    amplitude[1:] = k[1:] ** -1.25
    phase = random.uniform(0.0, 2.0 * np.pi, len(k))
    profile = np.fft.irfft(amplitude * np.exp(1j * phase), len(ALTITUDE))
    return profile / profile.std()


def test_white_noise_has_the_stated_mean_spectrum():
    noise = 3.0 * np.random.default_rng(1).standard_normal((200, len(ALTITUDE)))
    power = np.mean([np.abs(wavenumber_spectrum(ALTITUDE, row)[1]) ** 2 for row in noise])
    assert power == pytest.approx(white_noise_spectrum(3.0, len(ALTITUDE)), rel=0.02)


def test_noise_scale_falls_with_the_noise():
    k, reference = wavenumber_spectrum(ALTITUDE, structures())
    scales = [
        noise_scale(k, reference, white_noise_spectrum(sigma, len(ALTITUDE)))
        for sigma in (1.0, 0.1, 0.01)
    ]
    assert scales == sorted(scales, reverse=True)
    assert math.isnan(noise_scale(k, reference, 0.0))


@pytest.mark.parametrize("seed", range(10))
def test_noise_alone_is_no_departure(seed):
    """A profile that is measured at every scale does not depart, however noisy it is."""
    true = structures(seed)
    k, reference = wavenumber_spectrum(ALTITUDE, true)
    for sigma in (0.03, 0.3, 3.0):
        noisy = true + sigma * np.random.default_rng(seed).standard_normal(len(true))
        noise = white_noise_spectrum(sigma, len(ALTITUDE))
        measured = wavenumber_spectrum(ALTITUDE, noisy)[1]
        assert math.isnan(departure_scale(k, measured, reference, noise=noise))


def test_deconvolution_of_a_small_separation_does_not_take_its_noise_for_structures():
    true = 10.0 + 3.0 * np.sin(2.0 * np.pi * ALTITUDE / 60e3)
    noisy = true + 5.0 * np.random.default_rng(2).standard_normal(len(true))
    found = deconvolved_profile(
        ALTITUDE - 50.0, ALTITUDE + 50.0, noisy, np.full(len(true), 5.0), spacing=500.0
    )
    error = found.density - np.interp(found.altitude, ALTITUDE, true)
    assert np.sqrt(np.mean(error**2)) < 0.25 * 5.0
