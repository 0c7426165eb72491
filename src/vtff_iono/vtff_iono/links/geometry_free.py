"""The factor between a slant electron content and the delays of two carrier frequencies.

The plasma delays the code and advances the phase by about ``40.3e16 / f^2`` metres for each TECU
(first order; IERS Conventions 2010, eq. 9.27). The difference of two frequencies removes geometry,
clocks and troposphere. What remains is the content plus the inter-frequency biases of satellite
and receiver (code), or plus a constant for each arc (phase).
"""

from __future__ import annotations

from vtff_gnss.constants import DELAY_PER_TECU

__all__ = ["tecu_per_metre"]


def tecu_per_metre(frequency_first: float, frequency_second: float) -> float:
    """Return the slant TEC that delays the second frequency by 1 m more than the first, TECU.

    Parameters
    ----------
    frequency_first, frequency_second
        Carrier frequencies, Hz; the value is positive if the first frequency is the higher one.

    Raises
    ------
    ValueError
        If the frequencies are equal or not positive.
    """
    if not (frequency_first > 0.0 and frequency_second > 0.0):
        raise ValueError(f"frequencies must be positive: {frequency_first}, {frequency_second} Hz")
    if frequency_first == frequency_second:
        raise ValueError(f"the two frequencies are equal: {frequency_first} Hz")
    return 1.0 / (DELAY_PER_TECU * (1.0 / frequency_second**2 - 1.0 / frequency_first**2))
