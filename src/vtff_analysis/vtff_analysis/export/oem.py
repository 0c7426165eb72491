"""CCSDS Orbit Ephemeris Message 2.0 in keyword notation (CCSDS 502.0-B-3)."""

from __future__ import annotations

from vtff_analysis.recordings.orbits import Orbit
from vtff_dynamics.time.timescales import GpsTime

ORIGINATOR = "VTFF"


def format_oem(orbit: Orbit, created: GpsTime | None = None) -> str:
    """Return the text of an OEM; the standard allows one object in each.

    States are in GCRF, in km and km/s to 1 micrometre and 1 nm/s; epochs are in UTC.

    Parameters
    ----------
    orbit
        Orbit of one spacecraft.
    created
        Date of creation in the header; the first epoch if it is not given, so that equal bags
        give equal files.
    """
    name = orbit.name.upper()
    lines = [
        "CCSDS_OEM_VERS = 2.0",
        f"CREATION_DATE = {_epoch(created or orbit.time[0])}",
        f"ORIGINATOR = {ORIGINATOR}",
        "",
        "META_START",
        f"OBJECT_NAME = {name}",
        f"OBJECT_ID = {name}",
        "CENTER_NAME = EARTH",
        "REF_FRAME = GCRF",
        "TIME_SYSTEM = UTC",
        f"START_TIME = {_epoch(orbit.time[0])}",
        f"STOP_TIME = {_epoch(orbit.time[-1])}",
        "INTERPOLATION = LAGRANGE",
        "INTERPOLATION_DEGREE = 7",
        "META_STOP",
        f"COMMENT source: {orbit.source}",
    ]
    for time, state in zip(orbit.time, orbit.state_gcrf, strict=True):
        position = " ".join(f"{value * 1e-3:.9f}" for value in state[:3])
        velocity = " ".join(f"{value * 1e-3:.12f}" for value in state[3:])
        lines.append(f"{_epoch(time)} {position} {velocity}")
    return "\n".join(lines) + "\n"


def _epoch(time: GpsTime) -> str:
    return time.isoformat("UTC").removesuffix(" UTC")
