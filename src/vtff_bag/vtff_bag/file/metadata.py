"""``metadata.yaml`` of rosbag2, version 9 (rosbag2_storage ``bag_metadata.hpp``, ``yaml.hpp``)."""

from __future__ import annotations

import copy
import dataclasses
import functools
import os
import pathlib
from collections.abc import Mapping
from typing import Any

from vtff_bag.file.errors import BagReadError, BagWriteError
from vtff_node.plain_yaml import PlainYamlError, format_yaml, parse_yaml

METADATA_FILE = "metadata.yaml"
METADATA_VERSION = 9
STORAGE_IDENTIFIER = "mcap"
ROS_DISTRIBUTION = "jazzy"
ROOT_KEY = "rosbag2_bagfile_information"

#: The infinite duration of rmw, split as rosbag2 writes it.
INFINITE_DURATION = {"sec": 9223372036, "nsec": 854775807}

#: What `_parse` raises at a mapping that is no bag metadata; PlainYamlError is a ValueError.
_PARSING_ERRORS = (LookupError, TypeError, ValueError, AttributeError, OverflowError)

QosEntry = dict[str, Any]


def offered_qos(
    *,
    history: str = "keep_last",
    depth: int = 1000,
    reliability: str = "reliable",
    durability: str = "transient_local",
    deadline: Mapping[str, int] = INFINITE_DURATION,
    lifespan: Mapping[str, int] = INFINITE_DURATION,
    liveliness: str = "automatic",
    liveliness_lease_duration: Mapping[str, int] = INFINITE_DURATION,
    avoid_ros_namespace_conventions: bool = False,
) -> QosEntry:
    """Return one entry of ``offered_qos_profiles``; words as in ``qos.cpp`` of rosbag2."""
    return {
        "history": history,
        "depth": depth,
        "reliability": reliability,
        "durability": durability,
        "deadline": dict(deadline),
        "lifespan": dict(lifespan),
        "liveliness": liveliness,
        "liveliness_lease_duration": dict(liveliness_lease_duration),
        "avoid_ros_namespace_conventions": avoid_ros_namespace_conventions,
    }


@dataclasses.dataclass
class TopicInformation:
    """A topic of a bag."""

    name: str
    type: str
    message_count: int = 0
    offered_qos_profiles: list[QosEntry] = dataclasses.field(default_factory=list)
    type_hash: str = ""
    serialization_format: str = "cdr"


@dataclasses.dataclass
class FileInformation:
    """One storage file of a bag; times in ns since 1970."""

    path: str
    start_time: int = 0
    end_time: int = 0
    message_count: int = 0

    def add_message(self, log_time: int) -> None:
        """Count a message of that time, ns since 1970."""
        self.start_time = min(self.start_time, log_time) if self.message_count else log_time
        self.end_time = max(self.end_time, log_time)
        self.message_count += 1


@dataclasses.dataclass
class BagMetadata:
    """Content of ``metadata.yaml``."""

    files: list[FileInformation]
    topics: list[TopicInformation]
    custom_data: dict[str, str] = dataclasses.field(default_factory=dict)
    ros_distribution: str = ROS_DISTRIBUTION
    storage_identifier: str = STORAGE_IDENTIFIER

    @property
    def message_count(self) -> int:
        """Number of messages in all files."""
        return sum(file.message_count for file in self.files)

    def as_dictionary(self) -> dict[str, Any]:
        """Return the mapping that rosbag2 stores, without its root key."""
        filled = [file for file in self.files if file.message_count]
        start = min((file.start_time for file in filled), default=0)
        end = max((file.end_time for file in filled), default=0)
        return {
            "version": METADATA_VERSION,
            "storage_identifier": self.storage_identifier,
            "duration": {"nanoseconds": end - start},
            "starting_time": {"nanoseconds_since_epoch": start},
            "message_count": self.message_count,
            "topics_with_message_count": [_format_topic(topic) for topic in self.topics],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [file.path for file in self.files],
            "files": [_format_file(file) for file in self.files],
            "custom_data": dict(self.custom_data),
            "ros_distro": self.ros_distribution,
        }


def _format_topic(topic: TopicInformation) -> dict[str, Any]:
    return {
        "topic_metadata": {
            "name": topic.name,
            "type": topic.type,
            "serialization_format": topic.serialization_format,
            "offered_qos_profiles": topic.offered_qos_profiles,
            "type_description_hash": topic.type_hash,
        },
        "message_count": topic.message_count,
    }


def _format_file(file: FileInformation) -> dict[str, Any]:
    return {
        "path": file.path,
        "starting_time": {"nanoseconds_since_epoch": file.start_time},
        "duration": {"nanoseconds": file.end_time - file.start_time},
        "message_count": file.message_count,
    }


def write_metadata(directory: pathlib.Path, metadata: BagMetadata) -> None:
    """Write ``metadata.yaml`` so that a crash leaves either the old or the new text.

    Raises
    ------
    BagWriteError
        If the file cannot be written.
    """
    path = directory / METADATA_FILE
    unfinished = directory / f".{METADATA_FILE}.new"
    try:
        text = format_yaml({ROOT_KEY: metadata.as_dictionary()})
        unfinished.write_text(text, encoding="utf-8")
        os.replace(unfinished, path)
    except OSError as error:
        raise BagWriteError(f"{path}: cannot write: {error.strerror or error}") from error


def read_metadata(path: pathlib.Path) -> BagMetadata:
    """Read a ``metadata.yaml`` of any version.

    Raises
    ------
    BagReadError
        If the file is not readable as bag metadata; the text names it.
    """
    try:
        text = path.read_bytes()
    except OSError as error:
        raise BagReadError(f"{path}: cannot read: {error.strerror or error}") from error
    try:
        content = parse_yaml(text.decode("utf-8"))
    except (PlainYamlError, UnicodeDecodeError) as error:
        raise BagReadError(f"{path}: not valid YAML: {error}") from error
    try:
        return _parse(content[ROOT_KEY])
    except _PARSING_ERRORS as error:
        raise BagReadError(f"{path}: not bag metadata: {error!r}") from error


def parse_stored_metadata(text: str) -> BagMetadata | None:
    """Return the metadata from the copy in an MCAP file (no root key); None if unreadable."""
    try:
        return _parse(parse_yaml(text))
    except _PARSING_ERRORS:
        return None


def _parse(content: Mapping[str, Any]) -> BagMetadata:
    topics = [
        TopicInformation(
            name=str(entry["topic_metadata"]["name"]),
            type=str(entry["topic_metadata"]["type"]),
            message_count=int(entry["message_count"]),
            offered_qos_profiles=parse_qos(entry["topic_metadata"].get("offered_qos_profiles")),
            type_hash=str(entry["topic_metadata"].get("type_description_hash") or ""),
            serialization_format=str(entry["topic_metadata"]["serialization_format"]),
        )
        for entry in content["topics_with_message_count"] or []
    ]
    details = {entry["path"]: entry for entry in content.get("files") or []}
    files = []
    for name in content["relative_file_paths"] or []:
        file = FileInformation(path=str(name))
        if name in details:
            file.start_time = int(details[name]["starting_time"]["nanoseconds_since_epoch"])
            file.end_time = file.start_time + int(details[name]["duration"]["nanoseconds"])
            file.message_count = int(details[name]["message_count"])
        files.append(file)
    custom = {str(key): str(value) for key, value in (content.get("custom_data") or {}).items()}
    return BagMetadata(
        files=files,
        topics=topics,
        custom_data=custom,
        ros_distribution=str(content.get("ros_distro") or "unknown"),
        storage_identifier=str(content["storage_identifier"]),
    )


def parse_qos(offered: Any) -> list[QosEntry]:
    """Return offered QoS profiles from a list or from YAML text; anything else gives none."""
    if isinstance(offered, str):
        return copy.deepcopy(_parse_qos_text(offered))
    return _select_profiles(offered)


@functools.lru_cache(maxsize=64)
def _parse_qos_text(offered: str) -> list[QosEntry]:
    """Return the profiles in a YAML text; most topics of a bag have the same text."""
    try:
        return _select_profiles(parse_yaml(offered))
    except PlainYamlError:
        return []


def _select_profiles(offered: Any) -> list[QosEntry]:
    """Return what is a QoS profile of what should be a list of them."""
    if not isinstance(offered, list):
        return []
    return [entry for entry in offered if isinstance(entry, dict)]
