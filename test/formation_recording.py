"""The input of the ionosphere processor in a run, read back from its bag second by second."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from vtff_analysis.recordings.observation_recording import (
    observation_columns,
    observation_table,
)
from vtff_bag.file.cdr_columns import MessageColumns
from vtff_bag.file.reader import BagReader, DecodedMessage, RawMessage
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_iono.conversions import block_from_messages, second_from_messages
from vtff_iono.spacecraft.formation_second import FormationSecond
from vtff_iono.spacecraft.navigation_choice import NavigationChoice
from vtff_iono.spacecraft.spacecraft_ionosphere import ObservationBlock
from vtff_node.conversions.gnss import ephemeris_from_message
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
        /deputy/ambiguities and /deputy/relative_state.
    chief, deputy : str
        Names of the spacecraft.

    Raises
    ------
    BagReadError
        If a topic is missing or the bag cannot be read.
    """
    crafts = (chief, deputy)
    recorded = _FormationBag(reader, crafts)
    observed = [recorded.observations(f"/{craft}/gnss/high_rate") for craft in crafts]
    fixes = [recorded.by_second(f"/{craft}/gnss/fix") for craft in crafts]
    integers = recorded.by_second(f"/{deputy}/ambiguities")
    relative = recorded.by_second(f"/{deputy}/relative_state")
    ephemerides = sorted(
        (
            (item.log_time, number, ephemeris_from_message(item.message))
            for craft in crafts
            for number, item in enumerate(recorded.messages(f"/{craft}/gnss/ephemeris"))
        ),
        key=lambda entry: entry[:2],
    )
    choice = NavigationChoice()
    for second in sorted(observed[0].keys() | observed[1].keys()):
        stamp = second * NANOSECONDS_PER_SECOND
        new = [entry for entry in ephemerides if entry[0] <= stamp]
        ephemerides = ephemerides[len(new) :]
        yield (
            [entry[2] for entry in new],
            second_from_messages(
                GpsTime.from_unix_nanoseconds(stamp),
                (
                    observed[0].get(second) or block_from_messages([]),
                    observed[1].get(second) or block_from_messages([]),
                ),
                [relative.get(second)],
                [integers.get(second)],
                [fixes_of_craft.get(second) for fixes_of_craft in fixes],
                choice,
            ),
        )


class _FormationBag:
    """Messages of a formation in a bag, read in one pass over it."""

    def __init__(self, reader: BagReader, crafts: tuple[str, str]) -> None:
        self._reader = reader
        observations = [f"/{craft}/gnss/high_rate" for craft in crafts]
        self._columns = {topic: observation_columns(reader, topic) for topic in observations}
        single = [f"/{craft}/gnss/{name}" for craft in crafts for name in ("fix", "ephemeris")]
        deputy = crafts[1]
        topics = [*self._columns, *single, f"/{deputy}/ambiguities", f"/{deputy}/relative_state"]
        self._raw: dict[str, list[RawMessage]] = {topic: [] for topic in topics}
        for raw in reader.raw_messages(topics):
            if raw.topic in self._columns:
                self._columns[raw.topic].add(raw.serialized)
            else:
                self._raw[raw.topic].append(raw)

    def messages(self, topic: str) -> Iterator[DecodedMessage]:
        return (self._reader.decoded(raw) for raw in self._raw[topic])

    def by_second(self, topic: str) -> dict[int, Any]:
        """Return the messages of a topic whose stamps are whole seconds, by their second."""
        messages = {}
        for item in self.messages(topic):
            second, rest = divmod(to_nanoseconds(item.message.header.stamp), NANOSECONDS_PER_SECOND)
            if rest == 0:
                messages[second] = item.message
        return messages

    def observations(self, topic: str) -> dict[int, ObservationBlock]:
        """Return the epochs of a topic by the end of the second in which their stamps lie."""
        columns = self._columns.pop(topic).columns()
        table = observation_table(columns)
        second = -(-_stamps_nanoseconds(columns) // NANOSECONDS_PER_SECOND)
        if (np.diff(second) < 0).any():
            order = np.argsort(second, kind="stable")
            second, table = second[order], table.epochs_at(order)
        time = np.repeat(table.time_nanoseconds, np.diff(table.first_row))
        first = np.flatnonzero(np.diff(second, prepend=second[:1] - 1))
        edges = table.first_row[np.append(first, len(second))].tolist()
        return {
            number: ObservationBlock(
                time[start:end], {name: column[start:end] for name, column in table.columns.items()}
            )
            for number, start, end in zip(
                second[first].tolist(), edges[:-1], edges[1:], strict=True
            )
        }


def _stamps_nanoseconds(columns: MessageColumns) -> npt.NDArray[np.int64]:
    """Return the stamps of messages with a header, ns since 1970, shape (m,)."""
    seconds = columns.numbers["header.stamp.sec"].astype(np.int64)
    nanoseconds = columns.numbers["header.stamp.nanosec"].astype(np.int64)
    return np.asarray(seconds * NANOSECONDS_PER_SECOND + nanoseconds)
