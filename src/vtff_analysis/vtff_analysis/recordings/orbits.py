"""Orbits of the spacecraft in a bag, in GCRF and ITRF."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from vtff_analysis.recordings.errors import RecordingError
from vtff_bag.file.reader import BagReader
from vtff_dynamics.frames.earth import state_gcrf_to_itrf, state_itrf_to_gcrf
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_gnss.fix import STATUS_NONE
from vtff_node.stamps import to_nanoseconds

_ORBIT_TOPIC = re.compile(r"^/(?P<craft>.+)/truth/orbit$")
_FIX_TOPIC = re.compile(r"^/(?P<craft>.+)/gnss/fix$")
_EARTH_FRAME = "earth"


@dataclass(frozen=True, eq=False)
class Orbit:
    """Orbit of one spacecraft.

    Attributes
    ----------
    name
        Name of the spacecraft.
    source
        ``truth`` or ``receiver``.
    time
        GPS times, increasing.
    state_gcrf, state_itrf
        Position (m) and velocity (m/s; in ITRF relative to the rotating Earth), shape (n, 6).
    """

    name: str
    source: str
    time: tuple[GpsTime, ...]
    state_gcrf: FloatArray
    state_itrf: FloatArray


def read_orbits(reader: BagReader, interval: float | None = None) -> list[Orbit]:
    """Return the orbits of all spacecraft, in alphabetical order.

    Parameters
    ----------
    reader
        The bag.
    interval
        Shortest time between the states to keep, s; all states are kept if it is not given.

    Returns
    -------
    list of Orbit
        True orbits where they are recorded, else the receivers' own solutions.

    Raises
    ------
    RecordingError
        If the bag has no orbit.
    """
    topics: dict[str, tuple[str, str]] = {}
    for pattern, source in ((_FIX_TOPIC, "receiver"), (_ORBIT_TOPIC, "truth")):
        for topic in reader.topics.values():
            match = pattern.match(topic.name)
            if match is not None and topic.message_count:
                topics[match["craft"]] = (source, topic.name)
    orbits = []
    for craft, (source, topic_name) in sorted(topics.items()):
        orbit = _read_orbit(reader, craft, source, topic_name, interval)
        if orbit is not None:
            orbits.append(orbit)
    if not orbits:
        raise RecordingError(f"{reader.path}: no orbits (<craft>/truth/orbit or <craft>/gnss/fix)")
    return orbits


def _read_orbit(
    reader: BagReader, craft: str, source: str, topic: str, interval: float | None
) -> Orbit | None:
    states: dict[GpsTime, tuple[bool, Any]] = {}
    newest: GpsTime | None = None
    for decoded in reader.messages(topic):
        message = decoded.message
        if source == "receiver" and message.status == STATUS_NONE:
            continue
        time = GpsTime.from_unix_nanoseconds(to_nanoseconds(message.header.stamp))
        state = np.concatenate((message.position, message.velocity))
        too_near = newest is not None and interval is not None and time - newest < interval - 1e-6
        if too_near or not np.isfinite(state).all():
            continue
        earth_fixed = source == "receiver" or message.header.frame_id == _EARTH_FRAME
        states[time] = (earth_fixed, state)
        newest = time
    if not states:
        return None
    times = tuple(sorted(states))
    gcrf, itrf = np.empty((len(times), 6)), np.empty((len(times), 6))
    for row, time in enumerate(times):
        earth_fixed, state = states[time]
        gcrf[row] = state_itrf_to_gcrf(time, state) if earth_fixed else state
        itrf[row] = state if earth_fixed else state_gcrf_to_itrf(time, state)
    return Orbit(craft, source, times, gcrf, itrf)
