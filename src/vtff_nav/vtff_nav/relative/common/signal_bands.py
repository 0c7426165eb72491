"""Carriers by the names that users give: ``G1`` is L1 of GPS, ``E5`` is E5a of Galileo."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from vtff_gnss import constants as c
from vtff_gnss.signals import carrier_frequency_hz

__all__ = ["parse_bands"]

_SYSTEMS = {"G": c.SYSTEM_GPS, "E": c.SYSTEM_GALILEO}


def parse_bands(names: Iterable[str]) -> dict[int, tuple[int, ...]]:
    """Return the RINEX frequency digits of each system named.

    Parameters
    ----------
    names : iterable of str
        System letters, each with a RINEX frequency digit, e.g. ``["G1", "G2", "E1", "E5"]``.

    Returns
    -------
    dict of int to tuple of int
        Frequency digits in rising order, by ``SYSTEM_*``.

    Raises
    ------
    ValueError
        If a name is not that of a carrier, or there is no name.
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
