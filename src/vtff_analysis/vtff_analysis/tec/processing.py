"""From the observations of a receiver to its table of electron contents."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from vtff_analysis.tec.consistency import satellite_disagreement
from vtff_analysis.tec.errors import TecError
from vtff_analysis.tec.receiver_orbit import ReceiverOrbit, positions_from_codes
from vtff_analysis.tec.sources import TecSource
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.frames.geodetic import geodetic_from_itrf
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import SYSTEM_LETTERS
from vtff_gnss.files.navigation_files import NavigationFiles
from vtff_gnss.observation_table import ObservationTable
from vtff_gnss.orbits.satellite_table import SatelliteOrbits
from vtff_gnss.signals import SYSTEM_FULL_NAMES, satellite_name
from vtff_iono.bias.code_biases import CodeBiasTable, broadcast_code_biases
from vtff_iono.bias.code_pairs import choose_codes
from vtff_iono.content.absolute_tec import AbsoluteTec, absolute_tec
from vtff_iono.content.rate_of_tec import RateOfTecMonitor
from vtff_iono.content.slant_tec import BiasFunction, Rejection, no_bias
from vtff_iono.links.signal_pairs import DEFAULT_PAIRS, Link, SignalPair
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
    navigation: NavigationFiles,
    biases: str | CodeBiasTable,
    orbit: ReceiverOrbit | None = None,
    allow_old_biases: bool = False,
) -> TecResult:
    """Return contents, ROTI and, at high rates, scintillation of a receiver.

    Parameters
    ----------
    source : TecSource
    navigation : NavigationFiles
        Orbits in addition to those of the source.
    biases : CodeBiasTable or {"broadcast", "none"}
        Code biases of the satellites.
    orbit : ReceiverOrbit, optional
        Orbit of the receiver; default: its own fixes, else positions from its codes.
    allow_old_biases : bool
        Whether biases of another time are used, with a remark.

    Raises
    ------
    TecError
        If there are no observations, orbits or position.
    vtff_gnss.files.observation_files.ObservationFileError
        If the orbits are those of another time.
    vtff_iono.bias.code_biases.BiasFileError
        If the biases are of another time.
    """
    table = source.table
    if len(table) < _FEWEST_EPOCHS:
        raise TecError(
            f"{source.description}: {len(table)} epochs of observations; TEC needs "
            f"{_FEWEST_EPOCHS} at least"
        )
    navigation = navigation.with_ephemerides(source.ephemerides)
    if navigation.is_empty:
        raise TecError(
            f"{source.description}: no ephemerides in it, name a navigation file with --nav"
        )
    navigation.require_coverage(table.time_nanoseconds, source.description)
    remarks = [*source.remarks]
    if biases == "none":
        remarks.append(
            "no satellite biases are removed: contents and receiver biases are right only if the "
            "signals have none"
        )
    bias_table = _bias_table(navigation, biases)
    tolerance = _BIAS_TOLERANCE
    if isinstance(biases, CodeBiasTable):
        middle = table.time(len(table) // 2)
        if allow_old_biases and not biases.is_valid(middle, _BIAS_TOLERANCE):
            remarks.append(biases.describe_age(middle))
            biases = biases.at_all_times()
            bias_table = biases
        else:
            biases.require_valid(middle, _BIAS_TOLERANCE)
    table, orbits, reasons = _usable_systems(table, navigation, bias_table)
    remarks += reasons
    pairs: tuple[SignalPair, ...] = DEFAULT_PAIRS
    if bias_table is not None:
        choice = choose_codes(table, bias_table, tolerance)
        table, bias_table, pairs = choice.table, choice.biases, choice.pairs
        remarks += choice.remarks
    counts = np.diff(table.first_row)
    time = np.repeat(table.time_nanoseconds, counts)
    position = _receiver_position(source, table, orbits, orbit)
    if position.ndim > 1:
        position = np.repeat(position, counts, axis=0)
    satellite_bias = no_bias if bias_table is None else _bias_function(bias_table, tolerance)
    content = absolute_tec(time, table.columns, position, orbits, satellite_bias, pairs)
    remarks += content.remarks
    if not (content.rejected == 0).any():
        remarks.append(f"no sample is good: {describe_rejections(content.rejected)}")
    remarks += _disagreement(content)
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


def _disagreement(content: AbsoluteTec) -> list[str]:
    """Return a remark if the satellites differ by more than their sigmas say."""
    good = content.rejected == 0
    rows = content.rows
    found = satellite_disagreement(
        rows.pairs.time[good],
        rows.pairs.link[good],
        rows.elevation[good],
        content.stec_tecu[good],
        content.vtec_tecu[good],
        content.stec_sigma_tecu[good],
    )
    return [] if found is None or not found.is_beyond_sigma else [found.describe()]


def _bias_table(navigation: NavigationFiles, biases: str | CodeBiasTable) -> CodeBiasTable | None:
    """Return the biases of the satellites; None if there are none to remove."""
    if isinstance(biases, CodeBiasTable):
        return biases
    return broadcast_code_biases(navigation.ephemerides) if biases == "broadcast" else None


def _bias_function(biases: CodeBiasTable, tolerance: float) -> BiasFunction:
    def satellite_bias(link: Link, when: GpsTime) -> tuple[float, float]:
        codes = (link.code_first, link.code_second)
        return biases.satellite_bias(link.system, link.prn, *codes, when, tolerance)

    return satellite_bias


def _usable_systems(
    table: ObservationTable, navigation: NavigationFiles, biases: CodeBiasTable | None
) -> tuple[ObservationTable, dict[int, SatelliteOrbits], list[str]]:
    """Return observations and orbits of the systems with pairs, orbits and biases, and remarks.

    The remarks say why other systems are not used.

    Raises
    ------
    TecError
        If no system is left.
    """
    with_pairs = {pair.system for pair in DEFAULT_PAIRS}
    observed = np.unique(table.columns["system"]).tolist()
    with_orbits = navigation.by_system(observed)
    with_biases = None if biases is None else {bias.system for bias in biases.biases}
    reasons: dict[str, list[str]] = {}
    used = {}
    for system in observed:
        if system not in with_pairs:
            reason = "no two bands of these are paired"
        elif system not in with_orbits:
            reason = "no orbits; broadcast ones are read of GPS and Galileo, an SP3 file has others"
        elif with_biases is not None and system not in with_biases:
            reason = f"no satellite biases in {biases.origin if biases else ''}"
        else:
            used[system] = with_orbits[system]
            continue
        reasons.setdefault(reason, []).append(SYSTEM_FULL_NAMES[system])
    remarks = [f"{', '.join(names)} not used: {reason}" for reason, names in reasons.items()]
    if not used:
        raise TecError("; ".join(remarks) or "no observations")
    letters = "".join(SYSTEM_LETTERS[system] for system in used)
    return table.select(systems=letters), used, remarks


def _receiver_position(
    source: TecSource,
    table: ObservationTable,
    orbits: Mapping[int, SatelliteOrbits],
    orbit: ReceiverOrbit | None,
) -> FloatArray:
    """Return the position at rest, shape (3,), or of each epoch, shape (m, 3), ITRF, m."""
    if orbit is not None:
        return orbit.positions(table.time_nanoseconds)
    if source.position_itrf is not None:
        return np.array(source.position_itrf)
    if source.orbit is not None:
        return source.orbit.positions(table.time_nanoseconds)
    return positions_from_codes(table, orbits)


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


def describe_rejections(rejected: npt.NDArray[np.uint16]) -> str:
    """Return the reasons of rejected samples with their numbers as text."""
    counts = rejection_counts(rejected)
    return ", ".join(f"{name.lower().replace('_', ' ')} {count}" for name, count in counts.items())


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
