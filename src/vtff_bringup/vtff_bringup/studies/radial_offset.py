"""Which radial offset of two spacecraft shows an electron-density profile best (paper 000, 4.4).

The simplified model of the paper: noise of 75 dB on the vertical TEC of the PLUMEX-like profile,
and the difference over each offset. To each belong the scale at which the profile departs from the
true one, and that of the deconvolved profile.
"""

from __future__ import annotations

import csv
import pathlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np

from vtff_bringup.report.plot_style import AXIS_COLOURS, STYLE, make_figure, save_figure
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import ELECTRONS_PER_TECU
from vtff_iono.density_profile import (
    deconvolved_profile,
    departure_scale,
    model_profile,
    wavenumber_spectrum,
)
from vtff_sim_bridge.atmosphere.electron_density import ElectronDensityProfile

__all__ = ["OFFSETS", "OffsetResult", "model_offset", "run_offsets", "write_csv", "write_plot"]

OFFSETS = (100.0, 1000.0, 3000.0, 10_000.0)
"""m; those of the paper."""

_ALTITUDES = (236e3, 567e3)
_SPACING = 250.0
_SAMPLES = 1200
"""Of the deconvolution: its matrix grows with their square."""


@dataclass(frozen=True, eq=False)
class OffsetResult:
    """What an offset shows of the profile.

    Parameters
    ----------
    offset : float
        m.
    altitude, density, true_density : ndarray, shape (n,)
        m; as measured, and the true density at the same altitude, electrons per cubic metre.
    mean_error : float
        Mean absolute difference to the truth averaged over the offset, electrons per cubic metre.
    departure, departure_deconvolved : float
        Wavelength below which the spectrum departs, m; NaN where it never does.
    """

    offset: float
    altitude: FloatArray
    density: FloatArray
    true_density: FloatArray
    mean_error: float
    departure: float
    departure_deconvolved: float


def model_offset(profile: ElectronDensityProfile, offset: float, seed: int = 1) -> OffsetResult:
    """Return the result of the paper's simplified model for one offset (m)."""
    grid = np.arange(_ALTITUDES[0], 1500e3, _SPACING)
    found = model_profile(grid, profile.density(grid), offset, seed=seed)
    truth = profile.density(found.altitude)
    step = max(1, len(found.altitude) // _SAMPLES)
    kept = slice(None, None, step)
    middle, density = found.altitude[kept], found.density[kept]
    noise = np.sqrt(2.0) * found.noise_tecu * ELECTRONS_PER_TECU / offset
    sharp = deconvolved_profile(
        middle - 0.5 * offset, middle + 0.5 * offset, density, np.full(len(middle), noise)
    )
    return OffsetResult(
        offset=offset,
        altitude=found.altitude,
        density=found.density,
        true_density=truth,
        mean_error=found.mean_absolute_error,
        departure=_departure(found.altitude, found.density, truth),
        departure_deconvolved=_departure(
            found.altitude, np.interp(found.altitude, sharp.altitude, sharp.density), truth
        ),
    )


def _departure(altitude: FloatArray, density: FloatArray, truth: FloatArray) -> float:
    wavenumber, measured = wavenumber_spectrum(altitude, density)
    return departure_scale(wavenumber, measured, wavenumber_spectrum(altitude, truth)[1])


def run_offsets(
    profile: ElectronDensityProfile,
    offsets: Sequence[float] = OFFSETS,
    progress: Callable[[int, int], None] | None = None,
) -> list[OffsetResult]:
    """Return the results of all offsets; `progress` is told how many are done."""
    results = []
    for number, offset in enumerate(offsets, 1):
        results.append(model_offset(profile, offset))
        if progress is not None:
            progress(number, len(offsets))
    return results


def write_csv(results: Sequence[OffsetResult], path: pathlib.Path) -> None:
    """Write one line an offset."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(["offset_m", "mean_error_per_m3", "departure_m", "departure_deconvolved_m"])
        for r in results:
            writer.writerow([r.offset, r.mean_error, r.departure, r.departure_deconvolved])


def write_plot(results: Sequence[OffsetResult], path: pathlib.Path) -> None:
    """Draw profiles and spectra as in figures 12 and 13 of the paper."""
    colours = (*AXIS_COLOURS, "#CC79A7")
    with mpl.rc_context(STYLE):
        figure = make_figure(10.0)
        panels: Any = figure.subplot_mosaic([list(range(len(results))), ["spectra"] * len(results)])
        for number, result in enumerate(results):
            axis = panels[number]
            height = result.altitude / 1e3
            axis.plot(result.density, height, ".", ms=2, color=colours[number % 4])
            axis.plot(result.true_density, height, "k-", lw=0.8)
            axis.set(title=f"{result.offset / 1e3:g} km", xlabel="density (m$^{-3}$)")
            axis.set_xlim(-3e11, 1.8e12)
            wavenumber, measured = wavenumber_spectrum(result.altitude, result.density)
            panels["spectra"].loglog(
                1e3 * wavenumber,
                np.abs(measured) ** 2,
                color=colours[number % 4],
                lw=1.0,
                label=f"{result.offset / 1e3:g} km",
            )
        first = results[min(1, len(results) - 1)]
        wavenumber, truth = wavenumber_spectrum(first.altitude, first.true_density)
        panels["spectra"].loglog(1e3 * wavenumber, np.abs(truth) ** 2, "k-", lw=1.2, label="true")
        panels[0].set_ylabel("altitude (km)")
        panels["spectra"].set(xlabel="wavenumber k (rad/km)", ylabel="$|N_e(k)|^2$")
        panels["spectra"].legend(ncols=5)
        save_figure(figure, path, "PLUMEX-like profile (synthetic) with 75 dB of noise")
