"""From the observations of a receiver to its table of electron contents."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from vtff_analysis.tec.sources import TecError, TecSource, receiver_positions
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.signals import satellite_name
from vtff_iono.bias.code_biases import CodeBiasTable, broadcast_code_biases
from vtff_iono.content.absolute_tec import AbsoluteTec, absolute_tec
from vtff_iono.content.rate_of_tec import RateOfTecMonitor
from vtff_iono.content.slant_tec import Rejection, no_bias
from vtff_iono.scintillation.indices import (
    ScintillationMonitor,
    ScintillationSettings,
    ScintillationWindow,
    default_phase_cutoff_hz,
)

__all__ = ["TecResult", "phase_cutoff_hz", "process", "rejection_counts"]

_SLOWEST_FOR_SCINTILLATION = 4.0
_BIAS_TOLERANCE = 86400.0
_FEWEST_EPOCHS = 2


@dataclass(frozen=True, eq=False)
class TecResult:
    """Results that `vtff tec` writes for a receiver.

    Parameters
    ----------
    source : TecSource
    content : AbsoluteTec
    roti : dict of str to ndarray
        Columns of the table of ROTI.
    roti_interval, roti_window : float
        s.
    scintillation : list of ScintillationWindow
        Empty for rates below 4 Hz.
    remarks : tuple of str
    """

    source: TecSource
    content: AbsoluteTec
    roti: dict[str, npt.NDArray[Any]]
    roti_interval: float
    roti_window: float
    scintillation: list[ScintillationWindow]
    remarks: tuple[str, ...]


def process(
    source: TecSource,
    ephemerides: Sequence[BroadcastEphemeris],
    biases: str | CodeBiasTable,
) -> TecResult:
    """Return contents, ROTI and, at high rates, scintillation of a receiver.

    Parameters
    ----------
    source : TecSource
    ephemerides : sequence of BroadcastEphemeris
        Ephemerides in addition to those of the source.
    biases : CodeBiasTable or {"broadcast", "none"}
        Code biases of the satellites.

    Raises
    ------
    TecError
        If there are no observations, ephemerides or position.
    vtff_iono.bias.code_biases.BiasFileError
        If the biases are of another time.
    """
    table = source.table
    if len(table) < _FEWEST_EPOCHS:
        raise TecError(
            f"{source.description}: {len(table)} epochs of observations; TEC needs "
            f"{_FEWEST_EPOCHS} at least"
        )
    orbits = tuple(dict.fromkeys((*source.ephemerides, *ephemerides)))
    if not orbits:
        raise TecError(
            f"{source.description}: no ephemerides in it, name a navigation file with --nav"
        )
    counts = np.diff(table.first_row)
    time = np.repeat(table.time_nanoseconds, counts)
    if source.position_itrf is not None:
        position: FloatArray = np.array(source.position_itrf)
    else:
        position = np.repeat(receiver_positions(table, orbits), counts, axis=0)
    if isinstance(biases, CodeBiasTable):
        biases.require_valid(GpsTime(int(time[0])), _BIAS_TOLERANCE)
    chosen = broadcast_code_biases(orbits) if biases == "broadcast" else biases
    satellite_bias = no_bias
    if isinstance(chosen, CodeBiasTable):
        bias_table = chosen

        def satellite_bias(link, when):  # type: ignore[no-untyped-def]
            codes = (link.code_first, link.code_second)
            return bias_table.satellite_bias(link.system, link.prn, *codes, when, _BIAS_TOLERANCE)

    content = absolute_tec(time, table.columns, position, orbits, satellite_bias)
    remarks = [*source.remarks, *content.remarks]
    if not (content.rejected == 0).any():
        remarks.append(f"no sample is good: {rejection_counts(content.rejected)}")
    step = float(np.median(np.diff(table.time_nanoseconds))) / NANOSECONDS_PER_SECOND
    interval = 1.0 if step <= 1.0 else step
    window = 60.0 if step <= 1.0 else 10.0 * interval
    scintillation = []
    if step <= 1.0 / _SLOWEST_FOR_SCINTILLATION:
        angles = content.geometry
        monitor = ScintillationMonitor(
            ScintillationSettings(phase_cutoff_hz=phase_cutoff_hz(position))
        )
        scintillation = [
            *monitor.update(time, table.columns, angles.elevation, angles.azimuth),
            *monitor.flush(),
        ]
    return TecResult(
        source=source,
        content=content,
        roti=_roti(content, interval, window),
        roti_interval=interval,
        roti_window=window,
        scintillation=scintillation,
        remarks=tuple(remarks),
    )


def phase_cutoff_hz(position_itrf: FloatArray) -> float:
    """Return the cut-off of sigma-phi for the motion of a receiver: on the ground or in orbit, Hz.

    Parameters
    ----------
    position_itrf : ndarray, shape (3,) or (n, 3)
        Positions of the receiver, m; NaN where unknown.
    """
    position = np.atleast_2d(position_itrf)
    position = position[np.isfinite(position).all(axis=-1)]
    # Without any position, the altitude is NaN: not below the lowest orbit.
    altitude = np.median(geodetic_from_itrf(position)[..., 2]) if len(position) else np.nan
    return default_phase_cutoff_hz(float(altitude))


def rejection_counts(rejected: npt.NDArray[np.uint16]) -> dict[str, int]:
    """Return how many samples were rejected for each reason that occurs."""
    counts = {
        str(reason.name): int(np.count_nonzero(rejected & np.uint16(reason)))
        for reason in Rejection
        if reason
    }
    return {name: count for name, count in counts.items() if count}


def _roti(content: AbsoluteTec, interval: float, window: float) -> dict[str, npt.NDArray[Any]]:
    monitor = RateOfTecMonitor(interval, window)
    windows = [*monitor.update(content.rows), *monitor.flush()]
    links = [number for roti_window in windows for number in roti_window.link.tolist()]
    return {
        "time_nanoseconds": np.array(
            [roti_window.time for roti_window in windows for _ in roti_window.link], dtype=np.int64
        ),
        "satellite": np.array(
            [satellite_name(content.links[n].system, content.links[n].prn) for n in links]
        ),
        "pair": np.array(
            [f"{content.links[n].code_first}-{content.links[n].code_second}" for n in links]
        ),
        "roti_tecu_per_minute": np.concatenate(
            [np.zeros(0), *(roti_window.roti_tecu_per_minute for roti_window in windows)]
        ),
        "rates": np.concatenate(
            [np.zeros(0, np.int64), *(roti_window.rates for roti_window in windows)]
        ),
    }
