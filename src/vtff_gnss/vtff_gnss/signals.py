"""Carrier frequency of a signal named by satellite system and RINEX frequency digit."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_gnss import constants as c

__all__ = ["carrier_frequency_hz", "carrier_wavelength", "satellite_name"]

_BAND_FREQUENCIES_HZ = {
    c.SYSTEM_GPS: {1: c.FREQUENCY_L1, 2: c.FREQUENCY_L2, 5: c.FREQUENCY_L5},
    c.SYSTEM_GLONASS: {
        1: c.FREQUENCY_GLONASS_L1,
        2: c.FREQUENCY_GLONASS_L2,
        3: c.FREQUENCY_GLONASS_L3,
    },
    c.SYSTEM_SBAS: {1: c.FREQUENCY_L1, 5: c.FREQUENCY_L5},
    c.SYSTEM_GALILEO: {
        1: c.FREQUENCY_L1,
        5: c.FREQUENCY_L5,
        6: c.FREQUENCY_E6,
        7: c.FREQUENCY_E5B,
        8: c.FREQUENCY_E5,
    },
    c.SYSTEM_BEIDOU: {
        1: c.FREQUENCY_L1,
        2: c.FREQUENCY_B1I,
        5: c.FREQUENCY_L5,
        6: c.FREQUENCY_B3I,
        7: c.FREQUENCY_E5B,
        8: c.FREQUENCY_E5,
    },
    c.SYSTEM_QZSS: {1: c.FREQUENCY_L1, 2: c.FREQUENCY_L2, 5: c.FREQUENCY_L5, 6: c.FREQUENCY_E6},
    c.SYSTEM_NAVIC: {5: c.FREQUENCY_L5},
}

_FREQUENCY_HZ = np.full((8, 10), np.nan)
for _system, _bands in _BAND_FREQUENCIES_HZ.items():
    for _band, _frequency_hz in _bands.items():
        _FREQUENCY_HZ[_system, _band] = _frequency_hz

_GLONASS_STEP_HZ = np.zeros((8, 10))
_GLONASS_STEP_HZ[c.SYSTEM_GLONASS, 1] = c.FREQUENCY_STEP_GLONASS_L1
_GLONASS_STEP_HZ[c.SYSTEM_GLONASS, 2] = c.FREQUENCY_STEP_GLONASS_L2


def carrier_frequency_hz(
    system: npt.ArrayLike, band: npt.ArrayLike, glonass_channel: npt.ArrayLike = 0
) -> npt.NDArray[np.float64]:
    """Return the carrier frequency of signals.

    Parameters
    ----------
    system : array_like of int, shape (n,)
        ``SYSTEM_*`` of `vtff_gnss.constants`.
    band : array_like of int, shape (n,)
        RINEX 3 frequency digit (RINEX 3.05, tables 4-10).
    glonass_channel : array_like of int, shape (n,)
        GLONASS frequency channel -7..+6, `GLONASS_CHANNEL_UNKNOWN`, or 0 for other systems.

    Returns
    -------
    ndarray of float, shape (n,)
        Hz; NaN for a combination that does not exist and for an FDMA signal of unknown channel.
    """
    system = np.asarray(system, dtype=np.intp)
    band = np.asarray(band, dtype=np.intp)
    step_hz = _GLONASS_STEP_HZ[system, band]
    channel = np.asarray(glonass_channel, dtype=np.float64)
    channel = np.where(channel == c.GLONASS_CHANNEL_UNKNOWN, np.nan, channel)
    offset_hz = np.where(step_hz > 0.0, step_hz * channel, 0.0)
    return np.asarray(_FREQUENCY_HZ[system, band] + offset_hz)


def carrier_wavelength(
    system: npt.ArrayLike, band: npt.ArrayLike, glonass_channel: npt.ArrayLike = 0
) -> npt.NDArray[np.float64]:
    """Return the carrier wavelength of signals in m; see `carrier_frequency_hz`."""
    return SPEED_OF_LIGHT / carrier_frequency_hz(system, band, glonass_channel)


def satellite_name(system: int, prn: int) -> str:
    """Return the RINEX 3 name of a satellite, e.g. ``"G05"``."""
    return f"{c.SYSTEM_LETTERS[system]}{prn:02d}"
