"""Observations and ephemerides of a bag as RINEX 3.05 files, one pair for each receiver."""

from __future__ import annotations

import pathlib
import re

from vtff_analysis.recordings.errors import RecordingError
from vtff_analysis.recordings.recording import UNNAMED_RECEIVER
from vtff_bag.file.reader import BagReader
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.rinex.write.navigation import write_rinex_navigation
from vtff_gnss.rinex.write.observation import write_rinex_observation
from vtff_node.conversions.gnss import ephemeris_from_message, observations_from_message

_OBSERVATIONS = re.compile(r"^(?:/(?P<receiver>.+))?/gnss/(?P<what>epoch|high_rate)$")
_OBSERVATIONS_TYPE = "vtff_msgs/msg/GnssObservations"
_LONGEST_MARKER = 60


def export_rinex(
    reader: BagReader, folder: pathlib.Path, *, high_rate: bool = False
) -> list[pathlib.Path]:
    """Write ``<receiver>.rnx`` and ``<receiver>_nav.rnx`` of every receiver.

    Parameters
    ----------
    reader
        The bag.
    folder
        Folder of the files; must exist.
    high_rate
        Whether observations come from gnss/high_rate instead of gnss/epoch.

    Returns
    -------
    list of pathlib.Path
        The files.

    Raises
    ------
    RecordingError
        If the bag has no such observations.
    """
    wanted = "high_rate" if high_rate else "epoch"
    files = []
    for topic in sorted(reader.topics.values(), key=lambda topic: topic.name):
        match = _OBSERVATIONS.match(topic.name)
        if match is None or match["what"] != wanted or topic.type != _OBSERVATIONS_TYPE:
            continue
        if topic.message_count:
            name = match["receiver"] or UNNAMED_RECEIVER
            files += _export_receiver(reader, topic.name, name, folder)
    if not files:
        raise RecordingError(f"{reader.path}: no observations on any gnss/{wanted}")
    return files


def _export_receiver(
    reader: BagReader, topic: str, name: str, folder: pathlib.Path
) -> list[pathlib.Path]:
    epochs = [observations_from_message(decoded.message) for decoded in reader.messages(topic)]
    # A receiver that starts again may go back in time; RINEX must not.
    ordered = {epoch.time.nanoseconds: epoch for epoch in epochs}
    path = folder / f"{name.replace('/', '_')}.rnx"
    write_rinex_observation(
        path,
        [ordered[time] for time in sorted(ordered)],
        marker_name=name[:_LONGEST_MARKER],
        marker_type="SPACEBORNE",
    )
    files = [path]
    ephemeris_topic = f"{topic.rpartition('/')[0]}/ephemeris"
    if reader.topics.get(ephemeris_topic) and reader.topics[ephemeris_topic].message_count:
        ephemerides = [ephemeris_from_message(d.message) for d in reader.messages(ephemeris_topic)]
        path = folder / f"{name.replace('/', '_')}_nav.rnx"
        write_rinex_navigation(path, ephemerides, leap_seconds=_leap_seconds(min(ordered)))
        files.append(path)
    return files


def _leap_seconds(gps_nanoseconds: int) -> int:
    """Return GPS - UTC in s at a time of the recording."""
    utc = GpsTime(gps_nanoseconds).to_unix_nanoseconds()
    unix_of_gps_epoch = GpsTime(0).to_unix_nanoseconds()
    return round((gps_nanoseconds - (utc - unix_of_gps_epoch)) * 1e-9)
