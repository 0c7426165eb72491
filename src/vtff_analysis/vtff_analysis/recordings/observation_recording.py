"""Observations of a receiver in a bag as one table."""

from __future__ import annotations

import numpy as np

from vtff_bag.file.cdr_columns import ColumnCollector, MessageColumns
from vtff_bag.file.errors import BagReadError
from vtff_bag.file.message_batches import message_batches
from vtff_bag.file.reader import BagReader
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND, SECONDS_PER_WEEK
from vtff_gnss.observation_table import ObservationTable
from vtff_gnss.observations import OBSERVATION_COLUMNS

__all__ = ["observation_columns", "observation_table", "recorded_observations"]

_OBSERVATIONS_TYPE = "vtff_msgs/msg/GnssObservations"


def recorded_observations(reader: BagReader, topic: str) -> ObservationTable:
    """Return the epochs of a topic of GnssObservations; epochs that go back in time are left out.

    Raises
    ------
    BagReadError
        If the bag has no such topic, or a message is not what its type says.
    """
    collector = observation_columns(reader, topic)
    for batch in message_batches(reader, [topic]):
        collector.add_batch(batch)
    table = observation_table(collector.columns())
    time = table.time_nanoseconds
    is_newer = np.ones(len(table), dtype=np.bool_)
    is_newer[1:] = time[1:] > np.maximum.accumulate(time)[:-1]
    return table if is_newer.all() else table.epochs_at(np.flatnonzero(is_newer))


def observation_columns(reader: BagReader, topic: str) -> ColumnCollector:
    """Return an empty collector for the messages of a topic of GnssObservations."""
    return ColumnCollector(_OBSERVATIONS_TYPE, f"{reader.path}: topic '{topic}'")


def observation_table(columns: MessageColumns) -> ObservationTable:
    """Return messages of type GnssObservations as a table, in their order.

    This is `vtff_node.conversions.gnss.observations_from_message` for a whole recording at once:
    an hour of high-rate observations takes seconds instead of minutes. The time is that of week
    and second of week: a stamp repeats itself in a leap second.

    Raises
    ------
    BagReadError
        If the arrays of a message are not all of one length.
    """
    counts = columns.lengths["prn"]
    for name in OBSERVATION_COLUMNS:
        differs = np.flatnonzero(columns.lengths[name] != counts)
        if len(differs):
            raise BagReadError(
                f"{columns.source}: observation column '{name}' of message {differs[0]} has "
                f"{columns.lengths[name][differs[0]]} elements, 'prn' has {counts[differs[0]]}"
            )
    week, time_of_week = columns.numbers["gps_week"], columns.numbers["gps_time_of_week"]
    whole = np.floor(time_of_week)
    seconds = week.astype(np.int64) * SECONDS_PER_WEEK + whole.astype(np.int64)
    fraction = np.rint((time_of_week - whole) * NANOSECONDS_PER_SECOND).astype(np.int64)
    return ObservationTable(
        time_nanoseconds=seconds * NANOSECONDS_PER_SECOND + fraction,
        first_row=np.concatenate([[0], np.cumsum(counts)]).astype(np.intp),
        columns={name: columns.sequences[name] for name in OBSERVATION_COLUMNS},
        receiver_clock_offset=np.full(columns.count, np.nan),
        time_status=columns.numbers["time_status"],
        receiver_status=columns.numbers["receiver_status"],
        log_name="",
    )
