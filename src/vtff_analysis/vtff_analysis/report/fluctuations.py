"""Lag between the fluctuations of C/N0 that two spacecraft see, from the 20 Hz topics of a bag."""

from __future__ import annotations

import numpy as np

from vtff_bag.file.errors import BagError
from vtff_bag.file.reader import BagReader
from vtff_dynamics.vectors import FloatArray
from vtff_iono.scintillation.fluctuation_lag import FluctuationLag, fluctuation_lag

__all__ = ["read_fluctuation_lag"]

_TOPIC = "/{}/gnss/high_rate"
_LONGEST = 300 * 1_000_000_000  # ns
_BAND = 1
_FEWEST_SAMPLES = 200


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
        Scintillation, ns since 1970; of more than 300 s the middle is taken.

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
        powers = [_powers(reader, topic, start, end) for topic in topics]
    except BagError:
        return None
    times = sorted(powers[0].keys() & powers[1].keys())
    if len(times) < _FEWEST_SAMPLES:
        return None
    first, second = (_complete_rows(of_craft, times) for of_craft in powers)
    common = sorted(first.keys() & second.keys())
    if not common:
        return None
    rate_hz = 1e9 / float(np.median(np.diff(np.array(times))))
    return fluctuation_lag(
        np.array([first[prn] for prn in common]), np.array([second[prn] for prn in common]), rate_hz
    )


def _powers(
    reader: BagReader, topic: str, start: int, end: int
) -> dict[int, dict[tuple[int, int], float]]:
    """Return linear C/N0 of L1 by time (ns) and satellite."""
    from rclpy.serialization import deserialize_message

    from vtff_bag.file.message_definitions import message_class

    kind = message_class(reader.topics[topic].type)
    found = {}
    for raw in reader.raw_messages([topic], start, end):
        message = deserialize_message(raw.serialized, kind)
        stamp = message.header.stamp
        rows = zip(message.system, message.prn, message.band, message.cn0_dbhz, strict=True)
        found[int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)] = {
            (system, prn): 10.0 ** (0.1 * cn0) for system, prn, band, cn0 in rows if band == _BAND
        }
    return found


def _complete_rows(
    powers: dict[int, dict[tuple[int, int], float]], times: list[int]
) -> dict[tuple[int, int], FloatArray]:
    """Return the series of the satellites that are there at every time."""
    always = set.intersection(*(set(powers[time]) for time in times))
    return {prn: np.array([powers[time][prn] for time in times]) for prn in always}
