"""Observations, ephemerides, thrust and truth of a baseline, from a bag; needs ROS."""

from __future__ import annotations

import itertools
import pathlib

import numpy as np

from vtff_analysis.baseline.sources import BaselineError, BaselineSources, Thrust, TrueBaseline
from vtff_analysis.recordings.observation_recording import recorded_observations
from vtff_analysis.recordings.topics import CHIEF, DEPUTY, truth_topic
from vtff_bag.file.reader import BagReader
from vtff_dynamics.frames.earth import rotation_gcrf_to_itrf
from vtff_dynamics.frames.rtn import rotation_gcrf_to_rtn
from vtff_dynamics.time.timescales import GpsTime
from vtff_gnss.ephemeris import BroadcastEphemeris
from vtff_node.conversions.gnss import ephemeris_from_message
from vtff_node.stamps import to_nanoseconds

__all__ = ["from_bag"]


def from_bag(bag: pathlib.Path, rover: str = DEPUTY, base: str = CHIEF) -> BaselineSources:
    """Read the observations of two receivers from a bag.

    Parameters
    ----------
    bag : pathlib.Path
        Bag directory, run folder or ``.mcap`` file.
    rover, base : str
        Names of the receivers: topics ``/NAME/gnss/epoch`` and ``/NAME/gnss/ephemeris``.

    Raises
    ------
    vtff_bag.file.errors.BagError
        If the bag cannot be read or lacks a topic.
    BaselineError
        If there are no observations or ephemerides.
    """
    reader = BagReader(bag)
    tables = [recorded_observations(reader, f"/{name}/gnss/epoch") for name in (rover, base)]
    for name, table in zip((rover, base), tables, strict=True):
        if not len(table):
            raise BaselineError(f"{bag}: no message on /{name}/gnss/epoch")
    ephemerides: dict[BroadcastEphemeris, None] = {}
    for name in (rover, base):
        topic = f"/{name}/gnss/ephemeris"
        if topic in reader.topics:
            for decoded in reader.messages(topic):
                ephemerides[ephemeris_from_message(decoded.message)] = None
    if not ephemerides:
        raise BaselineError(f"{bag}: no ephemerides on /{rover}/gnss/ephemeris or /{base}/...")
    return BaselineSources(
        rover_name=f"{rover} of {bag.name}",
        base_name=f"{base} of {bag.name}",
        rover=tables[0],
        base=tables[1],
        ephemerides=tuple(ephemerides),
        position_base_itrf=None,
        is_position_stated=False,
        remarks=tuple(reader.notes),
        thrust=_read_thrust(reader, f"/{rover}/propulsion/thrust_applied"),
        truth=_read_truth(reader, rover),
    )


def _read_thrust(reader: BagReader, topic: str) -> tuple[Thrust, ...]:
    """Return the applied thrust; each message holds until the next one."""
    if topic not in reader.topics:
        return ()
    messages = [decoded.message for decoded in reader.messages(topic)]
    starts = [
        GpsTime.from_unix_nanoseconds(to_nanoseconds(message.header.stamp)) for message in messages
    ]
    steps = [later - earlier for earlier, later in itertools.pairwise(starts)]
    steps.append(float(np.median(steps)) if steps else 1.0)
    linear = [message.accel.linear for message in messages]
    return tuple(
        Thrust(start, step, np.array([a.x, a.y, a.z]))
        for start, step, a in zip(starts, steps, linear, strict=True)
        if step > 0.0
    )


def _read_truth(reader: BagReader, rover: str) -> TrueBaseline | None:
    topic = truth_topic(rover)
    if topic not in reader.topics:
        return None
    times, baselines = [], []
    for decoded in reader.messages(topic):
        message = decoded.message
        if message.child_frame_id == rover:
            time = GpsTime.from_unix_nanoseconds(to_nanoseconds(message.header.stamp))
            chief = np.concatenate((message.position_chief_gcrf, message.velocity_chief_gcrf))
            baseline_gcrf = rotation_gcrf_to_rtn(chief).T @ np.asarray(message.position)
            times.append(time.nanoseconds)
            baselines.append(rotation_gcrf_to_itrf(time) @ baseline_gcrf)
    if not times:
        return None
    return TrueBaseline(np.array(times, dtype=np.int64), np.array(baselines))
