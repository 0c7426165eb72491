"""NovAtel's numbers of systems, signals and satellites, and what RINEX calls them.

Source: OEM7 Commands and Logs Reference Manual, log RANGE, tables "Channel Tracking Status" and
"GNSS signal" (the OEMV and OEM6 manuals number the signals they have in the same way); RINEX
3.05, tables 4 to 10. L2C(M) is ``2S``; semi-codeless L2P(Y) is ``2W``.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from vtff_gnss import constants as c

__all__ = [
    "NOVATEL_SIGNALS",
    "flags_from_status",
    "rinex_prn",
    "rinex_signal",
    "signal_from_status",
    "system_from_status",
]

NOVATEL_SIGNALS: dict[tuple[int, int], tuple[int, str]] = {
    (c.SYSTEM_GPS, 0): (1, "C"),  # L1 C/A
    (c.SYSTEM_GPS, 5): (2, "P"),  # L2P
    (c.SYSTEM_GPS, 9): (2, "W"),  # L2P(Y), semi-codeless
    (c.SYSTEM_GPS, 14): (5, "Q"),  # L5Q
    (c.SYSTEM_GPS, 16): (1, "L"),  # L1C(P)
    (c.SYSTEM_GPS, 17): (2, "S"),  # L2C(M)
    (c.SYSTEM_GLONASS, 0): (1, "C"),  # L1 C/A
    (c.SYSTEM_GLONASS, 1): (2, "C"),  # L2 C/A
    (c.SYSTEM_GLONASS, 5): (2, "P"),  # L2P
    (c.SYSTEM_GLONASS, 6): (3, "Q"),  # L3Q
    (c.SYSTEM_SBAS, 0): (1, "C"),  # L1 C/A
    (c.SYSTEM_SBAS, 6): (5, "I"),  # L5I
    (c.SYSTEM_GALILEO, 2): (1, "C"),  # E1C
    (c.SYSTEM_GALILEO, 6): (6, "B"),  # E6B
    (c.SYSTEM_GALILEO, 7): (6, "C"),  # E6C
    (c.SYSTEM_GALILEO, 12): (5, "Q"),  # E5aQ
    (c.SYSTEM_GALILEO, 17): (7, "Q"),  # E5bQ
    (c.SYSTEM_GALILEO, 20): (8, "Q"),  # AltBOCQ
    (c.SYSTEM_BEIDOU, 0): (2, "I"),  # B1I with D1
    (c.SYSTEM_BEIDOU, 1): (7, "I"),  # B2I with D1
    (c.SYSTEM_BEIDOU, 2): (6, "I"),  # B3I with D1
    (c.SYSTEM_BEIDOU, 4): (2, "I"),  # B1I with D2
    (c.SYSTEM_BEIDOU, 5): (7, "I"),  # B2I with D2
    (c.SYSTEM_BEIDOU, 6): (6, "I"),  # B3I with D2
    (c.SYSTEM_BEIDOU, 7): (1, "P"),  # B1C(P)
    (c.SYSTEM_BEIDOU, 9): (5, "P"),  # B2a(P)
    (c.SYSTEM_BEIDOU, 11): (7, "D"),  # B2b(I)
    (c.SYSTEM_QZSS, 0): (1, "C"),  # L1 C/A
    (c.SYSTEM_QZSS, 14): (5, "Q"),  # L5Q
    (c.SYSTEM_QZSS, 16): (1, "L"),  # L1C(P)
    (c.SYSTEM_QZSS, 17): (2, "S"),  # L2C(M)
    (c.SYSTEM_QZSS, 27): (6, "L"),  # L6P
    (c.SYSTEM_NAVIC, 0): (5, "A"),  # L5 SPS
}
"""(system, NovAtel signal type) to (RINEX frequency digit, RINEX attribute)."""

# System to (RINEX satellite numbers that exist, offset of the NovAtel PRN).
_SATELLITES = {
    c.SYSTEM_GPS: (range(1, 33), 0),
    c.SYSTEM_GLONASS: (range(1, 28), 37),
    c.SYSTEM_SBAS: (range(20, 99), 100),
    c.SYSTEM_GALILEO: (range(1, 37), 0),
    c.SYSTEM_BEIDOU: (range(1, 64), 0),
    c.SYSTEM_QZSS: (range(1, 11), 192),
    c.SYSTEM_NAVIC: (range(1, 15), 0),
}
_MAX_PRN_NOVATEL = 255
_PRN = np.zeros((8, _MAX_PRN_NOVATEL + 1), dtype=np.intp)
for _system, (_numbers, _offset) in _SATELLITES.items():
    for _number in _numbers:
        _PRN[_system, _number + _offset] = _number

_BAND = np.zeros((8, 32), dtype=np.uint8)
_ATTRIBUTE = np.zeros((8, 32), dtype=np.uint8)
for (_system, _signal), (_band, _attribute) in NOVATEL_SIGNALS.items():
    _BAND[_system, _signal] = _band
    _ATTRIBUTE[_system, _signal] = ord(_attribute)

# By bits 10 (phase lock), 11 (parity known), 12 (code locked) and 28 (half cycle added).
_FLAGS = np.array(
    [
        (bits & 1) * c.FLAG_PHASE_VALID
        | (bits >> 1 & 1) * c.FLAG_PARITY_KNOWN
        | (bits >> 2 & 1) * c.FLAG_CODE_VALID
        | (bits >> 3 & 1) * c.FLAG_HALF_CYCLE_ADDED
        for bits in range(16)
    ],
    dtype=np.uint16,
)


def system_from_status(status: npt.NDArray[np.integer]) -> npt.NDArray[np.intp]:
    """Return the satellite system (bits 16-18) of channel tracking status words, shape (n,)."""
    return np.asarray(status >> 16 & 7, dtype=np.intp)


def signal_from_status(status: npt.NDArray[np.integer]) -> npt.NDArray[np.intp]:
    """Return the signal type (bits 21-25) of channel tracking status words, shape (n,)."""
    return np.asarray(status >> 21 & 31, dtype=np.intp)


def flags_from_status(status: npt.NDArray[np.integer]) -> npt.NDArray[np.uint16]:
    """Return ``FLAG_*`` of channel tracking status words, shape (n,).

    Bits 10 phase lock, 11 parity known, 12 code locked, 28 half cycle added.
    """
    return np.asarray(_FLAGS[status >> 10 & 7 | status >> 25 & 8])


def rinex_signal(
    system: npt.NDArray[np.intp], signal: npt.NDArray[np.intp]
) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]]:
    """Return RINEX frequency digit and attribute, shape (n,); 0 for an unknown signal."""
    return _BAND[system, signal], _ATTRIBUTE[system, signal]


def rinex_prn(
    system: npt.NDArray[np.intp], prn_novatel: npt.NDArray[np.integer]
) -> npt.NDArray[np.intp]:
    """Return the RINEX satellite number, shape (n,); 0 for a number that does not exist."""
    return np.asarray(_PRN[system, np.minimum(prn_novatel, _MAX_PRN_NOVATEL)])
