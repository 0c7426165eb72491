"""Bag -> `Scene` of the viewer; needs rclpy."""

from __future__ import annotations

import os
import pathlib
import re
from collections.abc import Callable
from typing import Any

from vtff_analysis.view.regions import irregularity_regions
from vtff_analysis.view.scene import Scene
from vtff_analysis.view.scene_builder import SceneBuilder, sample_interval
from vtff_bag.file.errors import UnknownTypeError
from vtff_bag.file.message_definitions import message_class
from vtff_bag.file.reader import BagReader
from vtff_bag.run.description import describe_run

_FIX_TOPIC = re.compile(r"^/(?P<craft>.+)/gnss/fix$")
_NANOSECONDS = 1_000_000_000

Progress = Callable[[float], None]


def read_scene(path: str | os.PathLike[str], progress: Progress | None = None) -> Scene:
    """Read what the viewer shows from a bag.

    Parameters
    ----------
    path
        Bag directory, run folder or ``.mcap`` file, in any state.
    progress
        Called now and then with the part that is read, 0 to 1.

    Returns
    -------
    Scene
        With at most one sample a second, and about 4000 of each series.

    Raises
    ------
    vtff_bag.file.errors.BagReadError
        If there is no bag or nothing in it can be read.
    """
    reader = BagReader(path)
    duration = (reader.end_time - reader.start_time) / _NANOSECONDS
    scene = Scene(name=_run_name(pathlib.Path(path)), start=reader.start_time, duration=duration)
    scene.notes.extend(reader.notes)
    builder = SceneBuilder(scene, sample_interval(duration))
    decoders = _decoders(reader, builder, scene)
    length = max(1, reader.end_time - reader.start_time)
    step = max(1, sum(reader.topics[name].message_count for name in decoders) // 100)
    for count, raw in enumerate(reader.raw_messages(list(decoders))):
        if progress is not None and count % step == 0:
            progress((raw.log_time - reader.start_time) / length)
        decode = decoders.get(raw.topic)
        if decode is None or not builder.wanted(raw.topic, raw.log_time):
            continue
        try:
            builder.put(raw.topic, raw.log_time, decode(raw.serialized))
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
    return scene


def _decoders(
    reader: BagReader, builder: SceneBuilder, scene: Scene
) -> dict[str, Callable[[bytes], Any]]:
    """Return what decodes each topic that is shown."""
    from rclpy.serialization import deserialize_message

    decoders: dict[str, Callable[[bytes], Any]] = {}
    for topic in reader.topics.values():
        fix = _FIX_TOPIC.match(topic.name)
        true_orbit = reader.topics.get(f"/{fix['craft']}/truth/orbit") if fix else None
        if builder.handler(topic.name) is None or (true_orbit and true_orbit.message_count):
            continue
        try:
            kind = message_class(topic.type)
        except UnknownTypeError as error:
            scene.notes.append(f"topic '{topic.name}' is left out: {error}")
            continue
        decoders[topic.name] = lambda serialized, kind=kind: deserialize_message(serialized, kind)
    return decoders


def _run_name(path: pathlib.Path) -> str:
    resolved = path.resolve()
    return resolved.parent.name if resolved.name == "bag" else resolved.stem
