"""Errors of the electron density between two spacecraft against the true profile."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from vtff_analysis.recordings.history import DensityHistory, RunHistory
from vtff_analysis.recordings.ionosphere_truth import IonosphereTruth
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import ELECTRONS_PER_TECU
from vtff_gnss.signals import satellite_number
from vtff_iono.density.density_profile import COMPARISON_ALTITUDES, binned_profile
from vtff_sim_bridge.atmosphere.density_models import PLUMEX_BUBBLES

__all__ = ["add_density", "add_single_satellite_density"]

#: The paper counts the bubbles of its section 4.3 from above.
_BUBBLES = dict(enumerate(reversed(PLUMEX_BUBBLES), 1))

#: ns; until then the bias between the receivers is not yet estimated.
_BIAS_DURATION = 100 * NANOSECONDS_PER_SECOND
_PER_CUBIC_CENTIMETRE = 1e-6


def add_density(
    measured: dict[str, Any], history: RunHistory, truth: IonosphereTruth | None
) -> None:
    """Add the errors against the density averaged over the separation of the spacecraft.

    Density errors are means of 1 km bins of the rising leg; the error of the differential TEC is
    that of every second.

    Parameters
    ----------
    measured
        Numbers by name; extended.
    history
        The run; nothing is added where it has no density.
    truth
        True ionosphere; nothing is added without it.
    """
    density = history.density
    if truth is None or density is None:
        return
    true = truth.mean_density(history.chief, history.deputy, density.time)
    has_truth = np.isfinite(true)
    rising = has_truth & (np.arange(len(true)) > np.argmin(density.altitude))
    if not rising.any():
        return
    altitudes, errors = _binned_errors(density, true, rising)
    _add_means(measured, "density_error", altitudes, errors, truth)
    content = (density.density - true) * np.abs(density.separation) / ELECTRONS_PER_TECU
    later = has_truth & (density.time - density.time[0] >= _BIAS_DURATION)
    if later.any():
        measured["differential_tec_rms_tecu"] = float(np.sqrt(np.mean(content[later] ** 2)))


def _binned_errors(
    density: DensityHistory, true: FloatArray, chosen: npt.NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray]:
    """Return the middles of 1 km bins (m) and the absolute error of each bin."""
    altitude, sigma = density.altitude[chosen], density.sigma[chosen]
    profile = binned_profile(altitude, density.density[chosen], sigma)
    true_profile = binned_profile(altitude, true[chosen], np.ones(len(altitude)))
    return profile.altitude, np.abs(profile.density - true_profile.density)


def add_single_satellite_density(
    measured: dict[str, Any], history: RunHistory, truth: IonosphereTruth | None
) -> None:
    """Add the errors of the density from the satellite with most seconds, each second by itself.

    Parameters
    ----------
    measured
        Numbers by name; extended.
    history
        The run; nothing is added where the rising leg has no density from single satellites.
    truth
        True ionosphere; nothing is added without it.
    """
    columns, density = history.satellite_density, history.density
    if columns is None or density is None or truth is None:
        return
    low, high = COMPARISON_ALTITUDES
    altitude = columns.values["altitude"]
    compared = columns.time > density.time[np.argmin(density.altitude)]
    compared &= (altitude > low) & (altitude < high)
    satellite = satellite_number(columns.system, columns.prn)
    satellites, counts = np.unique(satellite[compared], return_counts=True)
    if not len(satellites):
        return
    rows = compared & (satellite == satellites[np.argmax(counts)])
    true = truth.mean_density(history.chief, history.deputy, columns.time[rows])
    errors = np.abs(columns.values["density"][rows] - true)
    _add_means(measured, "density_error_single_satellite", altitude[rows], errors, truth)


def _add_means(
    measured: dict[str, Any],
    name: str,
    altitudes: FloatArray,
    errors: FloatArray,
    truth: IonosphereTruth,
) -> None:
    """Add the mean error over all altitudes, and over those of each bubble of the paper."""
    ranges: dict[str, tuple[float, float]] = {"": COMPARISON_ALTITUDES}
    if truth.region_altitudes is None:
        ranges |= {
            f"_bubble_{number}": (bubble.altitude_bottom, bubble.altitude_top)
            for number, bubble in _BUBBLES.items()
        }
    for part, (low, high) in ranges.items():
        inside = (altitudes > low) & (altitudes < high) & np.isfinite(errors)
        if inside.any():
            mean = float(errors[inside].mean()) * _PER_CUBIC_CENTIMETRE
            measured[f"{name}{part}_per_cm3"] = mean
