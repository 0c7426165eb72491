"""Receivers of a bag whose electron content is asked for; needs ROS."""

from __future__ import annotations

import pathlib

from vtff_analysis.recordings.observation_recording import recorded_observations
from vtff_analysis.recordings.run_place import find_run
from vtff_analysis.tec.errors import TecError
from vtff_analysis.tec.receiver_orbit import orbit_from_fixes
from vtff_analysis.tec.sources import TecSource
from vtff_bag.file.reader import BagReader
from vtff_gnss.fix import Fix
from vtff_node.conversions.gnss import ephemeris_from_message, fix_from_message

__all__ = ["bag_receivers", "from_bag"]

# Topics with observations, the preferred one first.
_OBSERVATIONS = ("high_rate", "epoch")


def bag_receivers(path: pathlib.Path) -> list[str]:
    """Return the namespaces of the receivers of a bag, such as ``/chief``.

    Raises
    ------
    vtff_bag.file.errors.BagError
        If the bag cannot be read.
    TecError
        If it holds no observations.
    """
    receivers = {
        topic.removesuffix(f"/gnss/{kind}")
        for topic in BagReader(path).topics
        for kind in _OBSERVATIONS
        if topic.endswith(f"/gnss/{kind}")
    }
    if not receivers:
        raise TecError(f"{path}: no topic NAME/gnss/high_rate or NAME/gnss/epoch in this bag")
    return sorted(receivers)


def from_bag(path: pathlib.Path, receiver: str, systems: str | None = None) -> TecSource:
    """Read a receiver of a bag: ``RECEIVER/gnss/high_rate``, else ``RECEIVER/gnss/epoch``.

    Only observations of `systems` are used, RINEX letters, of all systems if it is None.

    Raises
    ------
    vtff_bag.file.errors.BagError
        If the bag cannot be read.
    TecError
        If it holds no observations of this receiver.
    """
    reader = BagReader(path)
    topics = [f"{receiver}/gnss/{kind}" for kind in _OBSERVATIONS]
    topic = next((topic for topic in topics if topic in reader.topics), None)
    if topic is None:
        raise TecError(f"{path}: neither {' nor '.join(topics)} in this bag")
    latched = f"{receiver}/gnss/ephemeris"
    messages = reader.messages(latched) if latched in reader.topics else []
    name = find_run(path).name
    return TecSource(
        description=f"{topic} of {name}",
        table=recorded_observations(reader, topic).select(systems),
        ephemerides=tuple({ephemeris_from_message(decoded.message): None for decoded in messages}),
        position_itrf=None,
        remarks=tuple(reader.notes),
        orbit=orbit_from_fixes(f"fixes of {receiver} in {name}", _recorded_fixes(reader, receiver)),
    )


def _recorded_fixes(reader: BagReader, receiver: str) -> list[Fix]:
    topic = f"{receiver}/gnss/fix"
    if topic not in reader.topics:
        return []
    return [fix_from_message(decoded.message) for decoded in reader.messages(topic)]
