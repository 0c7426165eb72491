"""The input of the ionosphere processor in a run, read back from its bag second by second."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt

from vtff_analysis.recordings.observation_recording import (
    observation_columns,
    observation_table,
)
from vtff_bag.file.cdr_columns import ColumnCollector, MessageColumns
from vtff_bag.file.message_batches import message_batches
from vtff_bag.file.reader import BagReader, DecodedMessage, RawMessage
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_iono.conversions import second_from_messages
from vtff_iono.spacecraft.formation_second import FormationSecond
from vtff_iono.spacecraft.navigation_choice import NavigationChoice
from vtff_iono.spacecraft.spacecraft_ionosphere import ObservationBlock
from vtff_node.conversions.gnss import ephemeris_from_message

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
            for number, item in enumerate(recorded.ephemerides(f"/{craft}/gnss/ephemeris"))
        ),
        key=lambda entry: entry[:2],
    )
    choice = NavigationChoice()
    for second in sorted(observed[0].rows.keys() | observed[1].rows.keys()):
        stamp = second * NANOSECONDS_PER_SECOND
        new = [entry for entry in ephemerides if entry[0] <= stamp]
        ephemerides = ephemerides[len(new) :]
        yield (
            [entry[2] for entry in new],
            second_from_messages(
                GpsTime.from_unix_nanoseconds(stamp),
                (observed[0].at(second), observed[1].at(second)),
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
        types = {f"/{craft}/gnss/fix": "GnssFix" for craft in crafts}
        types[f"/{crafts[1]}/ambiguities"] = "AmbiguityStatus"
        types[f"/{crafts[1]}/relative_state"] = "RelativeState"
        for topic, name in types.items():
            source = f"{reader.path}: topic '{topic}'"
            self._columns[topic] = ColumnCollector(f"vtff_msgs/msg/{name}", source)
        ephemerides = [f"/{craft}/gnss/ephemeris" for craft in crafts]
        self._ephemerides: dict[str, list[RawMessage]] = {topic: [] for topic in ephemerides}
        topics = [*self._columns, *self._ephemerides]
        for batch in message_batches(reader, topics):
            for number, topic in enumerate(topics):
                of_topic = batch.rows(np.flatnonzero(batch.topic == number))
                collector = self._columns.get(topic)
                if collector is None:
                    type_name = reader.topics[topic].type
                    self._ephemerides[topic] += of_topic.raw_messages(topic, type_name)
                else:
                    collector.add_batch(of_topic)

    def ephemerides(self, topic: str) -> Iterator[DecodedMessage]:
        """Return the messages of a topic."""
        return (self._reader.decoded(raw) for raw in self._ephemerides[topic])

    def by_second(self, topic: str) -> dict[int, _RecordedMessage]:
        """Return the messages of a topic whose stamps are whole seconds, by their second."""
        columns = self._columns.pop(topic).columns()
        ranges = {
            name: list(itertools.pairwise([0, *np.cumsum(lengths).tolist()]))
            for name, lengths in columns.lengths.items()
        }
        stamps = _stamps_nanoseconds(columns)
        whole = np.flatnonzero(stamps % NANOSECONDS_PER_SECOND == 0)
        seconds = stamps[whole] // NANOSECONDS_PER_SECOND
        return {
            second: _RecordedMessage(columns, ranges, second, row)
            for second, row in zip(seconds.tolist(), whole.tolist(), strict=True)
        }

    def observations(self, topic: str) -> _Observations:
        """Return the epochs of a topic."""
        return _Observations(self._columns.pop(topic).columns())


class _RecordedMessage:
    """A message without text fields, whose fields are read from columns when they are asked for.

    To read all messages as columns takes a fifth of the time of reading one by one.
    """

    def __init__(
        self,
        columns: MessageColumns,
        ranges: dict[str, list[tuple[int, int]]],
        second: int,
        row: int,
    ) -> None:
        self._columns, self._ranges, self._row = columns, ranges, row
        self._second = second

    @property
    def header(self) -> SimpleNamespace:
        """Header with the stamp."""
        return SimpleNamespace(stamp=SimpleNamespace(sec=self._second, nanosec=0))

    def __getattr__(self, name: str) -> Any:
        """Return a number, or an array of numbers."""
        columns, row = self._columns, self._row
        if name in columns.numbers:
            return columns.numbers[name][row]
        if name not in columns.sequences:
            raise AttributeError(name)
        begin, end = self._ranges[name][row]
        return columns.sequences[name][begin:end]


class _Observations:
    """Epochs of a topic by the end of the second in which their stamps lie."""

    def __init__(self, columns: MessageColumns) -> None:
        table = observation_table(columns)
        second = -(-_stamps_nanoseconds(columns) // NANOSECONDS_PER_SECOND)
        if (np.diff(second) < 0).any():
            order = np.argsort(second, kind="stable")
            second, table = second[order], table.epochs_at(order)
        self._columns = table.columns
        self._time = np.repeat(table.time_nanoseconds, np.diff(table.first_row))
        first = np.flatnonzero(np.diff(second, prepend=second[:1] - 1))
        edges = table.first_row[np.append(first, len(second))].tolist()
        ranges = zip(edges[:-1], edges[1:], strict=True)
        # First row of each second, and the row after its last one.
        self.rows = dict(zip(second[first].tolist(), ranges, strict=True))

    def at(self, second: int) -> ObservationBlock:
        """Return the observations of a second."""
        start, end = self.rows.get(second, (0, 0))
        columns = {name: column[start:end] for name, column in self._columns.items()}
        return ObservationBlock(self._time[start:end], columns)


def _stamps_nanoseconds(columns: MessageColumns) -> npt.NDArray[np.int64]:
    """Return the stamps of messages with a header, ns since 1970, shape (m,)."""
    seconds = columns.numbers["header.stamp.sec"].astype(np.int64)
    nanoseconds = columns.numbers["header.stamp.nanosec"].astype(np.int64)
    return np.asarray(seconds * NANOSECONDS_PER_SECOND + nanoseconds)
