"""System files that extend another one: their contents are joined before they are read."""

from __future__ import annotations

import pathlib
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from vtff_bringup.system.errors import SystemFileError
from vtff_bringup.system.yaml_file import resolve_file

__all__ = ["join_system"]

# Keys of lists whose entries are joined by their names.
_LISTS = ("processes", "nodes")


def join_system(
    path: pathlib.Path, read: Callable[[pathlib.Path], dict[str, Any]]
) -> dict[str, Any]:
    """Return the content of a system file, joined with that of the files that it extends.

    Entries of ``arguments``, ``processes`` and ``nodes`` with the same name in both files are
    merged: keys of the extending file replace or add to those of the extended one, also within
    mappings such as the parameters of a node. Entries with a new name come last. ``description``
    is that of the extending file.

    Parameters
    ----------
    path
        The system file. Its key ``extends`` names a file relative to it.
    read
        Function that returns the mapping in a file.

    Raises
    ------
    SystemFileError
        If files extend each other in a circle or an entry has the wrong form.
    """
    return _join(path, read, ())


def _join(
    path: pathlib.Path,
    read: Callable[[pathlib.Path], dict[str, Any]],
    chain: tuple[pathlib.Path, ...],
) -> dict[str, Any]:
    if path.resolve() in chain:
        raise SystemFileError(f"{chain[0]}: 'extends' leads in a circle to {path.name}")
    content = read(path)
    if "extends" not in content:
        return content
    resolve_file(path.parent, content["extends"])  # the path below keeps the folder of a link
    base_path = path.parent / str(content["extends"])
    base = _join(base_path, read, (*chain, path.resolve()))
    _make_paths_absolute(base, base_path)
    joined = {**base, **content}
    del joined["extends"]
    arguments = dict(_require_kind(base.get("arguments"), dict, base_path, "arguments"))
    for name, entry in _require_kind(content.get("arguments"), dict, path, "arguments").items():
        arguments[name] = _merge(arguments.get(name), entry)
    joined["arguments"] = arguments
    joined["hosts"] = {
        **_require_kind(base.get("hosts"), dict, base_path, "hosts"),
        **_require_kind(content.get("hosts"), dict, path, "hosts"),
    }
    for key in _LISTS:
        entries = list(_require_kind(base.get(key), list, base_path, key))
        indices = {_entry_name(entry): index for index, entry in enumerate(entries)}
        for entry in _require_kind(content.get(key), list, path, key):
            index = indices.get(_entry_name(entry))
            if index is None:
                _require_whole(entry, indices, path, base_path)
                entries.append(entry)
            else:
                entries[index] = _merge(entries[index], entry)
        joined[key] = entries
    return joined


def _require_whole(
    entry: Any, bases: Iterable[tuple[str, str] | None], path: pathlib.Path, base_path: pathlib.Path
) -> None:
    """Raise SystemFileError where an entry changes a node that the extended file does not have."""
    name = _entry_name(entry)
    if name is None or entry.get("package") or entry.get("command"):
        return
    same = [base for base in bases if base and base[1] == name[1]]
    if same:
        places = " or ".join(
            f"namespace: {namespace}" if namespace else "no namespace" for namespace, _ in same
        )
        raise SystemFileError(
            f"{path}: '{name[1]}' of {base_path.name} is not in namespace '{name[0]}' "
            f"(there: {places})"
        )


def _require_kind(value: Any, kind: type, path: pathlib.Path, key: str) -> Any:
    if value is None:
        return kind()
    if not isinstance(value, kind):
        form = "mapping of names to values" if kind is dict else "list"
        raise SystemFileError(f"{path}: system file: '{key}' must be a {form}, not {value!r}")
    return value


def _entry_name(entry: Any) -> tuple[str, str] | None:
    """Return namespace and name of an entry, which identify it in its list."""
    if not isinstance(entry, Mapping):
        return None
    name = entry.get("name") or entry.get("executable") or ""
    return str(entry.get("namespace", "")), str(name)


def _merge(base: Any, entry: Any) -> Any:
    """Return a mapping with the keys of both; mappings in it are merged in the same way."""
    if not (isinstance(base, Mapping) and isinstance(entry, Mapping)):
        return entry
    return {**base, **{key: _merge(base.get(key), value) for key, value in entry.items()}}


def _make_paths_absolute(content: dict[str, Any], path: pathlib.Path) -> None:
    """Make the paths of an extended file independent of the folder of the extending one."""
    folder = path.parent.resolve()
    for entry in _require_kind(content.get("arguments"), dict, path, "arguments").values():
        if isinstance(entry, dict) and entry.get("file") and "default" in entry:
            entry["default"] = str(folder / str(entry["default"]))
    for entry in _require_kind(content.get("nodes"), list, path, "nodes"):
        if isinstance(entry, dict) and isinstance(entry.get("parameter_files"), list):
            # A path that comes from an argument is absolute when it is resolved.
            entry["parameter_files"] = [
                text if str(text).startswith("${") else str(folder / str(text))
                for text in entry["parameter_files"]
            ]
