"""CZML for Cesium and STK: spacecraft on their orbits, in inertial axes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from vtff_analysis.recordings.orbits import Orbit
from vtff_dynamics.time.timescales import GpsTime

# Okabe-Ito colours, as red, green, blue, opacity.
_COLOURS = (
    [0, 114, 178, 255],
    [213, 94, 0, 255],
    [0, 158, 115, 255],
    [204, 121, 167, 255],
    [86, 180, 233, 255],
    [240, 228, 66, 255],
)
_TRAIL = 6000.0  # s of orbit drawn behind and ahead: about one revolution
_MULTIPLIER = 60.0  # scenario seconds per second when the file is opened


def format_czml(orbits: Sequence[Orbit], name: str) -> str:
    """Return a CZML document.

    Parameters
    ----------
    orbits
        At least one orbit.
    name
        Name of the document.

    Notes
    -----
    Positions are in GCRF, which CZML calls ``INERTIAL`` (ICRF axes), and interpolated by Lagrange
    polynomials of degree 5.
    """
    first = min(orbit.time[0] for orbit in orbits)
    last = max(orbit.time[-1] for orbit in orbits)
    interval = f"{_epoch(first)}/{_epoch(last)}"
    packets: list[dict[str, Any]] = [
        {
            "id": "document",
            "name": name,
            "version": "1.0",
            "clock": {
                "interval": interval,
                "currentTime": _epoch(first),
                "multiplier": _MULTIPLIER,
                "range": "LOOP_STOP",
                "step": "SYSTEM_CLOCK_MULTIPLIER",
            },
        }
    ]
    for number, orbit in enumerate(orbits):
        packets.append(_packet(orbit, interval, _COLOURS[number % len(_COLOURS)]))
    return json.dumps(packets, ensure_ascii=False) + "\n"


def _packet(orbit: Orbit, interval: str, colour: list[int]) -> dict[str, Any]:
    start = orbit.time[0]
    samples: list[float] = []
    for time, state in zip(orbit.time, orbit.state_gcrf, strict=True):
        samples += [round(time - start, 9), *(round(float(value), 4) for value in state[:3])]
    return {
        "id": orbit.name,
        "name": orbit.name,
        "description": f"source: {orbit.source}",
        "availability": interval,
        "position": {
            "epoch": _epoch(start),
            "referenceFrame": "INERTIAL",
            "interpolationAlgorithm": "LAGRANGE",
            "interpolationDegree": 5,
            "cartesian": samples,
        },
        "point": {
            "pixelSize": 9,
            "color": {"rgba": colour},
            "outlineColor": {"rgba": [255, 255, 255, 255]},
            "outlineWidth": 1,
        },
        "label": {
            "text": orbit.name,
            "font": "13px sans-serif",
            "fillColor": {"rgba": colour},
            "pixelOffset": {"cartesian2": [12, -12]},
        },
        "path": {
            "leadTime": _TRAIL,
            "trailTime": _TRAIL,
            "resolution": 60,
            "width": 1.5,
            "material": {"solidColor": {"color": {"rgba": colour}}},
        },
    }


def _epoch(time: GpsTime) -> str:
    return time.isoformat("UTC").removesuffix(" UTC") + "Z"
