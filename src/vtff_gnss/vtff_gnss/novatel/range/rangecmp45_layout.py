"""Tables of the bit fields of RANGECMP4 and RANGECMP5 (OEM7 reference manual), for both ways."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from vtff_gnss import constants as c

__all__ = [
    "CN0_SCALE_DBHZ",
    "PHASE_RANGE_SCALE",
    "PRIMARY_DIFFERENCE",
    "PSEUDORANGE_SCALE",
    "RANGECMP4",
    "RANGECMP5",
    "RANGE_RATE_SCALE",
    "SECONDARY_DIFFERENCE",
    "SIGMA_CYCLES_16",
    "SIGMA_METRES_16",
    "SIGNAL_TYPES",
    "CompressedLayout",
    "FieldWidths",
    "to_physical",
]

PSEUDORANGE_SCALE = 0.0005
PHASE_RANGE_SCALE = 0.0001
RANGE_RATE_SCALE = 0.0001
CN0_SCALE_DBHZ = 0.05
"""Steps: m, m, m/s, dB-Hz."""

SIGNAL_TYPES = {
    (c.SYSTEM_GPS, 1): 0,
    (c.SYSTEM_GPS, 4): 9,
    (c.SYSTEM_GPS, 5): 17,
    (c.SYSTEM_GPS, 6): 5,
    (c.SYSTEM_GPS, 7): 14,
    (c.SYSTEM_GPS, 15): 16,
    (c.SYSTEM_GLONASS, 1): 0,
    (c.SYSTEM_GLONASS, 3): 1,
    (c.SYSTEM_GLONASS, 4): 5,
    (c.SYSTEM_GLONASS, 6): 6,
    (c.SYSTEM_SBAS, 1): 0,
    (c.SYSTEM_SBAS, 2): 6,
    (c.SYSTEM_GALILEO, 1): 2,
    (c.SYSTEM_GALILEO, 2): 12,
    (c.SYSTEM_GALILEO, 3): 17,
    (c.SYSTEM_GALILEO, 4): 20,
    (c.SYSTEM_GALILEO, 5): 7,
    (c.SYSTEM_GALILEO, 12): 6,
    (c.SYSTEM_BEIDOU, 1): 0,
    (c.SYSTEM_BEIDOU, 2): 4,
    (c.SYSTEM_BEIDOU, 3): 1,
    (c.SYSTEM_BEIDOU, 4): 5,
    (c.SYSTEM_BEIDOU, 5): 2,
    (c.SYSTEM_BEIDOU, 6): 6,
    (c.SYSTEM_BEIDOU, 7): 7,
    (c.SYSTEM_BEIDOU, 9): 9,
    (c.SYSTEM_BEIDOU, 11): 11,
    (c.SYSTEM_QZSS, 1): 0,
    (c.SYSTEM_QZSS, 3): 17,
    (c.SYSTEM_QZSS, 4): 14,
    (c.SYSTEM_QZSS, 8): 16,
    (c.SYSTEM_QZSS, 11): 27,
    (c.SYSTEM_NAVIC, 1): 0,
}
"""(system, signal number of RANGECMP4 and 5) to the signal type of the tracking status word."""

# Upper bounds of the classes of the sigmas, m and cycles.
SIGMA_METRES_16 = (
    0.020, 0.030, 0.045, 0.066, 0.099, 0.148, 0.220, 0.329,
    0.491, 0.732, 1.092, 1.629, 2.430, 3.625, 5.409, float("inf"),
)  # fmt: skip
SIGMA_CYCLES_16 = (
    0.00391, 0.00521, 0.00696, 0.00929, 0.01239, 0.01654, 0.02208, 0.02947,
    0.03933, 0.05249, 0.07006, 0.09350, 0.12480, 0.16656, 0.22230, float("inf"),
)  # fmt: skip
_SIGMA_METRES_32 = (
    0.020, 0.030, 0.045, 0.066, 0.099, 0.148, 0.220, 0.329, 0.491, 0.732, 1.092,
    1.629, 2.430, 3.625, 5.409, 6.876, 8.741, 11.111, 14.125, 17.957, 22.828, 29.020,
    36.891, 46.898, 59.619, 75.791, 96.349, 122.484, 155.707, 197.943, 251.634, float("inf"),
)  # fmt: skip
_SIGMA_CYCLES_32 = (
    0.00391, 0.00458, 0.00536, 0.00628, 0.00735, 0.00861, 0.01009, 0.01182,
    0.01385, 0.01621, 0.01900, 0.02223, 0.02607, 0.03054, 0.03577, 0.04190,
    0.04908, 0.05749, 0.06734, 0.07889, 0.09240, 0.10824, 0.12679, 0.14851,
    0.17396, 0.20378, 0.23870, 0.27961, 0.32753, 0.38366, 0.44940, float("inf"),
)  # fmt: skip


class FieldWidths(NamedTuple):
    """Bits of pseudorange, phase range and range rate of one kind of block."""

    pseudorange: int
    phase_range: int
    range_rate: int


@dataclass(frozen=True)
class CompressedLayout:
    """Fields in which the layouts of the logs differ.

    Parameters
    ----------
    name : str
    sigma_bits : int
        Number of bits of each of the two sigmas.
    sigma_metres, sigma_cycles : tuple of float
        Sigmas of the classes, m and cycles.
    primary, secondary : FieldWidths
        Fields of the reference blocks of a satellite's first signal, and of its other signals.
    """

    name: str
    sigma_bits: int
    sigma_metres: tuple[float, ...]
    sigma_cycles: tuple[float, ...]
    primary: FieldWidths
    secondary: FieldWidths


RANGECMP4 = CompressedLayout(
    name="RANGECMP4",
    sigma_bits=4,
    sigma_metres=SIGMA_METRES_16,
    sigma_cycles=SIGMA_CYCLES_16,
    primary=FieldWidths(37, 23, 26),
    secondary=FieldWidths(20, 23, 14),
)
RANGECMP5 = CompressedLayout(
    name="RANGECMP5",
    sigma_bits=5,
    sigma_metres=_SIGMA_METRES_32,
    sigma_cycles=_SIGMA_CYCLES_32,
    primary=FieldWidths(37, 23, 28),
    secondary=FieldWidths(20, 23, 16),
)
PRIMARY_DIFFERENCE = FieldWidths(19, 16, 18)
SECONDARY_DIFFERENCE = FieldWidths(19, 16, 14)
"""Layout of the blocks of RANGECMP4 that hold differences."""


def to_physical(value: int | None, scale: float, origin: float) -> float:
    """Return the value of a field of steps of `scale` from `origin`; NaN for None, no value."""
    return math.nan if value is None else value * scale + origin
