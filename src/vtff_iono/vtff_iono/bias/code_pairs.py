"""Which codes of a receiver are used: those whose satellite biases are known."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import SECONDS_PER_DAY, SPEED_OF_LIGHT
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss import constants as c
from vtff_gnss.observation_table import ObservationTable
from vtff_gnss.signals import satellite_name
from vtff_iono.bias.code_biases import COARSE_CODE_SIGMA, CodeBias, CodeBiasTable
from vtff_iono.links.signal_pairs import DEFAULT_PAIRS, SignalPair

__all__ = ["CodeChoice", "choose_codes"]

# Columns of the carrier that a code without one borrows from the same band.
_CARRIER_COLUMNS = ("carrier_phase_cycles", "carrier_phase_sigma_cycles", "doppler_hz", "lock_time")
_CARRIER_FLAGS = (
    c.FLAG_PHASE_VALID | c.FLAG_PARITY_KNOWN | c.FLAG_LOCK_LOST | c.FLAG_HALF_CYCLE_ADDED
)
_NANOSECOND = 1e-9 * SPEED_OF_LIGHT
# A pair whose biases are this much better known is worth a departure from the usual one, s.
_WORTHWHILE_GAIN = 0.3e-9
# An assumed bias holds for all of a recording, s.
_LONG = 366 * SECONDS_PER_DAY


@dataclass(frozen=True, eq=False)
class CodeChoice:
    """Observations with carriers for the chosen codes, pairs of signals, and remarks.

    Parameters
    ----------
    table : ObservationTable
    biases : CodeBiasTable
        The biases, completed by what had to be assumed.
    pairs : tuple of SignalPair
        In each, the attributes of the chosen codes come first.
    remarks : tuple of str
        Choices that differ from the usual one, one sentence each.
    """

    table: ObservationTable
    biases: CodeBiasTable
    pairs: tuple[SignalPair, ...]
    remarks: tuple[str, ...]


def choose_codes(table: ObservationTable, biases: CodeBiasTable, tolerance: float) -> CodeChoice:
    """Choose the codes of each pair of bands by what is known of their satellite biases.

    The pair of codes with most satellites of known bias is taken. RINEX 2 has one phase for the
    C/A and the P code of a carrier; a chosen code without a phase takes that of its carrier.

    Parameters
    ----------
    table : ObservationTable
    biases : CodeBiasTable
        Biases of the satellites.
    tolerance : float
        As in `CodeBiasTable.satellite_bias`, s.
    """
    time = table.time(len(table) // 2)
    biases, remarks = _with_assumed_civil_codes(table, biases, time, tolerance)
    chosen: dict[tuple[int, int], str] = {}
    for pair in DEFAULT_PAIRS:
        first, second, remark = _choose(table, pair, biases, time, tolerance)
        if remark:
            remarks.append(remark)
            # A band of two pairs has one order of attributes in both.
            chosen.setdefault((pair.system, pair.band_first), first)
            chosen.setdefault((pair.system, pair.band_second), second)
    for (system, band), attribute in chosen.items():
        table = _with_carriers(table, system, band, attribute)
    pairs = [
        dataclasses.replace(
            pair,
            attributes_first=_put_first(
                chosen.get((pair.system, pair.band_first), ""), pair.attributes_first
            ),
            attributes_second=_put_first(
                chosen.get((pair.system, pair.band_second), ""), pair.attributes_second
            ),
        )
        for pair in DEFAULT_PAIRS
    ]
    return CodeChoice(table, biases, tuple(pairs), tuple(remarks))


def _with_assumed_civil_codes(
    table: ObservationTable, biases: CodeBiasTable, time: GpsTime, tolerance: float
) -> tuple[CodeBiasTable, list[str]]:
    """Add C1C-C1W = 0 where a receiver of GPS has C1C only, and the file P1-P2 biases only."""
    codes = _satellites_of(table, c.SYSTEM_GPS, 1)
    if "C" not in codes or "W" in codes:
        return biases, []
    assumed = []
    for prn in sorted(codes["C"]):

        def is_known(first: str, second: str, prn: int = prn) -> bool:
            bias = biases.satellite_bias(c.SYSTEM_GPS, prn, first, second, time, tolerance)
            return bool(np.isfinite(bias[0]))

        if is_known("C1W", "C2W") and not is_known("C1C", "C1W"):
            bias = CodeBias(
                c.SYSTEM_GPS, prn, "", "C1C", "C1W", time - _LONG, time + _LONG, 0.0,
                COARSE_CODE_SIGMA,
            )  # fmt: skip
            assumed.append(bias)
    if not assumed:
        return biases, []
    joined = CodeBiasTable.joined([biases, CodeBiasTable(assumed, "")])
    joined.origin = biases.origin
    return joined, [
        f"{biases.origin} has no biases of C1C, the only code of the receiver on L1: C1C-C1W of "
        f"{len(assumed)} satellites is taken as zero, which is wrong by "
        f"{1e9 * COARSE_CODE_SIGMA:.1f} ns; a file of P1-C1 biases has them (--biases, repeated)"
    ]


def _choose(
    table: ObservationTable,
    pair: SignalPair,
    biases: CodeBiasTable,
    time: GpsTime,
    tolerance: float,
) -> tuple[str, str, str]:
    """Return the chosen attributes, and a remark if they are not the usual ones."""
    satellites = [
        _satellites_of(table, pair.system, band) for band in (pair.band_first, pair.band_second)
    ]
    usual: tuple[str, str] | None = None
    best: tuple[tuple[int, float], tuple[str, str]] | None = None
    for first, second in _combinations(pair):
        common = satellites[0].get(first, set()) & satellites[1].get(second, set())
        if not common:
            continue
        usual = usual or (first, second)
        codes = f"C{pair.band_first}{first}", f"C{pair.band_second}{second}"
        sigmas = [
            biases.satellite_bias(pair.system, prn, *codes, time, tolerance)[1] for prn in common
        ]
        known = [sigma for sigma in sigmas if np.isfinite(sigma)]
        typical = float(np.median(known)) if known else np.inf
        if best is None or _is_better((len(known), typical), best[0]):
            best = (len(known), typical), (first, second)
    if usual is None or best is None or best[1] == usual:
        return "", "", ""
    names = [f"C{pair.band_first}{a}-C{pair.band_second}{b}" for a, b in (best[1], usual)]
    letter = satellite_name(pair.system, 0)[0]
    size = "".join(
        _mismatch(table, pair.system, band, usual_code, code)
        for band, code, usual_code in zip(
            (pair.band_first, pair.band_second), best[1], usual, strict=True
        )
        if code != usual_code
    )
    return *best[1], (
        f"{letter} {names[0]} is used, whose satellite biases are known best; with {names[1]} "
        f"the receiver bias would be another{size}"
    )


def _put_first(attribute: str, attributes: str) -> str:
    return attribute + attributes.replace(attribute, "") if attribute else attributes


def _is_better(score: tuple[int, float], other: tuple[int, float]) -> bool:
    if score[0] != other[0]:
        return score[0] > other[0]
    return score[1] < other[1] - _WORTHWHILE_GAIN


def _combinations(pair: SignalPair) -> Iterator[tuple[str, str]]:
    for first in pair.attributes_first:
        for second in pair.attributes_second:
            yield first, second


def _satellites_of(table: ObservationTable, system: int, band: int) -> dict[str, set[int]]:
    """Return the satellites of each attribute that has codes on a band."""
    columns = table.columns
    rows = (columns["system"] == system) & (columns["band"] == band)
    rows &= (columns["flags"] & c.FLAG_CODE_VALID) != 0
    attribute, prn = columns["attribute"][rows], columns["prn"][rows]
    return {chr(a): set(np.unique(prn[attribute == a]).tolist()) for a in np.unique(attribute)}


def _rows_of(
    table: ObservationTable, system: int, band: int, attribute: str
) -> npt.NDArray[np.intp]:
    columns = table.columns
    is_signal = (columns["system"] == system) & (columns["band"] == band)
    return np.flatnonzero(is_signal & (columns["attribute"] == ord(attribute)))


def _matching_rows(
    table: ObservationTable, rows: npt.NDArray[np.intp], others: npt.NDArray[np.intp]
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the rows of two signals of the same satellite and epoch."""
    key = table.epoch_index.astype(np.int64) * 256 + table.columns["prn"]
    _, first, second = np.intersect1d(
        key[rows], key[others], assume_unique=True, return_indices=True
    )
    return rows[first], others[second]


def _mismatch(table: ObservationTable, system: int, band: int, usual: str, code: str) -> str:
    """Return the mean difference of two codes on a band as text."""
    rows = _matching_rows(
        table, _rows_of(table, system, band, usual), _rows_of(table, system, band, code)
    )
    values = [table.columns["pseudorange"][index] for index in rows]
    difference = (values[0] - values[1]) / _NANOSECOND
    difference, prn = difference[np.isfinite(difference)], table.columns["prn"][rows[0]]
    if not len(difference):
        return ""
    prn = prn[np.isfinite(values[0] - values[1])]
    by_satellite = [float(np.median(difference[prn == number])) for number in np.unique(prn)]
    return (
        f" (C{band}{usual} - C{band}{code} is {np.mean(by_satellite):.2f} ns, and scatters by "
        f"{np.std(by_satellite):.2f} ns over the satellites)"
    )


def _with_carriers(
    table: ObservationTable, system: int, band: int, attribute: str
) -> ObservationTable:
    """Return the table with phases for the rows of a signal that has codes only."""
    rows = _rows_of(table, system, band, attribute)
    rows = rows[(table.columns["flags"][rows] & c.FLAG_PHASE_VALID) == 0]
    if not len(rows):
        return table
    donors = np.flatnonzero(
        (table.columns["system"] == system)
        & (table.columns["band"] == band)
        & ((table.columns["flags"] & c.FLAG_PHASE_VALID) != 0)
    )
    # Any of several phases of a satellite will do; they are of one carrier.
    key = table.epoch_index[donors].astype(np.int64) * 256 + table.columns["prn"][donors]
    donors = donors[np.unique(key, return_index=True)[1]]
    rows, donors = _matching_rows(table, rows, donors)
    columns = dict(table.columns)
    for name in _CARRIER_COLUMNS:
        columns[name] = columns[name].copy()
        columns[name][rows] = columns[name][donors]
    columns["flags"] = columns["flags"].copy()
    columns["flags"][rows] |= columns["flags"][donors] & _CARRIER_FLAGS
    columns["cn0_dbhz"] = columns["cn0_dbhz"].copy()
    without = rows[np.isnan(columns["cn0_dbhz"][rows])]
    columns["cn0_dbhz"][without] = columns["cn0_dbhz"][donors[np.isin(rows, without)]]
    return dataclasses.replace(table, columns=columns)
