"""System files that extend another one: the raw contents of both, joined before they are read."""

from __future__ import annotations

import pathlib
from collections.abc import Callable, Mapping
from typing import Any

__all__ = ["SystemFileError", "joined_system"]

# Keys whose entries are found again by their names.
_LISTS = ("processes", "nodes")


class SystemFileError(ValueError):
    """A system file or an override is wrong; the text names file, entry and key."""


def joined_system(
    path: pathlib.Path, read: Callable[[pathlib.Path], dict[str, Any]]
) -> dict[str, Any]:
    """Return the content of a system file, joined with that of the files that it extends.

    The entries of ``arguments``, ``processes`` and ``nodes`` that the extended file has under the
    same name get the keys of the extending one; a mapping, such as the parameters of a node, gets
    its entries. Entries of a new name come after the others. ``description`` replaces the other.

    Parameters
    ----------
    path
        The system file. ``extends`` in it names a file relative to it.
    read
        Returns the mapping in a file.

    Raises
    ------
    SystemFileError
        If files extend each other in a circle or an entry has the wrong form.
    """
    return _joined(path, read, ())


def _joined(
    path: pathlib.Path,
    read: Callable[[pathlib.Path], dict[str, Any]],
    chain: tuple[pathlib.Path, ...],
) -> dict[str, Any]:
    if path.resolve() in chain:
        raise SystemFileError(f"{chain[0]}: 'extends' leads in a circle to {path.name}")
    content = read(path)
    if "extends" not in content:
        return content
    base_path = path.parent / str(content["extends"])
    base = _joined(base_path, read, (*chain, path.resolve()))
    _make_paths_absolute(base, base_path.parent.resolve())
    joined = {**base, **content}
    del joined["extends"]
    arguments = dict(_checked(base.get("arguments"), dict, base_path, "arguments"))
    for name, entry in _checked(content.get("arguments"), dict, path, "arguments").items():
        arguments[name] = _merged(arguments.get(name), entry)
    joined["arguments"] = arguments
    for key in _LISTS:
        entries = list(_checked(base.get(key), list, base_path, key))
        places = {_name(entry): place for place, entry in enumerate(entries)}
        for entry in _checked(content.get(key), list, path, key):
            place = places.get(_name(entry))
            if place is None:
                entries.append(entry)
            else:
                entries[place] = _merged(entries[place], entry)
        joined[key] = entries
    return joined


def _checked(value: Any, kind: type, path: pathlib.Path, key: str) -> Any:
    if value is None:
        return kind()
    if not isinstance(value, kind):
        form = "mapping of names to values" if kind is dict else "list"
        raise SystemFileError(f"{path}: system file: '{key}' must be a {form}, not {value!r}")
    return value


def _name(entry: Any) -> tuple[str, str] | None:
    """Return what an entry of a list is known by: its namespace and its name."""
    if not isinstance(entry, Mapping):
        return None
    name = entry.get("name") or entry.get("executable") or ""
    return str(entry.get("namespace", "")), str(name)


def _merged(base: Any, entry: Any) -> Any:
    """Return a mapping with the keys of both; mappings in it are merged in the same way."""
    if not (isinstance(base, Mapping) and isinstance(entry, Mapping)):
        return entry
    return {**base, **{key: _merged(base.get(key), value) for key, value in entry.items()}}


def _make_paths_absolute(content: dict[str, Any], folder: pathlib.Path) -> None:
    """Make the paths of an extended file independent of the folder of the extending one."""
    for entry in (content.get("arguments") or {}).values():
        if isinstance(entry, dict) and entry.get("file") and "default" in entry:
            entry["default"] = str(folder / str(entry["default"]))
    for entry in content.get("nodes") or []:
        if isinstance(entry, dict) and isinstance(entry.get("parameter_files"), list):
            # A path that comes from an argument is absolute when it is resolved.
            entry["parameter_files"] = [
                text if str(text).startswith("${") else str(folder / str(text))
                for text in entry["parameter_files"]
            ]
