"""Collects the fields of signals decoded one by one into columns."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vtff_gnss import constants as c
from vtff_gnss.novatel.range.signal_records import SignalRecords
from vtff_gnss.novatel.range.tracking_status import NOVATEL_SIGNALS
from vtff_gnss.signals import carrier_wavelength

__all__ = ["CLASS_BOUND", "LOCK_TIME_CLASSES", "SignalRow", "records_from_rows", "wavelength"]

LOCK_TIME_CLASSES = (0.0,) + tuple(0.016 * 2.0**k for k in range(15))
"""Least lock time, s, of the 4-bit classes of RANGECMP4 and RANGECMP5."""
CLASS_BOUND = (*LOCK_TIME_CLASSES[1:], float("inf"))
"""Greatest lock time, s, of the same classes."""


class SignalRow(NamedTuple):
    """One signal, in the order and units of `SignalRecords`."""

    system: int
    signal: int
    prn_novatel: int
    glonass_channel: int
    pseudorange: float
    carrier_phase_cycles: float
    doppler_hz: float
    cn0_dbhz: float
    pseudorange_sigma: float
    carrier_phase_sigma_cycles: float
    lock_time: float
    lock_time_bound: float
    flags: int


_COLUMN_TYPES: dict[str, type[np.generic]] = {
    "system": np.intp,
    "signal": np.intp,
    "prn_novatel": np.intp,
    "glonass_channel": np.intp,
    "flags": np.uint16,
}
_WAVELENGTH = {
    (system, signal): float(carrier_wavelength(system, band))
    for (system, signal), (band, _) in NOVATEL_SIGNALS.items()
    if system != c.SYSTEM_GLONASS
}
_GLONASS_WAVELENGTH = {
    (signal, channel): float(carrier_wavelength(c.SYSTEM_GLONASS, band, channel))
    for (system, signal), (band, _) in NOVATEL_SIGNALS.items()
    if system == c.SYSTEM_GLONASS
    for channel in range(-7, 25)
}


def wavelength(system: int, signal: int, glonass_channel: int) -> float:
    """Return the wavelength, m, of a signal in NovAtel's numbering; NaN if unknown."""
    if system == c.SYSTEM_GLONASS:
        return _GLONASS_WAVELENGTH.get((signal, glonass_channel), float("nan"))
    return _WAVELENGTH.get((system, signal), float("nan"))


def records_from_rows(rows: list[SignalRow]) -> SignalRecords:
    """Turn rows into columns."""
    arrays: dict[str, Any] = {}
    for index, name in enumerate(SignalRow._fields):
        kind = _COLUMN_TYPES.get(name, np.float64)
        arrays[name] = np.array([row[index] for row in rows], dtype=kind)
    return SignalRecords(**arrays)
