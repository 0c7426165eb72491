"""Identity of satellites and signals, and the carrier frequency of a signal.

A satellite is named by its system and PRN, a signal by satellite, RINEX frequency digit and
tracking attribute. Where arrays are sorted or grouped by these names, one integer stands for
them, and these integers are made and read here only: `satellite_number`, `signal_number` and
their inverses. The numbers sort as the names do: by system, PRN, band, attribute.

A further constellation begins here and in `vtff_gnss.constants` (system, letter, frequencies,
gravitational constant of its broadcast orbits). CONTRIBUTING.md, "A further constellation", lists
the other places.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vtff_dynamics.constants import SPEED_OF_LIGHT
from vtff_gnss import constants as c

__all__ = [
    "SYSTEM_FULL_NAMES",
    "SignalKey",
    "carrier_frequency_hz",
    "carrier_number_of_signal",
    "carrier_wavelength",
    "satellite_from_number",
    "satellite_name",
    "satellite_number",
    "satellite_number_of_signal",
    "signal_from_number",
    "signal_number",
]

_FIELD_BITS = 8
_FIELD_MASK = 255

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
    """Return the RINEX 3 name of a satellite.

    Examples
    --------
    >>> satellite_name(0, 5), satellite_name(3, 11)
    ('G05', 'E11')
    """
    return f"{c.SYSTEM_LETTERS[system]}{prn:02d}"


SYSTEM_FULL_NAMES = ("GPS", "GLONASS", "SBAS", "Galileo", "BeiDou", "QZSS", "NavIC")
"""Names of the systems for people, at the index of their number ``SYSTEM_*``."""


class SignalKey(NamedTuple):
    """A signal of a satellite.

    Attributes
    ----------
    system : int
        ``SYSTEM_*`` of `vtff_gnss.constants`.
    prn : int
        Number of the satellite in its system.
    band : int
        RINEX 3 frequency digit.
    attribute : int
        Character code of the RINEX 3 tracking attribute.
    """

    system: int
    prn: int
    band: int
    attribute: int

    @property
    def satellite(self) -> tuple[int, int]:
        """System and number of the satellite."""
        return self.system, self.prn

    @property
    def group(self) -> tuple[int, int, int]:
        """System, band and attribute: the signals that share one receiver bias."""
        return self.system, self.band, self.attribute

    def __str__(self) -> str:
        """Return for example ``G05 L1C``."""
        return f"{satellite_name(self.system, self.prn)} L{self.band}{chr(self.attribute)}"


def satellite_number(system: npt.ArrayLike, prn: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """Return one integer for each satellite, system first.

    Parameters
    ----------
    system, prn : array_like of int, shape (n,) or scalar
        ``SYSTEM_*`` of `vtff_gnss.constants`, and the number in the system, 0 to 255.
    """
    return np.asarray(
        np.asarray(system, dtype=np.int64) << _FIELD_BITS | np.asarray(prn, dtype=np.int64)
    )


def satellite_from_number(number: int) -> tuple[int, int]:
    """Return system and PRN of one `satellite_number`."""
    return int(number) >> _FIELD_BITS, int(number) & _FIELD_MASK


def signal_number(
    system: npt.ArrayLike, prn: npt.ArrayLike, band: npt.ArrayLike, attribute: npt.ArrayLike
) -> npt.NDArray[np.int64]:
    """Return one integer for each signal: satellite first, then band, then attribute.

    Parameters
    ----------
    system, prn, band, attribute : array_like of int, shape (n,) or scalar
        The fields of `SignalKey`, each 0 to 255.
    """
    carrier = satellite_number(system, prn) << _FIELD_BITS | np.asarray(band, dtype=np.int64)
    return np.asarray(carrier << _FIELD_BITS | np.asarray(attribute, dtype=np.int64))


def satellite_number_of_signal(number: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """Return the `satellite_number` of each `signal_number`."""
    return np.asarray(np.asarray(number, dtype=np.int64) >> 2 * _FIELD_BITS)


def carrier_number_of_signal(number: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """Return one integer for satellite and band of each `signal_number`."""
    return np.asarray(np.asarray(number, dtype=np.int64) >> _FIELD_BITS)


def signal_from_number(number: int) -> SignalKey:
    """Return the fields of one `signal_number`."""
    number = int(number)
    return SignalKey(
        number >> 3 * _FIELD_BITS,
        number >> 2 * _FIELD_BITS & _FIELD_MASK,
        number >> _FIELD_BITS & _FIELD_MASK,
        number & _FIELD_MASK,
    )
