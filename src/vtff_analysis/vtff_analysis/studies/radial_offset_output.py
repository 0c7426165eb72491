"""Table, CSV file and figures of the radial-offset study, in the form of paper 000, 12 and 13."""

from __future__ import annotations

import csv
import math
import pathlib
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from rich.table import Table

from vtff_analysis.plot_style import AXIS_COLOURS, STYLE, make_figure, save_figure
from vtff_analysis.studies.radial_offset import (
    OFFSETS,
    PAPER_DEPARTURES,
    PAPER_MEAN_ERRORS,
    OffsetResult,
)
from vtff_iono.density.density_profile import wavenumber_spectrum

__all__ = [
    "describe_results",
    "results_table",
    "write_csv",
    "write_profiles_plot",
    "write_spectra_plot",
]

_COLOURS = dict(zip(OFFSETS, ("#CC79A7", *AXIS_COLOURS), strict=True))
_PER_CUBIC_CENTIMETRE = 1e-6
_LABEL = "PLUMEX-like profile (synthetic)"
_TITLES = {
    "model": f"{_LABEL}, 75 dB model of the paper",
    "flown": f"{_LABEL}, flown with receivers in the loop",
}
_COLUMNS = (
    *("source", "offset_m", "mean_error_per_m3", "departure_m", "departure_deconvolved_m"),
    *("noise_scale_m", "resolved_m"),
)


def write_csv(results: Sequence[OffsetResult], path: pathlib.Path) -> None:
    """Write a line for each offset and source; a scale that could not be found is empty."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(_COLUMNS)
        for r in results:
            scales = (r.departure, r.departure_deconvolved, r.noise_scale, r.resolved)
            texts = ["" if math.isnan(scale) else scale for scale in scales]
            writer.writerow([r.source, r.offset, r.mean_error, *texts])


def describe_results(results: Sequence[OffsetResult]) -> str:
    """Return in plain words which offset shows most, of the flights if there are any."""
    flown = [result for result in results if result.source == "flown"]
    chosen, how = (flown, "flown") if flown else (list(results), "by the paper's model")
    best = min(chosen, key=lambda result: result.resolved)
    sentences = [
        f"Of the offsets {how}, {best.offset / 1e3:g} km shows the finest structures, down to "
        f"{best.resolved / 1e3:.2f} km."
    ]
    for result in chosen:
        printed = PAPER_MEAN_ERRORS.get(result.offset)
        if printed is not None:
            sentences.append(
                f"At {result.offset / 1e3:g} km a sample errs by {_density(result.mean_error)} "
                f"cm⁻³ on average (paper {_density(printed)})."
            )
    return " ".join(sentences)


def results_table(results: Sequence[OffsetResult]) -> Table:
    """Return paper, model and flight below each other for each offset."""
    table = Table(title=f"radial offset, {_LABEL}", title_justify="left")
    table.add_column("offset, km", justify="right")
    table.add_column("")
    for name in ("mean error, cm-3", "departs below, km", "deconvolved, km", "resolved, km"):
        table.add_column(name, justify="right")
    for offset in sorted({r.offset for r in results}):
        table.add_section()
        printed = PAPER_MEAN_ERRORS.get(offset), PAPER_DEPARTURES.get(offset)
        table.add_row(f"{offset / 1e3:g}", "paper", _density(printed[0]), _kilometres(printed[1]))
        for r in (r for r in results if r.offset == offset):
            scales = (r.departure, r.departure_deconvolved, r.resolved)
            table.add_row("", r.source, _density(r.mean_error), *map(_kilometres, scales))
    return table


def _density(value: float | None) -> str:
    return "" if value is None else f"{value * _PER_CUBIC_CENTIMETRE:.2e}".replace("e+0", "e")


def _kilometres(value: float | None) -> str:
    if value is None:
        return ""
    return "in noise" if math.isnan(value) else f"{value / 1e3:.2f}"


def write_profiles_plot(results: Sequence[OffsetResult], path: pathlib.Path) -> None:
    """Draw the retrieved density of each offset over the true one (figure 12 of the paper)."""
    with mpl.rc_context(STYLE):
        figure = make_figure(7.5)
        axes: Any = figure.subplots(1, len(results), sharex=True, sharey=True, squeeze=False)[0]
        for axis, result in zip(axes, results, strict=True):
            height = result.altitude / 1e3
            colour = _colour(result.offset)
            axis.plot(result.density / 1e12, height, ".", ms=2.5, color=colour, label="measured")
            axis.plot(result.deconvolved / 1e12, height, "-", lw=1.2, color="0.5", alpha=0.9,
                      label="deconvolved")  # fmt: skip
            axis.plot(result.true_density / 1e12, height, "k-", lw=0.7, label="true")
            error = result.mean_error * _PER_CUBIC_CENTIMETRE
            axis.set_title(f"{result.offset / 1e3:g} km\nmean error {error:.1e} cm$^{{-3}}$")
            axis.set_xlabel("$N_e$ (10$^{12}$ m$^{-3}$)")
            axis.set_xlim(-0.5, 2.0)
        axes[0].set_ylabel("altitude (km)")
        axes[-1].legend(loc="lower right", markerscale=4)
        save_figure(figure, path, _TITLES[results[0].source])


def write_spectra_plot(results: Sequence[OffsetResult], path: pathlib.Path) -> None:
    """Draw the wavenumber spectra over the true one (figure 13 of the paper).

    Dots mark where a spectrum departs, dotted lines the mean spectrum of the noise.
    """
    with mpl.rc_context(STYLE):
        figure = make_figure(7.5)
        axis: Any = figure.subplots()
        for result in results:
            colour = _colour(result.offset)
            k, power = _spectrum(result.altitude, result.density)
            axis.loglog(k, power, color=colour, lw=1.4, label=f"{result.offset / 1e3:g} km")
            axis.axhline(result.noise, color=colour, ls=":", lw=1.2)
            if math.isfinite(result.departure):
                k_departure = 2e3 * np.pi / result.departure
                log_power = np.interp(np.log(k_departure), np.log(k), np.log(power))
                axis.plot(
                    k_departure, np.exp(log_power), "o", ms=10, mfc="none", mew=2, color=colour
                )
        widest = max(results, key=lambda r: r.altitude[-1] - r.altitude[0])
        axis.loglog(*_spectrum(widest.altitude, widest.true_density), "k-", lw=1.0, label="true")
        axis.axvspan(0.1, 0.2, color="0.9", zorder=0)
        axis.text(0.105, 0.03, "bubbles", transform=axis.get_xaxis_transform(), color="0.35")
        axis.set(xlabel="wavenumber $k = 2\\pi/\\lambda$ (rad/km)")
        axis.set(ylabel="$|N_e(k)|^2$ (m$^{-6}$)")
        axis.set_title("circles: departure (-3.9 dB); dotted: noise")
        axis.secondary_xaxis("top", functions=(_other, _other)).set_xlabel("wavelength (km)")
        axis.legend(ncols=5, loc="upper right")
        save_figure(figure, path, _TITLES[results[0].source])


def _colour(offset: float) -> str:
    return _COLOURS.get(offset, "#E69F00")


def _other(value: Any) -> Any:
    """Return the wavelength of a wavenumber, or the wavenumber of a wavelength."""
    return 2.0 * np.pi / np.maximum(value, 1e-9)


def _spectrum(altitude: Any, density: Any) -> tuple[Any, Any]:
    """Return wavenumbers in rad/km and |N(k)|^2."""
    wavenumber, transform = wavenumber_spectrum(altitude, density)
    return 1e3 * wavenumber, np.abs(transform) ** 2
