"""Errors of a baseline against true positions in a file."""

from __future__ import annotations

import csv
import gzip
import io
import pathlib
import zipfile

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from vtff_analysis.baseline.processing import BaselineRun
from vtff_analysis.baseline.sources import BaselineError, TrueBaseline
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND, SECONDS_PER_DAY
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.rinex.compressed_file import read_file

__all__ = ["errors_local"]

# s; an epoch belongs to a true position whose time differs by less.
_TOLERANCE = 1e-3
_UNREADABLE = (
    *(KeyError, IndexError, ValueError, EOFError),
    *(zipfile.BadZipFile, pa.ArrowException),
)
_OWN_COLUMNS = ("time_gps_seconds", "baseline_x", "baseline_y", "baseline_z")
_SIMGEN_COLUMNS = ("Time_ms", "Pos_X", "Pos_Y", "Pos_Z")


def errors_local(run: BaselineRun, truth: TrueBaseline | pathlib.Path) -> FloatArray:
    """Return estimated less true baseline in the local axes, shape (n, 3), m; NaN without truth.

    Parameters
    ----------
    run : BaselineRun
        Estimated baselines.
    truth : TrueBaseline or pathlib.Path
        True baselines, or one of these files, compressed with gzip or not:

        - ``.npz`` with ``t`` (s of the GPS day or since 1980-01-06), ``A`` and ``B`` (n, 3), ITRF
          positions of base and rover, m;
        - the CSV file of SimGEN's motion log of the rover; the base is that of the run;
        - the Parquet or CSV file that ``vtff baseline`` writes.

    Raises
    ------
    BaselineError
        If the file is none of these or has no epoch in common with the run.
    OSError
        If the file cannot be read.
    """
    seconds = run.time_nanoseconds / NANOSECONDS_PER_SECOND
    if isinstance(truth, TrueBaseline):
        return _compute_errors(
            run, truth.time_nanoseconds / NANOSECONDS_PER_SECOND, truth.baseline_itrf
        )
    path = truth
    try:
        if path.suffix == ".npz":
            times, baseline = _read_npz(path)
            if times.max() < 2 * SECONDS_PER_DAY:
                times = times + seconds[0] // SECONDS_PER_DAY * SECONDS_PER_DAY
        elif path.suffix == ".parquet":
            times, baseline = _read_parquet(path)
        else:
            times, baseline, is_rover = _read_csv(path)
            if is_rover:
                baseline = baseline - np.nanmedian(run.position_base_itrf, axis=0)
    except _UNREADABLE as error:
        raise BaselineError(f"{path}: not a file of true positions: {error}") from None
    errors = _compute_errors(run, times, baseline)
    if np.isnan(errors).all():
        raise BaselineError(f"{path}: no epoch in common with the solutions")
    return errors


def _compute_errors(run: BaselineRun, times: FloatArray, baseline: FloatArray) -> FloatArray:
    seconds = run.time_nanoseconds / NANOSECONDS_PER_SECOND
    nearest = np.clip(np.searchsorted(times, seconds - _TOLERANCE), 0, len(times) - 1)
    has_truth = np.abs(times[nearest] - seconds) < _TOLERANCE
    error_itrf = np.where(has_truth[:, None], run.baseline_itrf - baseline[nearest], np.nan)
    return np.asarray(np.einsum("nij,nj->ni", run.rotation_to_local, error_itrf))


def _read_npz(path: pathlib.Path) -> tuple[FloatArray, FloatArray]:
    with np.load(path, allow_pickle=False) as arrays:
        base, rover = arrays["A"], arrays["B"]
        return arrays["t"].astype(float), (rover - base)[:, :3].astype(float)


def _read_parquet(path: pathlib.Path) -> tuple[FloatArray, FloatArray]:
    table = parquet.read_table(path, columns=list(_OWN_COLUMNS))
    values = np.column_stack([table[column].to_numpy() for column in _OWN_COLUMNS])
    return values[:, 0], values[:, 1:]


def _read_csv(path: pathlib.Path) -> tuple[FloatArray, FloatArray, bool]:
    """Return times, positions, and whether these are positions of the rover, not baselines."""
    content = read_file(path)
    if content[:2] == b"\x1f\x8b":
        content = gzip.decompress(content)
    rows = list(csv.reader(io.StringIO(content.decode("ascii"))))
    for number, row in enumerate(rows[:5]):
        names = [name.strip() for name in row]
        for columns in (_OWN_COLUMNS, _SIMGEN_COLUMNS):
            if set(columns) <= set(names):
                indices = [names.index(column) for column in columns]
                values = np.array(
                    [[float(r[i] or "nan") for i in indices] for r in rows[number + 1 :] if r]
                )
                if columns is _OWN_COLUMNS:
                    return values[:, 0], values[:, 1:], False
                # The line above the names ends with the GPS seconds of the start.
                start = float(rows[number - 1][-1])
                return start + values[:, 0] / 1e3, values[:, 1:], True
    raise ValueError(f"columns {', '.join(_OWN_COLUMNS)} or {', '.join(_SIMGEN_COLUMNS)} expected")
