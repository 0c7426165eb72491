"""Signals that simulated receivers track, and the group delays with which satellites send them."""

from __future__ import annotations

from typing import NamedTuple

from vtff_gnss import constants as c
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_gnss.signals import carrier_frequency_hz

__all__ = ["SIGNALS", "Signal", "clock_group_delay", "satellite_from_name"]


class Signal(NamedTuple):
    """One signal.

    Attributes
    ----------
    name : str
        System letter and RINEX 3 code, e.g. ``"G1C"``.
    system, band, attribute : int
        As in `ObservationEpoch`.
    frequency : float
        Carrier, Hz.
    chip_rate : float
        Chip rate of the ranging code, Hz (for the code noise).
    has_data : bool
        Carrier with data bits (or their unknown sign): phase is known to half a cycle until the
        parity of the message is.
    """

    name: str
    system: int
    band: int
    attribute: int
    frequency: float
    chip_rate: float
    has_data: bool


def _signal(name: str, chip_rate: float, has_data: bool = False) -> Signal:
    system = c.SYSTEM_LETTERS.index(name[0])
    band = int(name[1])
    frequency = float(carrier_frequency_hz([system], [band])[0])
    return Signal(name, system, band, ord(name[2]), frequency, chip_rate, has_data)


SIGNALS: dict[str, Signal] = {
    signal.name: signal
    for signal in (
        _signal("G1C", 1.023e6, has_data=True),
        _signal("G2W", 10.23e6, has_data=True),
        _signal("G2S", 1.023e6),
        _signal("G5Q", 10.23e6),
        _signal("E1C", 1.023e6),
        _signal("E5Q", 10.23e6),
        _signal("E7Q", 10.23e6),
    )
}
"""All signals by name: GPS L1 C/A, L2P(Y), L2C, L5 and Galileo E1, E5a, E5b."""


def clock_group_delay(signal: Signal, ephemeris: BroadcastEphemeris) -> float:
    """Return by how much a signal leaves later than the broadcast clock tells, s.

    The pseudorange is longer by it. With gamma = (f1 / f)^2: GPS L1 C/A TGD and L2P(Y) gamma TGD
    (IS-GPS-200, 20.3.3.3.3.2), so that their ionosphere-free pair has none; L2C as L2P(Y) and L5
    gamma TGD, that is inter-signal corrections that are zero beyond those of the P(Y) pair; Galileo
    with the I/NAV clock (E1/E5b): E1 BGD(E1,E5b), E5b gamma BGD(E1,E5b), and E5a BGD(E1,E5b) +
    (gamma - 1) BGD(E1,E5a) (Galileo OS SIS ICD, 5.1.5).
    """
    gamma = (c.FREQUENCY_L1 / signal.frequency) ** 2
    if signal.system == c.SYSTEM_GPS:
        return gamma * ephemeris.group_delay
    if signal.band == 5:
        return ephemeris.group_delay_secondary + (gamma - 1.0) * ephemeris.group_delay
    return gamma * ephemeris.group_delay_secondary


def satellite_from_name(name: str) -> tuple[int, int]:
    """Return system and number of a satellite such as ``"G05"``.

    Raises
    ------
    ValueError
        If it is not the name of a GPS or Galileo satellite.
    """
    if len(name) == 3 and name[0] in "GE" and name[1:].isdecimal() and int(name[1:]) > 0:
        return c.SYSTEM_LETTERS.index(name[0]), int(name[1:])
    raise ValueError(f"satellite: a name such as G05 or E12 expected, got {name!r}")
