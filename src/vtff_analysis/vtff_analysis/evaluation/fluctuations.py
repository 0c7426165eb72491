"""Lag between the fluctuations of C/N0 that two spacecraft see, from the 20 Hz topics of a bag."""

from __future__ import annotations

import numpy as np
from rclpy.serialization import deserialize_message

from vtff_bag.file.errors import BagError
from vtff_bag.file.message_definitions import message_class
from vtff_bag.file.reader import BagReader
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.vectors import FloatArray
from vtff_iono.scintillation.fluctuation_lag import FluctuationLag, fluctuation_lag
from vtff_node.stamps import to_nanoseconds

__all__ = ["read_fluctuation_lag"]

_TOPIC = "/{}/gnss/high_rate"
_LONGEST = 300 * NANOSECONDS_PER_SECOND
_BAND = 1
_FEWEST_SAMPLES = 200

Satellite = tuple[int, int]
"""System and PRN."""


def read_fluctuation_lag(
    reader: BagReader, crafts: tuple[str, str], start: int, end: int
) -> FluctuationLag | None:
    """Return by how much the second spacecraft sees the fluctuations later.

    Parameters
    ----------
    reader
        The bag, with <craft>/gnss/high_rate.
    crafts
        Names of the two spacecraft.
    start, end
        First and last time of the scintillation, ns since 1970. Where they are more than 300 s
        apart, the middle 300 s are used.

    Returns
    -------
    FluctuationLag or None
        None without observations of both at common times.
    """
    topics = [_TOPIC.format(craft) for craft in crafts]
    if any(topic not in reader.topics for topic in topics):
        return None
    middle = (start + end) // 2
    start, end = max(start, middle - _LONGEST // 2), min(end, middle + _LONGEST // 2)
    try:
        powers = [_read_powers(reader, topic, start, end) for topic in topics]
    except BagError:
        return None
    times = sorted(powers[0].keys() & powers[1].keys())
    if len(times) < _FEWEST_SAMPLES:
        return None
    first, second = (_complete_series(powers_of_craft, times) for powers_of_craft in powers)
    common = sorted(first.keys() & second.keys())
    if not common:
        return None
    rate_hz = 1e9 / float(np.median(np.diff(np.array(times))))
    return fluctuation_lag(
        np.array([first[satellite] for satellite in common]),
        np.array([second[satellite] for satellite in common]),
        rate_hz,
    )


def _read_powers(
    reader: BagReader, topic: str, start: int, end: int
) -> dict[int, dict[Satellite, float]]:
    """Return linear C/N0 of L1 by time (ns since 1970) and satellite."""
    message_type = message_class(reader.topics[topic].type)
    powers = {}
    for raw in reader.raw_messages([topic], start, end):
        message = deserialize_message(raw.serialized, message_type)
        rows = zip(message.system, message.prn, message.band, message.cn0_dbhz, strict=True)
        powers[to_nanoseconds(message.header.stamp)] = {
            (system, prn): 10.0 ** (0.1 * cn0) for system, prn, band, cn0 in rows if band == _BAND
        }
    return powers


def _complete_series(
    powers: dict[int, dict[Satellite, float]], times: list[int]
) -> dict[Satellite, FloatArray]:
    """Return the series of the satellites that were observed at every time."""
    always = set.intersection(*(set(powers[time]) for time in times))
    return {
        satellite: np.array([powers[time][satellite] for time in times]) for satellite in always
    }
