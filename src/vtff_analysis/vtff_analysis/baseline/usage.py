"""Satellites and signals of two recordings that a baseline uses or leaves out, and the reasons."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vtff_gnss.files.navigation_files import NavigationFiles
from vtff_gnss.observation_table import ObservationTable
from vtff_gnss.signals import SYSTEM_FULL_NAMES, satellite_name

__all__ = ["describe_usage"]

_SATELLITES_SHOWN = 6


def describe_usage(
    rover: ObservationTable,
    base: ObservationTable,
    navigation: NavigationFiles,
    bands: Mapping[int, tuple[int, ...]],
) -> tuple[str, ...]:
    """Return a sentence for each satellite system that a receiver has observed.

    Parameters
    ----------
    rover, base : ObservationTable
        Observations of all systems.
    navigation : NavigationFiles
    bands : mapping of int to tuple of int
        RINEX frequency digits that are used of each system.
    """
    observed = [np.unique(table.columns["system"]).tolist() for table in (rover, base)]
    lines = []
    for system in sorted(set(observed[0]) | set(observed[1])):
        name = SYSTEM_FULL_NAMES[system]
        if system not in bands:
            lines.append(f"{name}: not used, it is not among the signals of the filter")
        elif system not in observed[0] or system not in observed[1]:
            lacking = "rover" if system not in observed[0] else "base"
            lines.append(f"{name}: not used, the {lacking} does not observe it")
        elif not navigation.by_system([system]):
            lines.append(f"{name}: not used, no orbits")
        else:
            lines.append(f"{name}: {_describe_system(rover, base, navigation, system, bands)}")
    return tuple(lines)


def _describe_system(
    rover: ObservationTable,
    base: ObservationTable,
    navigation: NavigationFiles,
    system: int,
    bands: Mapping[int, tuple[int, ...]],
) -> str:
    tables = (rover, base)
    satellites = [_satellites(table, system) for table in tables]
    with_orbit = navigation.satellites(system)
    common = satellites[0] & satellites[1]
    texts = [f"{len(common & with_orbit)} satellites"]
    for band in sorted(bands[system]):
        letters = [_attributes(table, system, band) for table in tables]
        if letters[0] and letters[1]:
            same = letters[0] if letters[0] == letters[1] else " with ".join(letters)
            texts.append(f"L{band} ({same})")
        elif letters[0] or letters[1]:
            texts.append(f"not L{band}, which only the {'rover' if letters[0] else 'base'} has")
    if common - with_orbit:
        texts.append(f"without orbit {_names(system, common - with_orbit)}")
    return ", ".join(texts)


def _satellites(table: ObservationTable, system: int) -> set[int]:
    return set(np.unique(table.columns["prn"][table.columns["system"] == system]).tolist())


def _attributes(table: ObservationTable, system: int, band: int) -> str:
    columns = table.columns
    rows = (columns["system"] == system) & (columns["band"] == band)
    return "".join(chr(letter) for letter in np.unique(columns["attribute"][rows]))


def _names(system: int, satellites: set[int]) -> str:
    names = [satellite_name(system, prn) for prn in sorted(satellites)]
    more = f" and {len(names) - _SATELLITES_SHOWN} more" if len(names) > _SATELLITES_SHOWN else ""
    return " ".join(names[:_SATELLITES_SHOWN]) + more
