"""Description of a bag in the form of ``ros2 bag info``, with the state of the bag."""

from __future__ import annotations

import datetime
import os

from vtff_bag.file.metadata import STORAGE_IDENTIFIER
from vtff_bag.file.reader import BagReader
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND

_INDENT = 19
_LONGEST_TEXT = 60


def describe_bag(path: str | os.PathLike[str]) -> str:
    """Return the description of a bag directory or an MCAP file.

    Raises
    ------
    BagReadError
        If there is no bag or nothing in it can be read; the text names the file.
    """
    return format_information(BagReader(path))


def format_information(reader: BagReader) -> str:
    """Return the description of an open bag; times are UTC, whereas ros2 prints local time."""
    distribution = reader.metadata.ros_distribution if reader.metadata is not None else "unknown"
    topics = [
        f"Topic: {topic.name} | Type: {topic.type} | Count: {topic.message_count} | "
        f"Serialization Format: {topic.serialization_format}"
        for topic in sorted(reader.topics.values(), key=lambda topic: topic.name)
    ]
    rows = [
        ("Files", [file.name for file in reader.files]),
        ("Bag size", [_format_size(sum(file.stat().st_size for file in reader.files))]),
        ("Storage id", [STORAGE_IDENTIFIER]),
        ("ROS Distro", [distribution]),
        ("Duration", [f"{_format_seconds(reader.end_time - reader.start_time)}s"]),
        ("Start", [_format_time(reader.start_time)]),
        ("End", [_format_time(reader.end_time)]),
        ("Messages", [str(reader.message_count)]),
        ("Topic information", topics),
        ("State", [_describe_state(reader), *reader.notes]),
    ]
    if reader.custom_data:
        custom = sorted(reader.custom_data.items())
        rows.append(("Custom data", [f"{key}: {_shorten(text)}" for key, text in custom]))
    return "\n".join(_format_row(title, values) for title, values in rows)


def _shorten(text: str) -> str:
    """Return a text as one line that fits a terminal."""
    line = " ".join(text.split())
    return line if len(line) <= _LONGEST_TEXT else f"{line[: _LONGEST_TEXT - 4]} ..."


def _format_row(title: str, values: list[str]) -> str:
    separator = "\n" + " " * _INDENT
    return f"{title + ':':{_INDENT}}{separator.join(values)}".rstrip()


def _describe_state(reader: BagReader) -> str:
    if reader.complete:
        return "complete"
    if all(content.closed for content in reader.contents):
        return f"damaged -> vtff bag recover {reader.path}"
    return f"not closed properly -> vtff bag recover {reader.path}"


def _format_seconds(nanoseconds: int) -> str:
    return f"{nanoseconds // NANOSECONDS_PER_SECOND}.{nanoseconds % NANOSECONDS_PER_SECOND:09d}"


def _format_time(nanoseconds: int) -> str:
    epoch = datetime.datetime(1970, 1, 1, tzinfo=datetime.timezone.utc)
    try:
        moment = epoch + datetime.timedelta(seconds=nanoseconds // NANOSECONDS_PER_SECOND)
    except OverflowError:
        return f"({_format_seconds(nanoseconds)})"
    fraction = f"{nanoseconds % NANOSECONDS_PER_SECOND:09d}"
    return f"{moment:%b %d %Y %H:%M:%S}.{fraction} UTC ({_format_seconds(nanoseconds)})"


def _format_size(size: int) -> str:
    if size < 1024:
        return f"{size} B"
    value = float(size)
    for unit in ("KiB", "MiB", "GiB"):
        value /= 1024.0
        if value < 1024.0:
            return f"{value:.1f} {unit}"
    return f"{value / 1024.0:.1f} TiB"
