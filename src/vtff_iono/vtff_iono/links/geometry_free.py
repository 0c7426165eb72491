"""Relative slant total electron content from two carrier frequencies.

The plasma delays the code and advances the phase by about ``40.3e16 / f^2`` metres for each TECU
(first order; IERS Conventions 2010, eq. 9.27). The difference of two frequencies removes geometry,
clocks and troposphere; what remains is the content plus the inter-frequency biases of satellite
and receiver (code) or a constant for each arc (phase).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.constants import ELECTRONS_PER_TECU, IONOSPHERIC_DELAY_CONSTANT


def tecu_per_metre(frequency_first: float, frequency_second: float) -> float:
    """Return the slant TEC in TECU that delays the second frequency by 1 m more than the first.

    Parameters
    ----------
    frequency_first, frequency_second
        Carrier frequencies in Hz, the higher one first for a positive value.

    Raises
    ------
    ValueError
        If the frequencies are equal or not positive.
    """
    if not (frequency_first > 0.0 and frequency_second > 0.0):
        raise ValueError(f"frequencies must be positive: {frequency_first}, {frequency_second} Hz")
    if frequency_first == frequency_second:
        raise ValueError(f"the two frequencies are equal: {frequency_first} Hz")
    delay = IONOSPHERIC_DELAY_CONSTANT * ELECTRONS_PER_TECU
    return 1.0 / (delay * (1.0 / frequency_second**2 - 1.0 / frequency_first**2))


def relative_stec_from_code(
    pseudorange_first: npt.ArrayLike,
    pseudorange_second: npt.ArrayLike,
    frequency_first: float,
    frequency_second: float,
) -> FloatArray:
    """Return the slant TEC in TECU from two pseudoranges in m, biases included.

    Parameters
    ----------
    pseudorange_first, pseudorange_second
        Pseudoranges of one satellite in m, any common shape.
    frequency_first, frequency_second
        Their carrier frequencies in Hz.
    """
    difference = np.asarray(pseudorange_second, dtype=float) - np.asarray(pseudorange_first)
    stec_tecu: FloatArray = difference * tecu_per_metre(frequency_first, frequency_second)
    return stec_tecu


def relative_stec_from_phase(
    carrier_phase_cycles_first: npt.ArrayLike,
    carrier_phase_cycles_second: npt.ArrayLike,
    frequency_first: float,
    frequency_second: float,
) -> FloatArray:
    """Return the slant TEC in TECU from two carrier phases, ambiguity constant included.

    Parameters
    ----------
    carrier_phase_cycles_first, carrier_phase_cycles_second
        Carrier phases of one satellite in cycles with the RINEX sign (growing with distance).
    frequency_first, frequency_second
        Their frequencies in Hz.
    """
    first = np.asarray(carrier_phase_cycles_first, dtype=float) * SPEED_OF_LIGHT / frequency_first
    second = (
        np.asarray(carrier_phase_cycles_second, dtype=float) * SPEED_OF_LIGHT / frequency_second
    )
    return (first - second) * tecu_per_metre(frequency_first, frequency_second)
