"""Numbers of the ionosphere of a run, measured and true, as keys of the summary.

A measured number stands under ``ionosphere_<name>``. The true number, where the run has one, stands
under ``ionosphere_true_<name>`` (docs/summary.md).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vtff_analysis.evaluation.ionosphere_density import add_density, add_single_satellite_density
from vtff_analysis.evaluation.ionosphere_edges import add_edges
from vtff_analysis.evaluation.scintillation import (
    add_scintillation,
    scintillating_windows,
    true_lag,
)
from vtff_analysis.recordings.history import RunHistory
from vtff_analysis.recordings.ionosphere_truth import IonosphereTruth
from vtff_analysis.recordings.matching import match_rows
from vtff_gnss.signals import satellite_number

__all__ = ["summarise_ionosphere"]

Summary = dict[str, Any]


def summarise_ionosphere(
    history: RunHistory, truth: IonosphereTruth | None, lag: float | None = None
) -> Summary:
    """Summarise the ionosphere of a run.

    Parameters
    ----------
    history
        The run.
    truth
        True ionosphere of a simulated run; None where it is not recorded.
    lag
        Time in s by which the deputy's fluctuations of C/N0 follow those of the chief.

    Returns
    -------
    dict
        Flat, keys of docs/summary.md; empty where nothing was measured.
    """
    measured: Summary = {}
    true: Summary = {}
    if history.density is not None:
        add_edges(measured, true, history, truth)
        add_density(measured, history, truth)
        if "density_error_per_cm3" in measured:  # else the altitude hardly changes
            add_single_satellite_density(measured, history, truth)
    add_scintillation(measured, true, history, truth)
    _add_contents(measured, history, truth)
    if lag is not None:
        measured["lag_s"] = lag
        if truth is not None:
            true["lag_s"] = true_lag(truth, history, scintillating_windows(history)[0])
    return {
        **{f"ionosphere_{name}": value for name, value in measured.items()},
        **{f"ionosphere_true_{name}": value for name, value in true.items() if name in measured},
    }


def _add_contents(measured: Summary, history: RunHistory, truth: IonosphereTruth | None) -> None:
    """Add the errors of the absolute contents of rays against those that the receivers saw."""
    for role, craft in (("chief", history.chief), ("deputy", history.deputy)):
        columns = history.slant_tec.get(f"/{craft}/iono/slant_tec")
        rays = None if truth is None else truth.satellites.get(craft)
        if columns is None or rays is None:
            continue
        good = ~(columns.values["rejected"] > 0)
        satellites = satellite_number(columns.system, columns.prn)
        rows_measured, rows_true = match_rows(
            columns.time[good], satellites[good], rays.time, rays.satellite
        )
        if len(rows_measured):
            error = columns.values["stec_tecu"][good][rows_measured] - rays.stec_tecu[rows_true]
            rms = float(np.sqrt(np.nanmean(error**2)))
            measured[f"{role}_slant_tec_error_rms_tecu"] = rms
