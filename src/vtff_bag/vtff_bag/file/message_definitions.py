"""Message definitions as the ``ros2msg`` schema text that MCAP files carry.

The form is that of rosbag2 (``local_message_definition_source.cpp``): the text of the root ``.msg``
file, then for each type that it needs, depth first and once, a newline, 80 equals signs, a newline,
``MSG: package/Type``, a newline and the text of that type. Comments are kept.
"""

from __future__ import annotations

import functools
import importlib
import json
import os
import pathlib
import re
import sys
from typing import Any

from vtff_bag.file.errors import UnknownTypeError

SEPARATOR = "=" * 80

_TYPE_NAME = re.compile(r"^([a-z][a-z0-9_]*)/(?:msg/)?([A-Za-z][A-Za-z0-9_]*)$")
_FIELD = re.compile(r"^\s*([A-Za-z][A-Za-z0-9_/]*)(?:<=\d+)?(?:\[[<=\d]*\])?\s+[A-Za-z]\w*")
_PRIMITIVES = frozenset(
    "bool byte char float32 float64 int8 uint8 int16 uint16 int32 uint32 int64 uint64 "
    "string wstring".split()
)


def message_definition(type_name: str) -> str:
    """Return the complete schema text of a message type.

    Parameters
    ----------
    type_name
        ``package/msg/Type``.

    Raises
    ------
    UnknownTypeError
        If the ``.msg`` file of the type, or of one that it needs, is not installed.
    """
    return _build_definition(type_name, search_prefixes())


def search_prefixes() -> tuple[str, ...]:
    """Return the folders that may hold ``share/<package>/msg``, in the order of the search."""
    overlays = [
        entry for entry in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if entry
    ]
    return tuple(dict.fromkeys([*overlays, sys.prefix]))


def first_field_type(type_name: str) -> str:
    """Return the type of the first field of a message: ``package/Type`` or a primitive, or ''."""
    package, name = _split_name(type_name)
    fields = _parse_field_types(_read_definition(package, name, search_prefixes()), package)
    return fields[0] if fields else ""


def message_class(type_name: str) -> Any:
    """Import the Python class of a message type.

    Raises
    ------
    UnknownTypeError
        If the package is not installed or has no such message.
    """
    package, name = _split_name(type_name)
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError) as error:
        raise UnknownTypeError(
            f"message type '{type_name}' has no Python class: {error}"
        ) from error


def deserialize(serialized: bytes, message_type: Any) -> Any:
    """Return a message of a class from its CDR bytes; needs rclpy and raises its exceptions."""
    # Imported here, so that bags can be inspected on a machine without ROS.
    from rclpy.serialization import deserialize_message

    return deserialize_message(serialized, message_type)


def installed_type_hash(type_name: str) -> str:
    """Return the ``RIHS01_...`` hash of an installed message type; '' if its package has none.

    rosidl writes the hash into ``share/<package>/msg/<Type>.json`` (REP-2016).
    """
    package, name = _split_name(type_name)
    return _read_type_hash(package, name, search_prefixes())


@functools.cache
def _read_type_hash(package: str, name: str, prefixes: tuple[str, ...]) -> str:
    for prefix in prefixes:
        path = pathlib.Path(prefix) / "share" / package / "msg" / f"{name}.json"
        if path.is_file():
            entries = json.loads(path.read_text(encoding="utf-8")).get("type_hashes", ())
            hashes = {entry["type_name"]: entry["hash_string"] for entry in entries}
            return str(hashes.get(f"{package}/msg/{name}", ""))
    return ""


def _split_name(type_name: str) -> tuple[str, str]:
    match = _TYPE_NAME.match(type_name)
    if match is None:
        raise UnknownTypeError(f"'{type_name}' is not a message type (package/msg/Type)")
    return match.group(1), match.group(2)


@functools.cache
def _build_definition(type_name: str, prefixes: tuple[str, ...]) -> str:
    package, name = _split_name(type_name)
    parts = [_read_definition(package, name, prefixes)]
    seen = {f"{package}/{name}"}

    def append_dependencies(text: str, package_of_text: str) -> None:
        for field_type in _parse_field_types(text, package_of_text):
            if field_type in _PRIMITIVES or field_type in seen:
                continue
            seen.add(field_type)
            dependency_package, dependency_name = _split_name(field_type)
            try:
                dependency = _read_definition(dependency_package, dependency_name, prefixes)
            except UnknownTypeError as error:
                raise UnknownTypeError(f"{error} (needed by '{type_name}')") from None
            parts.append(f"\n{SEPARATOR}\nMSG: {field_type}\n{dependency}")
            append_dependencies(dependency, dependency_package)

    append_dependencies(parts[0], package)
    return "".join(parts)


@functools.cache
def _read_definition(package: str, name: str, prefixes: tuple[str, ...]) -> str:
    for prefix in prefixes:
        path = pathlib.Path(prefix) / "share" / package / "msg" / f"{name}.msg"
        if path.is_file():
            return path.read_text(encoding="utf-8")
    raise UnknownTypeError(
        f"message type '{package}/msg/{name}' is not installed: no share/{package}/msg/{name}.msg "
        f"in {len(prefixes)} prefixes (AMENT_PREFIX_PATH and {sys.prefix})"
    )


def _parse_field_types(text: str, package: str) -> list[str]:
    """Return the types of the fields in order, without constants; messages as ``package/Type``."""
    types = []
    for line in text.splitlines():
        code = line.split("#", 1)[0]
        match = _FIELD.match(code)
        if match is None or "=" in code[match.end() :].split('"', 1)[0].split("'", 1)[0]:
            continue
        name = match.group(1)
        if name not in _PRIMITIVES:
            dependency_package, dependency_name = _split_name(
                name if "/" in name else f"{package}/{name}"
            )
            name = f"{dependency_package}/{dependency_name}"
        types.append(name)
    return types
