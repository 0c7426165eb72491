"""Profiles of electron density against altitude: bins, deconvolution, spectra, the paper's model.

Two spacecraft that are dh apart in altitude measure the density averaged over dh. In wavenumber
that is a product with sinc(dh / lambda): -3.9 dB (of the power) at lambda = 2 dh, zero at
lambda = dh. `deconvolved_profile` inverts it as far as the noise allows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import linalg, special

from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import ELECTRONS_PER_TECU

__all__ = [
    "COMPARISON_ALTITUDES",
    "DEPARTURE_LEVEL_DB",
    "DensityProfile",
    "ModelAnalysis",
    "binned_profile",
    "deconvolved_profile",
    "departure_scale",
    "model_profile",
    "noise_scale",
    "wavenumber_spectrum",
    "white_noise_spectrum",
]

DEPARTURE_LEVEL_DB = -3.9
"""Squared spectrum ratio at which a profile departs, dB: that of a mean over half a wave."""

COMPARISON_ALTITUDES = (236e3, 567e3)
"""Altitudes between which the paper compares its profile, m (Peng et al., section 4.3)."""

# Spectral index of irregularities along the vertical, and their outer scale, m: PLUMEX I
# (k^-2.5 from 1 km down; NRL memorandum report AD-A089133) with scales of up to 25 km.
_SPECTRAL_INDEX = 2.5
_OUTER_SCALE = 25e3
_VARIANCE_STEPS = np.geomspace(0.03, 30.0, 11)
_MOST_CELLS = 1500


@dataclass(frozen=True, eq=False)
class DensityProfile:
    """Electron density against altitude; arrays of shape (n,).

    Parameters
    ----------
    altitude : ndarray
        m, increasing.
    density, sigma : ndarray
        Electron density and its sigma, electrons per cubic metre; NaN where there is no sample.
    """

    altitude: FloatArray
    density: FloatArray
    sigma: FloatArray


def binned_profile(
    altitude: npt.ArrayLike, density: npt.ArrayLike, sigma: npt.ArrayLike, width: float = 1e3
) -> DensityProfile:
    """Return means in altitude bins, weighted with the inverse of the variance.

    Parameters
    ----------
    altitude, density, sigma : array_like, shape (n,)
        Samples in any order, m and electrons per cubic metre; NaN is left out.
    width : float
        Width of the bins, m; the edges of the bins are multiples of it.
    """
    altitude, density, sigma = (np.asarray(a, dtype=float) for a in (altitude, density, sigma))
    good = np.isfinite(altitude) & np.isfinite(density) & np.isfinite(sigma)
    number = np.floor(altitude[good] / width).astype(np.int64)
    bins, inverse = np.unique(number, return_inverse=True)
    weight = 1.0 / sigma[good] ** 2
    total = np.bincount(inverse, weight, len(bins))
    mean = np.bincount(inverse, weight * density[good], len(bins)) / total
    return DensityProfile((bins + 0.5) * width, mean, 1.0 / np.sqrt(total))


def deconvolved_profile(
    altitude_low: npt.ArrayLike,
    altitude_high: npt.ArrayLike,
    density: npt.ArrayLike,
    sigma: npt.ArrayLike,
    spacing: float | None = None,
) -> DensityProfile:
    """Return the profile behind densities that are averages between two altitudes.

    This is the Wiener inverse of the sinc response, written for samples at any altitudes with any
    separation: the linear estimate with the least mean square error for a density that is a
    smooth part (running mean over four separations, or half the outer scale of irregularities) plus
    irregularities of spectrum k^-2.5. Their variance is the one for which the samples are most
    likely.

    Parameters
    ----------
    altitude_low, altitude_high : array_like, shape (n,)
        Altitudes between which each sample is an average, m.
    density, sigma : array_like, shape (n,)
        Electrons per cubic metre; NaN is left out. Noise is taken as independent.
    spacing : float, optional
        Spacing of the result, m; by default a quarter of the median separation.

    Raises
    ------
    ValueError
        If there are fewer than 8 samples.
    """
    low, high, values, noise = (
        np.asarray(a, dtype=float) for a in (altitude_low, altitude_high, density, sigma)
    )
    good = np.isfinite(low + high + values + noise)
    low, high, values, noise = (a[good] for a in (low, high, values, noise))
    if len(values) < 8:
        raise ValueError(f"deconvolution: 8 samples are needed, got {len(values)}")
    low, high = np.minimum(low, high), np.maximum(low, high)
    separation = float(np.median(high - low))
    spacing = spacing or max(0.25 * separation, float(high.max() - low.min()) / _MOST_CELLS)
    edges = np.arange(low.min(), high.max() + spacing, spacing)
    average = _averaging_matrix(low, high, edges)
    middle = 0.5 * (edges[1:] + edges[:-1])
    # The mean is slower than the irregularities: otherwise a small separation would take its noise
    # for the mean.
    slowest = max(2.0 * separation, 0.25 * _OUTER_SCALE)
    mean = _smooth(0.5 * (low + high), values, noise, middle, slowest)
    residual = values - average @ mean
    correlation = linalg.toeplitz(_correlation(middle - middle[0]))
    carried = average @ correlation
    response = carried @ average.T
    scale = max(float(np.mean(residual**2) - np.mean(noise**2)), float(np.mean(noise**2)) * 0.01)
    variance = scale * max(
        _VARIANCE_STEPS,
        key=lambda factor: _log_likelihood(scale * factor * response, noise, residual),
    )
    factor = linalg.cho_factor(variance * response + np.diag(noise**2))
    estimate = mean + variance * carried.T @ linalg.cho_solve(factor, residual)
    explained = variance**2 * np.einsum("ij,ij->j", carried, linalg.cho_solve(factor, carried))
    return DensityProfile(middle, estimate, np.sqrt(np.maximum(variance - explained, 0.0)))


def _averaging_matrix(low: FloatArray, high: FloatArray, edges: FloatArray) -> FloatArray:
    """Return the weights of cells in the averages, shape (samples, cells)."""
    overlap = np.minimum(high[:, None], edges[1:]) - np.maximum(low[:, None], edges[:-1])
    overlap = np.maximum(overlap, 0.0)
    weights: FloatArray = overlap / overlap.sum(axis=1, keepdims=True)
    return weights


def _smooth(
    altitude: FloatArray, values: FloatArray, noise: FloatArray, at: FloatArray, scale: float
) -> FloatArray:
    """Return means of samples around altitudes, weighted with a Gaussian and with their noise."""
    weight = np.exp(-0.5 * ((at[:, None] - altitude) / scale) ** 2) / noise**2
    # Beyond the last sample the nearest one counts.
    weight = np.maximum(weight, 1e-200)
    smooth: FloatArray = weight @ values / weight.sum(axis=1)
    return smooth


def _correlation(distance: FloatArray) -> FloatArray:
    """Return the correlation of irregularities: Matern, of spectrum (k0^2 + k^2)^(-p/2)."""
    order = 0.5 * (_SPECTRAL_INDEX - 1.0)
    argument = 2.0 * np.pi / _OUTER_SCALE * np.abs(distance)
    result = np.ones_like(argument)
    apart = argument > 1e-9
    x = argument[apart]
    result[apart] = 2.0 ** (1.0 - order) / special.gamma(order) * x**order * special.kv(order, x)
    return result


def _log_likelihood(covariance: FloatArray, noise: FloatArray, residual: FloatArray) -> float:
    """Return the log-likelihood of residuals less a constant; noise is sigmas, one a sample."""
    factor = linalg.cholesky(covariance + np.diag(noise**2), lower=True)
    white = linalg.solve_triangular(factor, residual, lower=True)
    return float(-0.5 * white @ white - np.log(np.diag(factor)).sum())


def wavenumber_spectrum(
    altitude: npt.ArrayLike, density: npt.ArrayLike
) -> tuple[FloatArray, npt.NDArray[np.complex128]]:
    """Return wavenumbers 2 pi / lambda (rad/m) and the Fourier transform N(k) of a profile.

    Parameters
    ----------
    altitude, density : array_like, shape (n,)
        Profile at even steps, m and electrons per cubic metre.

    Returns
    -------
    wavenumber : ndarray, shape (n // 2,)
        Wavenumbers without zero.
    transform : ndarray of complex
        Transform of the profile less a straight line, under a Hann window; ``|N(k)|^2`` is the
        spectrum.

    Raises
    ------
    ValueError
        If the steps are not even within 1 %.
    """
    altitude = np.asarray(altitude, dtype=float)
    values = np.asarray(density, dtype=float)
    steps = np.diff(altitude)
    if len(steps) < 4 or np.ptp(steps) > 0.01 * abs(steps.mean()):
        raise ValueError("wavenumber_spectrum: at least 5 samples at even steps are needed")
    line = np.polynomial.Polynomial.fit(altitude, values, 1)
    transform = np.fft.rfft((values - line(altitude)) * np.hanning(len(values)))
    wavenumber = 2.0 * np.pi * np.fft.rfftfreq(len(values), abs(steps.mean()))
    kept = slice(1, 1 + len(values) // 2)
    return wavenumber[kept], transform[kept]


def departure_scale(
    wavenumber: FloatArray,
    measured: npt.NDArray[np.complex128],
    reference: npt.NDArray[np.complex128],
    level_db: float = DEPARTURE_LEVEL_DB,
    bins_per_octave: int = 6,
    noise: float = 0.0,
) -> float:
    """Return the scale (m) below which a measured spectrum departs from the reference.

    The squared ratio is that of the part of the measured transform which is coherent with the
    reference, ``|sum(M R*)|^2 / (sum |R|^2)^2`` in bins of wavenumber, so that noise neither hides
    nor feigns a departure.

    Parameters
    ----------
    wavenumber, measured, reference
        From `wavenumber_spectrum`, on one grid of altitudes.
    level_db : float
        Squared ratio below which the spectrum departs, dB.
    bins_per_octave : int
    noise : float
        Mean ``|N(k)|^2`` of the noise of `measured`, see `white_noise_spectrum`. Bins in which it
        alone may take a ratio of 1 below the level, at three sigma, are not used.

    Returns
    -------
    float
        2 pi / k where the ratio falls below the level, coming from large scales; NaN if it does
        not in any bin that is used.
    """
    number, bins, middle = _octave_bins(wavenumber, bins_per_octave)
    power = np.array([np.sum(np.abs(reference[number == b]) ** 2) for b in bins])
    # Half of the noise power is in phase with the reference.
    is_used = 3.0 * np.sqrt(0.5 * noise / power) < 1.0 - 10.0 ** (0.05 * level_db)
    bins, middle, power = bins[is_used], middle[is_used], power[is_used]
    cross = np.array([np.sum((measured * reference.conj())[number == b]) for b in bins])
    ratio_db = 20.0 * np.log10(np.maximum(np.abs(cross) / power, 1e-12))
    below = np.flatnonzero(ratio_db < level_db)
    if len(below) == 0 or below[0] == 0:
        return float("nan") if len(below) == 0 else float(2.0 * np.pi / middle[0])
    i = below[0]
    fraction = (ratio_db[i - 1] - level_db) / (ratio_db[i - 1] - ratio_db[i])
    crossing = np.exp(np.interp(fraction, [0.0, 1.0], np.log(middle[[i - 1, i]])))
    return float(2.0 * np.pi / crossing)


def white_noise_spectrum(sigma: float, count: int) -> float:
    """Return the mean `wavenumber_spectrum`, ``|N(k)|^2``, of white noise; the same at every k.

    Parameters
    ----------
    sigma : float
        Standard deviation of a sample, electrons per cubic metre.
    count : int
        Number of samples.
    """
    return float(sigma**2 * np.sum(np.hanning(count) ** 2))


def noise_scale(
    wavenumber: FloatArray,
    reference: npt.NDArray[np.complex128],
    noise: float,
    bins_per_octave: int = 6,
) -> float:
    """Return the scale (m) below which noise is stronger than the structures themselves.

    Parameters
    ----------
    wavenumber, reference
        True profile, from `wavenumber_spectrum`.
    noise : float
        From `white_noise_spectrum`.
    bins_per_octave : int

    Returns
    -------
    float
        2 pi / k where the mean ``|N(k)|^2`` of the reference in bins of wavenumber falls below the
        noise, coming from large scales; NaN if it never does.
    """
    number, bins, middle = _octave_bins(wavenumber, bins_per_octave)
    power = np.array([np.mean(np.abs(reference[number == b]) ** 2) for b in bins])
    below = np.flatnonzero(power < noise)
    return float(2.0 * np.pi / middle[below[0]]) if len(below) else float("nan")


def _octave_bins(
    wavenumber: FloatArray, bins_per_octave: int
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], FloatArray]:
    """Return the bin of each wavenumber, the bins, and their middles (rad/m)."""
    number = np.floor(bins_per_octave * np.log2(wavenumber / wavenumber[0])).astype(np.int64)
    bins = np.unique(number)
    middle = np.array([np.exp(np.log(wavenumber[number == b]).mean()) for b in bins])
    return number, bins, middle


@dataclass(frozen=True, eq=False)
class ModelAnalysis:
    """Result of the simplified model of the paper.

    Parameters
    ----------
    altitude : ndarray, shape (n,)
        Middle of the two spacecraft, m.
    density, truth : ndarray, shape (n,)
        Density as retrieved, and true density averaged over the separation, electrons per cubic
        metre.
    noise_tecu : float
        Standard deviation of the noise of each vertical content.
    mean_absolute_error : float
        Mean absolute error of the density, electrons per cubic metre.
    """

    altitude: FloatArray
    density: FloatArray
    truth: FloatArray
    noise_tecu: float
    mean_absolute_error: float


def model_profile(
    altitude: npt.ArrayLike,
    density: npt.ArrayLike,
    separation: float,
    signal_to_noise_db: float = 75.0,
    content_tecu: float = 30.0,
    altitude_limits: tuple[float, float] = COMPARISON_ALTITUDES,
    seed: int = 0,
) -> ModelAnalysis:
    """Repeat the paper's analysis: noise on a profile of vertical TEC, differenced over altitude.

    Parameters
    ----------
    altitude, density : array_like, shape (m,)
        True profile at even steps, m and electrons per cubic metre; reaching to where the density
        has become small.
    separation : float
        Vertical separation of the two spacecraft, m.
    signal_to_noise_db : float
        Ratio of the vertical TEC to its noise.
    content_tecu : float
        Vertical TEC that the ratio refers to: 30 TECU in the paper, a noise of 0.0053 TECU.
    altitude_limits : tuple of float
        Lowest and highest altitude of the analysis, m.
    seed : int
        Seed of the noise.

    References
    ----------
    Peng et al., VTFF testbed, section 4.4 (white Gaussian noise with 75 dB).
    """
    grid = np.asarray(altitude, dtype=float)
    values = np.asarray(density, dtype=float)
    cells = 0.5 * (values[1:] + values[:-1]) * np.diff(grid)
    above = np.concatenate((np.cumsum(cells[::-1])[::-1], [0.0])) / ELECTRONS_PER_TECU
    generator = np.random.default_rng(seed)
    low, high = altitude_limits
    chief = grid[(grid >= low) & (grid + separation <= high)]
    vtec_chief = np.interp(chief, grid, above)
    vtec_deputy = np.interp(chief + separation, grid, above)
    sigma = content_tecu * 10.0 ** (-0.05 * signal_to_noise_db)
    scale = ELECTRONS_PER_TECU / separation
    truth = (vtec_chief - vtec_deputy) * scale
    noise = sigma * generator.standard_normal((2, len(chief)))
    retrieved = truth + (noise[0] - noise[1]) * scale
    return ModelAnalysis(
        altitude=chief + 0.5 * separation,
        density=retrieved,
        truth=truth,
        noise_tecu=sigma,
        mean_absolute_error=float(np.mean(np.abs(retrieved - truth))),
    )
