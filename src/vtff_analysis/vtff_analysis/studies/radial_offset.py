"""Which radial offset of two spacecraft shows an electron-density profile best (paper 000, 4.4).

For each offset the density of a PLUMEX-like profile is retrieved twice: with the simplified model
of the paper (75 dB of noise on the vertical TEC), and from the bag of a flight with receivers and
navigation in the loop (config/campaign/radial_offset.yaml). What an offset resolves shows in the
wavenumber spectra: below the departure scale the average over the offset hides structures, below
the noise scale noise does.
"""

from __future__ import annotations

import dataclasses
import pathlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from vtff_analysis.recordings.ionosphere_truth import IonosphereTruth, read_ionosphere_truth
from vtff_bag.file.reader import BagReader
from vtff_bag.run.description import describe_run
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import ELECTRONS_PER_TECU
from vtff_iono.density.density_profile import (
    COMPARISON_ALTITUDES,
    deconvolved_profile,
    departure_scale,
    model_profile,
    noise_scale,
    wavenumber_spectrum,
    white_noise_spectrum,
)
from vtff_node.stamps import to_nanoseconds
from vtff_sim_bridge.atmosphere.electron_density import ElectronDensityProfile

__all__ = [
    "OFFSETS",
    "PAPER_DEPARTURES",
    "PAPER_MEAN_ERRORS",
    "OffsetError",
    "OffsetResult",
    "flown_offset",
    "model_offset",
    "run_offsets",
]

OFFSETS = (100.0, 1000.0, 3000.0, 10_000.0)
"""m; those of the paper."""

PAPER_MEAN_ERRORS = {1000.0: 6.56e10}
"""Electrons per cubic metre by offset (m), section 4.3."""

PAPER_DEPARTURES = {3000.0: 6000.0, 10_000.0: 20_000.0}
"""Scales below which the paper's spectra depart, m, by offset (m), section 4.4."""

_MODEL_SPACING = 250.0
_MOST_SAMPLES = 1200
"""Most samples of a deconvolution, whose matrix grows with their square."""

_FEWEST_SAMPLES = 200
_CHIEF, _DEPUTY = "chief", "deputy"
_DENSITY_TOPIC = f"/{_DEPUTY}/iono/electron_density"


class OffsetError(ValueError):
    """A run is not one that the study can use; the text names it and says why."""


@dataclass(frozen=True, eq=False)
class OffsetResult:
    """Density profile measured with an offset, at even steps of altitude.

    Parameters
    ----------
    offset : float
        m.
    source : str
        ``model`` or ``flown``.
    altitude, density, deconvolved, true_density : ndarray, shape (n,)
        m; as measured, deconvolved, and the true density at the same altitude, electrons per cubic
        metre.
    mean_error : float
        Mean absolute difference of single samples to the truth averaged over the separation,
        electrons per cubic metre.
    noise : float
        Mean ``|N(k)|^2`` of the noise of the samples.
    departure, departure_deconvolved : float
        Wavelength below which the spectrum departs, m; NaN where it never does.
    noise_scale : float
        Wavelength below which the noise is stronger than the true structures, m; NaN if never.
    """

    offset: float
    source: str
    altitude: FloatArray
    density: FloatArray
    deconvolved: FloatArray
    true_density: FloatArray
    mean_error: float
    noise: float
    departure: float
    departure_deconvolved: float
    noise_scale: float

    @property
    def resolved(self) -> float:
        """Smallest wavelength that neither the average nor the noise hides, m."""
        return float(np.nanmax([self.departure, self.noise_scale, 0.0]))


@dataclass(frozen=True, eq=False)
class _Samples:
    """Densities between two altitudes; arrays of shape (n,) in the order of the altitudes."""

    low: FloatArray
    high: FloatArray
    density: FloatArray
    sigma: FloatArray
    mean_true: FloatArray

    @property
    def altitude(self) -> FloatArray:
        middle: FloatArray = 0.5 * (self.low + self.high)
        return middle

    def take_every(self, step: int) -> _Samples:
        """Return every `step`-th sample."""
        columns = (getattr(self, field.name)[::step] for field in dataclasses.fields(self))
        return _Samples(*columns)


def model_offset(profile: ElectronDensityProfile, offset: float, seed: int = 1) -> OffsetResult:
    """Return the result of the paper's simplified model for one offset (m)."""
    grid = np.arange(COMPARISON_ALTITUDES[0], 1500e3, _MODEL_SPACING)
    model = model_profile(grid, profile.density(grid), offset, seed=seed)
    sigma = np.sqrt(2.0) * model.noise_tecu * ELECTRONS_PER_TECU / offset
    samples = _Samples(
        low=model.altitude - 0.5 * offset,
        high=model.altitude + 0.5 * offset,
        density=model.density,
        sigma=np.full(len(model.altitude), sigma),
        mean_true=model.truth,
    )
    return _analyse_samples("model", offset, profile, model.altitude, samples)


def flown_offset(run: pathlib.Path, offset: float) -> OffsetResult:
    """Return the result of a flight.

    The rising leg is used, which covers all altitudes of the paper's comparison.

    Parameters
    ----------
    run : Path
        Run folder or bag with /deputy/iono/electron_density and the true orbits.
    offset : float
        Radial offset that was flown, m.

    Raises
    ------
    OffsetError
        If the run does not tell its truth or has too few densities.
    vtff_bag.file.errors.BagReadError
        If the bag cannot be read.
    """
    reader = BagReader(run)
    truth = read_ionosphere_truth(reader, describe_run(run, reader.custom_data))
    if truth is None:
        raise OffsetError(f"{run}: no true orbits, or no density profile in its GNSS file")
    samples = _flown_samples(reader, truth)
    if len(samples.density) < _FEWEST_SAMPLES:
        low, high = (altitude / 1e3 for altitude in COMPARISON_ALTITUDES)
        raise OffsetError(
            f"{run}: {len(samples.density)} densities between {low:g} and {high:g} km on the "
            f"rising leg, {_FEWEST_SAMPLES} are needed"
        )
    altitude = samples.altitude
    # The coarsest step of the samples: a finer grid would only hold interpolated values.
    spacing = float(np.quantile(np.diff(altitude), 0.9))
    grid = np.arange(altitude[0], altitude[-1], spacing)
    return _analyse_samples("flown", offset, truth.profile, grid, samples)


def run_offsets(
    profile: ElectronDensityProfile,
    offsets: Sequence[float] = OFFSETS,
    progress: Callable[[int, int], None] | None = None,
    seed: int = 1,
) -> list[OffsetResult]:
    """Return the model's results of all offsets; `progress` gets the number of offsets done."""
    results = []
    for number, offset in enumerate(offsets, 1):
        results.append(model_offset(profile, offset, seed))
        if progress is not None:
            progress(number, len(offsets))
    return results


def _flown_samples(reader: BagReader, truth: IonosphereTruth) -> _Samples:
    rows = []
    for decoded in reader.messages(_DENSITY_TOPIC):
        message = decoded.message
        if len(message.density) and np.isfinite(message.density[-1]):
            half = 0.5 * abs(message.vertical_separation)
            rows.append(
                (
                    to_nanoseconds(message.header.stamp),
                    (message.altitude - half, message.altitude + half),
                    # The last row is that of all satellites.
                    (message.density[-1], message.density_sigma[-1]),
                )
            )
    if not rows:
        return _Samples(*(np.empty(0) for _ in dataclasses.fields(_Samples)))
    time = np.array([row[0] for row in rows], dtype=np.int64)
    low, high = np.array([row[1] for row in rows]).T
    density, sigma = np.array([row[2] for row in rows]).T
    middle = 0.5 * (low + high)
    perigee = int(np.argmin(middle))
    chosen = np.arange(len(rows)) > perigee
    chosen &= (low >= COMPARISON_ALTITUDES[0]) & (high <= COMPARISON_ALTITUDES[1])
    return _Samples(
        low[chosen],
        high[chosen],
        density[chosen],
        sigma[chosen],
        truth.mean_density(_CHIEF, _DEPUTY, time[chosen]),
    )


def _analyse_samples(
    source: str,
    offset: float,
    profile: ElectronDensityProfile,
    altitude: FloatArray,
    samples: _Samples,
) -> OffsetResult:
    """Return errors and spectra of samples, put on even steps of altitude."""
    density = np.interp(altitude, samples.altitude, samples.density)
    true = profile.density(altitude)
    few = samples.take_every(max(1, len(samples.density) // _MOST_SAMPLES))
    sharp = deconvolved_profile(few.low, few.high, few.density, few.sigma)
    deconvolved = np.interp(altitude, sharp.altitude, sharp.density)
    wavenumber, reference = wavenumber_spectrum(altitude, true)
    error = samples.density - samples.mean_true
    noise = white_noise_spectrum(float(np.std(error)), len(altitude))
    departures = [
        departure_scale(
            wavenumber, wavenumber_spectrum(altitude, values)[1], reference, noise=noise
        )
        for values in (density, deconvolved)
    ]
    return OffsetResult(
        offset=offset,
        source=source,
        altitude=altitude,
        density=density,
        deconvolved=deconvolved,
        true_density=true,
        mean_error=float(np.mean(np.abs(error))),
        noise=noise,
        departure=departures[0],
        departure_deconvolved=departures[1],
        noise_scale=noise_scale(wavenumber, reference, noise),
    )
