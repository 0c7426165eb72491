"""Compiled differences of the phases of two receivers, deputy less chief."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vtff_dynamics.compiled import compiled
from vtff_dynamics.vectors import FloatArray
from vtff_iono.density.common_samples import IntArray, squared_steps

__all__ = [
    "DEVIATION",
    "DEVIATION_SQUARED",
    "ELEVATION_CHIEF",
    "ELEVATION_DEPUTY",
    "GEOMETRIC",
    "STEC",
    "STEP_SQUARED",
    "WIDE_LANE",
    "ReceiverSamples",
    "phase_differences",
]

STEC, DEVIATION, DEVIATION_SQUARED, STEP_SQUARED = range(4)
WIDE_LANE, GEOMETRIC, ELEVATION_CHIEF, ELEVATION_DEPUTY = range(4, 8)
"""Columns of `phase_differences`."""

_COLUMNS = 8


class ReceiverSamples(NamedTuple):
    """What a receiver has observed in a second: k observations, and m rows of links of them.

    Attributes
    ----------
    phase : ndarray, shape (k,)
        Phases, cycles.
    range : ndarray, shape (k,)
        Distances of the satellites, m.
    row_first, row_second : ndarray of int64, shape (m,)
        Observations of the first and second signals of the links.
    wide_lane : ndarray, shape (m,)
        Wide lanes of codes and phases, cycles.
    elevation : ndarray, shape (m,)
        rad.
    """

    phase: FloatArray
    range: FloatArray
    row_first: IntArray
    row_second: IntArray
    wide_lane: FloatArray
    elevation: FloatArray


@compiled
def phase_differences(  # type: ignore[no-untyped-def]
    link,
    row_chief,
    row_deputy,
    chief,
    deputy,
    integers_of_link,
    origin_of_link,
    wavelength_first,
    wavelength_second,
    tecu_per_metre,
    wide_lanes_per_metre,
):
    """Return single differences of the links that both receivers observe, shape (n, 8).

    Parameters
    ----------
    link, row_chief, row_deputy : ndarray of int64, shape (n,)
        As of `common_samples`.
    chief, deputy : ReceiverSamples
    integers_of_link : ndarray, shape (links, 2)
        Integers of both signals, cycles.
    origin_of_link : ndarray, shape (links,)
        Content from which deviations count, TECU; where it is not finite, the first content of the
        link takes its place, also in this array.
    wavelength_first, wavelength_second : float
        m.
    tecu_per_metre, wide_lanes_per_metre : float
        Content of a metre of difference between the signals, and wide lanes of a metre of range.

    Returns
    -------
    ndarray, shape (n, 8)
        The columns are, from `STEC` on, content, TECU, its deviation from the origin, TECU, the
        square of that, the square of its change from sample to sample, TECU^2, wide lane of codes
        and phases less its integers, cycles, wide lane of the phases less that of the ranges and
        less its integers, cycles, and the elevations at both spacecraft, rad.
    """
    count = len(link)
    first, second = np.empty(count), np.empty(count)
    for row in range(count):
        of_chief, of_deputy = row_chief[row], row_deputy[row]
        phase = deputy.phase[deputy.row_first[of_deputy]]
        first[row] = phase - chief.phase[chief.row_first[of_chief]]
        phase = deputy.phase[deputy.row_second[of_deputy]]
        second[row] = phase - chief.phase[chief.row_second[of_chief]]
    stec = np.empty(count)
    for row in range(count):
        along_first = (first[row] - integers_of_link[link[row], 0]) * wavelength_first
        along_second = (second[row] - integers_of_link[link[row], 1]) * wavelength_second
        stec[row] = (along_first - along_second) * tecu_per_metre
    first_content, steps = squared_steps(link, stec, len(origin_of_link))
    for number in range(len(origin_of_link)):
        if not math.isfinite(origin_of_link[number]):
            origin_of_link[number] = first_content[number]
    result = np.empty((count, _COLUMNS))
    for row in range(count):
        of_chief, of_deputy, number = row_chief[row], row_deputy[row], link[row]
        integer = integers_of_link[number, 0] - integers_of_link[number, 1]
        ranges = deputy.range[deputy.row_first[of_deputy]]
        ranges -= chief.range[chief.row_first[of_chief]]
        deviation = stec[row] - origin_of_link[number]
        geometric = first[row] - second[row] - wide_lanes_per_metre * ranges - integer
        result[row, STEC] = stec[row]
        result[row, DEVIATION] = deviation
        result[row, DEVIATION_SQUARED] = deviation * deviation
        result[row, STEP_SQUARED] = steps[row]
        result[row, WIDE_LANE] = deputy.wide_lane[of_deputy] - chief.wide_lane[of_chief] - integer
        result[row, GEOMETRIC] = geometric
        result[row, ELEVATION_CHIEF] = chief.elevation[of_chief]
        result[row, ELEVATION_DEPUTY] = deputy.elevation[of_deputy]
    return result
