"""Bag -> `Scene` of the viewer; needs rclpy."""

from __future__ import annotations

import functools
import os
import pathlib
import re
from collections.abc import Callable
from typing import Any

from rclpy.serialization import deserialize_message

from vtff_analysis.view.regions import add_dip_equator, irregularity_regions
from vtff_analysis.view.scene import Scene
from vtff_analysis.view.scene_builder import SceneBuilder, sample_interval
from vtff_bag.file.errors import UnknownTypeError
from vtff_bag.file.message_definitions import message_class
from vtff_bag.file.reader import BagReader
from vtff_bag.run.description import describe_run
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND

_FIX_TOPIC = re.compile(r"^/(?P<craft>.+)/gnss/fix$")

Progress = Callable[[float], None]


def read_scene(path: str | os.PathLike[str], progress: Progress | None = None) -> Scene:
    """Read what the viewer shows from a bag.

    Parameters
    ----------
    path
        Bag directory, run folder or ``.mcap`` file, in any state.
    progress
        Called about a hundred times with the fraction that is read, 0 to 1.

    Returns
    -------
    Scene
        Scene with at most one sample a second, and about 4000 samples of each series.

    Raises
    ------
    vtff_bag.file.errors.BagReadError
        If there is no bag or nothing in it can be read.
    """
    reader = BagReader(path)
    duration = (reader.end_time - reader.start_time) / NANOSECONDS_PER_SECOND
    scene = Scene(name=_run_name(pathlib.Path(path)), start=reader.start_time, duration=duration)
    scene.notes.extend(reader.notes)
    builder = SceneBuilder(scene, sample_interval(duration))
    decoders = _make_decoders(reader, builder, scene)
    length = max(1, reader.end_time - reader.start_time)
    step = max(1, sum(reader.topics[name].message_count for name in decoders) // 100)
    for count, raw in enumerate(reader.raw_messages(list(decoders))):
        if progress is not None and count % step == 0:
            progress((raw.log_time - reader.start_time) / length)
        decode = decoders.get(raw.topic)
        if decode is None or not builder.claim_slot(raw.topic, raw.log_time):
            continue
        try:
            builder.add(raw.topic, raw.log_time, decode(raw.serialized))
        except Exception as error:  # rclpy raises its own and C++ exceptions here
            del decoders[raw.topic]
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            scene.notes.append(f"topic '{raw.topic}': unreadable from {raw.log_time} ns: {reason}")
    builder.finish()
    scene.duration = max(scene.duration, duration)
    described = describe_run(pathlib.Path(path), reader.custom_data)
    try:
        scene.regions = irregularity_regions(described, scene.start)
    except ValueError as error:
        scene.notes.append(f"irregularity regions are left out: {error}")
    add_dip_equator(scene)
    return scene


def _make_decoders(
    reader: BagReader, builder: SceneBuilder, scene: Scene
) -> dict[str, Callable[[bytes], Any]]:
    """Return the decoder of each topic that the scene shows."""
    decoders: dict[str, Callable[[bytes], Any]] = {}
    for topic in reader.topics.values():
        fix = _FIX_TOPIC.match(topic.name)
        true_orbit = reader.topics.get(f"/{fix['craft']}/truth/orbit") if fix else None
        if builder.handler(topic.name) is None or (true_orbit and true_orbit.message_count):
            continue
        try:
            message_type = message_class(topic.type)
        except UnknownTypeError as error:
            scene.notes.append(f"topic '{topic.name}' is left out: {error}")
            continue
        decoders[topic.name] = functools.partial(deserialize_message, message_type=message_type)
    return decoders


def _run_name(path: pathlib.Path) -> str:
    resolved = path.resolve()
    return resolved.parent.name if resolved.name == "bag" else resolved.stem
