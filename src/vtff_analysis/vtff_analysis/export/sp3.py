"""Precise orbits in the format SP3-d (Hilla, The Extended Standard Product 3 Orbit Format)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vtff_analysis.recordings.errors import RecordingError
from vtff_analysis.recordings.orbits import Orbit
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND, SECONDS_PER_DAY
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.rinex.write.header import time_fields

_CLOCK_UNKNOWN = 999999.999999
_MODIFIED_JULIAN_DATE_OF_GPS_EPOCH = 44244
_DAY = SECONDS_PER_DAY * NANOSECONDS_PER_SECOND
_WIDTH_OF_LIST = 17
_LINES_OF_LIST = 5
_MOST_CRAFT = 85


def format_sp3(orbits: Sequence[Orbit]) -> str:
    """Return the text of an SP3 file with positions and velocities in ITRF, GPS time.

    Spacecraft are L01, L02, ... in the given order, as the format names low orbiters; comment
    lines give the name of each. Positions have 1 mm, velocities 0.1 micrometre/s. An epoch holds
    the spacecraft that have a state at it.

    Parameters
    ----------
    orbits
        At least one orbit, at most 85.

    Raises
    ------
    RecordingError
        If there are more spacecraft than the header can list.
    """
    if len(orbits) > _MOST_CRAFT:
        raise RecordingError(f"{len(orbits)} spacecraft: an SP3 header lists at most {_MOST_CRAFT}")
    epochs = sorted({time for orbit in orbits for time in orbit.time})
    rows = [dict(zip(orbit.time, orbit.state_itrf, strict=True)) for orbit in orbits]
    lines = _header(epochs, orbits)
    for epoch in epochs:
        lines.append(f"*  {_date(epoch)}")
        for number, states in enumerate(rows, 1):
            if epoch not in states:
                continue
            state = states[epoch]
            position = "".join(f"{value * 1e-3:14.6f}" for value in state[:3])
            velocity = "".join(f"{value * 10.0:14.6f}" for value in state[3:])
            lines.append(f"PL{number:02d}{position}{_CLOCK_UNKNOWN:14.6f}")
            lines.append(f"VL{number:02d}{velocity}{_CLOCK_UNKNOWN:14.6f}")
    lines.append("EOF")
    return "\n".join(lines) + "\n"


def _header(epochs: Sequence[GpsTime], orbits: Sequence[Orbit]) -> list[str]:
    first = epochs[0]
    step = float(np.median(np.diff([e.nanoseconds for e in epochs]))) * 1e-9 if epochs[1:] else 0.0
    days, rest = divmod(first.nanoseconds, _DAY)
    names = [f"L{number:02d}" for number in range(1, len(orbits) + 1)]
    names += ["  0"] * (_WIDTH_OF_LIST * _LINES_OF_LIST - len(names))
    lists = [
        "".join(names[start : start + _WIDTH_OF_LIST])
        for start in range(0, len(names), _WIDTH_OF_LIST)
    ]
    accuracies = "  0" * _WIDTH_OF_LIST
    return [
        f"#dV{_date(first)} {len(epochs):7d} ORBIT ITRF  FIT VTFF",
        f"## {first.week:4d} {first.time_of_week:15.8f} {step:14.8f} "
        f"{_MODIFIED_JULIAN_DATE_OF_GPS_EPOCH + days:5d} {rest / _DAY:15.13f}",
        *(f"+  {len(orbits) if line == 0 else '':>3}   {text}" for line, text in enumerate(lists)),
        *(f"++       {accuracies}" for _ in lists),
        "%c L  cc GPS ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc",
        "%c cc cc ccc ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc",
        "%f  0.0000000  0.000000000  0.00000000000  0.000000000000000",
        "%f  0.0000000  0.000000000  0.00000000000  0.000000000000000",
        "%i    0    0    0    0      0      0      0      0         0",
        "%i    0    0    0    0      0      0      0      0         0",
        *(
            f"/* L{number:02d} is {orbit.name}, source: {orbit.source}"
            for number, orbit in enumerate(orbits, 1)
        ),
    ]


def _date(time: GpsTime) -> str:
    year, month, day, hour, minute, second = time_fields(time)
    return f"{year:4d} {month:2d} {day:2d} {hour:2d} {minute:2d} {second:11.8f}"
