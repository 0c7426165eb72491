"""What the ionosphere processor was given in a run, read back from its bag second by second."""

from __future__ import annotations

import collections
from collections.abc import Callable, Iterator
from typing import Any

from vtff_bringup.bag.reader import BagReader
from vtff_bringup.topics import ESTIMATE_TOPIC
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.timescales import GpsTime
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_iono.conversions import (
    block_from_messages,
    ephemeris_from_message,
    integers_from_message,
    state_from_fix,
    states_from_relative_state,
)
from vtff_iono.formation_ionosphere import FormationSecond
from vtff_node.stamps import to_nanoseconds

__all__ = ["formation_seconds"]


def formation_seconds(
    reader: BagReader, chief: str = "chief", deputy: str = "deputy"
) -> Iterator[tuple[list[BroadcastEphemeris], FormationSecond]]:
    """Yield the ephemerides that came with each second, and the second.

    Parameters
    ----------
    reader : BagReader
        A bag with <craft>/gnss/high_rate, <craft>/gnss/ephemeris, <craft>/gnss/fix,
        /formation/ambiguities and /formation/relative_state.
    chief, deputy : str
        Names of the spacecraft.

    Raises
    ------
    BagReadError
        If a topic is missing or the bag cannot be read.
    """
    crafts = (chief, deputy)
    observed = [_by_second(reader, f"/{craft}/gnss/high_rate") for craft in crafts]
    fixes = [_single(reader, f"/{craft}/gnss/fix") for craft in crafts]
    integers = _single(reader, "/formation/ambiguities")
    relative = _single(reader, ESTIMATE_TOPIC)
    ephemerides = sorted(
        (
            (item.log_time, number, ephemeris_from_message(item.message))
            for craft in crafts
            for number, item in enumerate(reader.messages(f"/{craft}/gnss/ephemeris"))
        ),
        key=lambda entry: entry[:2],
    )
    for second in sorted(observed[0].keys() | observed[1].keys()):
        stamp = second * NANOSECONDS_PER_SECOND
        new = [entry for entry in ephemerides if entry[0] <= stamp]
        ephemerides = ephemerides[len(new) :]
        states = _converted(states_from_relative_state, relative.get(second))
        if states is None:
            states = tuple(_converted(state_from_fix, part.get(second)) for part in fixes)
        yield (
            [entry[2] for entry in new],
            FormationSecond(
                time=GpsTime.from_unix_nanoseconds(stamp).nanoseconds,
                observations=(
                    block_from_messages(observed[0].get(second, [])),
                    block_from_messages(observed[1].get(second, [])),
                ),
                states_itrf=(states[0], states[1]),
                integers=_converted(integers_from_message, integers.get(second)) or {},
            ),
        )


def _by_second(reader: BagReader, topic: str) -> dict[int, list[Any]]:
    """Return the messages of a topic by the end of the second in which they lie."""
    found: dict[int, list[Any]] = collections.defaultdict(list)
    for item in reader.messages(topic):
        stamp = to_nanoseconds(item.message.header.stamp)
        found[-(-stamp // NANOSECONDS_PER_SECOND)].append(item.message)
    return dict(found)


def _single(reader: BagReader, topic: str) -> dict[int, Any]:
    """Return the messages of a topic whose stamps are whole seconds, by their second."""
    return {
        second: messages[-1]
        for second, messages in _by_second(reader, topic).items()
        if to_nanoseconds(messages[-1].header.stamp) % NANOSECONDS_PER_SECOND == 0
    }


def _converted(convert: Callable[[Any], Any], message: Any) -> Any:
    return None if message is None else convert(message)
