"""Signals by name, as users give them: ``G1`` is L1 of GPS, ``E5`` is E5a of Galileo."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from vtff_gnss import constants as c
from vtff_gnss.signals import carrier_frequency_hz

__all__ = ["bands_of"]

_SYSTEMS = {"G": c.SYSTEM_GPS, "E": c.SYSTEM_GALILEO}


def bands_of(names: Iterable[str]) -> dict[int, tuple[int, ...]]:
    """Return the RINEX frequency digits of each system.

    Parameters
    ----------
    names : iterable of str
        System letter and RINEX frequency digit, e.g. ``["G1", "G2", "G5", "E1", "E5", "E7"]``.

    Raises
    ------
    ValueError
        If a name is not one of a known carrier, or none is given.
    """
    bands: dict[int, tuple[int, ...]] = {}
    for name in names:
        system = _SYSTEMS.get(name[:1].upper())
        digit = name[1:]
        if system is None or len(digit) != 1 or not digit.isdecimal():
            raise ValueError(f"signal {name!r}: G or E and a RINEX frequency digit expected, as G1")
        if not np.isfinite(carrier_frequency_hz(system, int(digit))):
            raise ValueError(f"signal {name!r}: there is no such carrier")
        bands[system] = (*bands.get(system, ()), int(digit))
    if not bands:
        raise ValueError("signals: at least one expected, as G1")
    return {system: tuple(sorted(set(digits))) for system, digits in bands.items()}
