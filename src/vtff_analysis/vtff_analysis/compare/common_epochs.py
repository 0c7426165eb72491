"""Errors of navigation at the epochs that all compared runs have.

A filter that gives no solution when it is hard has fewer and easier epochs: over its own epochs it
may look better than one that goes on.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np

from vtff_analysis.evaluation.navigation import NavigationError
from vtff_analysis.recordings.history import AXES

__all__ = ["summarise_common_epochs"]

_MILLISECONDS = 1e3


def summarise_common_epochs(errors: Sequence[NavigationError]) -> list[dict[str, Any]]:
    """Return the errors of each run at the common epochs, by key.

    Parameters
    ----------
    errors
        Errors of one deputy in each run; epochs are equal when they lie equally long after the
        start of their runs.

    Returns
    -------
    list of dict
        For each run: ``navigation_epochs`` (its own), ``navigation_common_epochs``,
        ``navigation_common_<axis>_rms_m``, ``navigation_common_maximum_m``, and of the epochs that
        are settled in every run ``navigation_common_settled_epochs`` and
        ``navigation_common_settled_3d_rms_m``; None where there is no such epoch.
    """
    keys = [np.round(error.time * _MILLISECONDS).astype(np.int64) for error in errors]
    common = functools.reduce(np.intersect1d, keys)
    rows = [np.flatnonzero(np.isin(key, common)) for key in keys]
    chosen = [row[np.argsort(key[row])] for row, key in zip(rows, keys, strict=True)]
    settled = np.ones(len(common), dtype=bool)
    for error, row in zip(errors, chosen, strict=True):
        settled &= error.is_settled[row]
    return [_summarise(error, row, settled) for error, row in zip(errors, chosen, strict=True)]


def _summarise(error: NavigationError, rows: Any, settled: Any) -> dict[str, Any]:
    position = error.position_rtn[rows]
    summary: dict[str, Any] = {
        "navigation_epochs": len(error.time),
        "navigation_common_epochs": len(position),
        "navigation_common_settled_epochs": int(settled.sum()),
    }
    for column, axis in enumerate(AXES):
        squares = position[:, column] ** 2
        rms = float(np.sqrt(squares.mean())) if len(position) else None
        summary[f"navigation_common_{axis}_rms_m"] = rms
    length = np.linalg.norm(position, axis=1)
    summary["navigation_common_maximum_m"] = float(length.max()) if len(length) else None
    kept = length[settled]
    rms_3d = float(np.sqrt(np.mean(kept**2))) if len(kept) else None
    summary["navigation_common_settled_3d_rms_m"] = rms_3d
    return summary
