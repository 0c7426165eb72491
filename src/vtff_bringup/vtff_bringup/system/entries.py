"""Checks of the entries of a system file: their keys and the form of their values."""

from __future__ import annotations

import pathlib
import re
from collections.abc import Mapping, Sequence
from typing import Any

from vtff_bringup.system.errors import SystemFileError

__all__ = ["EntryReader", "describe_entry"]

PLAIN_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
PLAIN_FILE = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")


def describe_entry(kind: str, entry: Any, number: int) -> str:
    """Return how messages name an entry of a list: by its name, or by its number without one."""
    name = (entry.get("name") or entry.get("executable")) if isinstance(entry, dict) else None
    return f"{kind} '{name}'" if isinstance(name, str) else f"{kind} {number}"


class EntryReader:
    """Reads values of entries, and refuses those of another form.

    In all methods `where` is the description of the entry in messages.

    Parameters
    ----------
    path
        The system file, for messages.
    """

    def __init__(self, path: pathlib.Path) -> None:
        self._path = path

    def mapping(self, entry: Mapping[str, Any], key: str, where: str) -> dict[str, Any]:
        """Return the mapping under a key with text as keys; empty if it is absent.

        Raises
        ------
        SystemFileError
            If another value stands under the key.
        """
        content = entry.get(key)
        if content is None:
            return {}
        if not isinstance(content, dict) or not all(isinstance(name, str) for name in content):
            raise SystemFileError(
                f"{self._path}: {where}: '{key}' must be a mapping of names to values, "
                f"not {content!r}"
            )
        return content

    def sequence(self, entry: Mapping[str, Any], key: str, where: str) -> list[Any]:
        """Return the list under a key; empty if it is absent.

        Raises
        ------
        SystemFileError
            If another value stands under the key.
        """
        content = entry.get(key)
        if content is None:
            return []
        if not isinstance(content, list):
            raise SystemFileError(f"{self._path}: {where}: '{key}' must be a list, not {content!r}")
        return content

    def check_texts(self, entry: Mapping[str, Any], keys: Sequence[str], where: str) -> None:
        """Raise SystemFileError unless the values under these keys are texts or absent."""
        for key in keys:
            value = entry.get(key)
            if value is not None and not isinstance(value, str):
                raise SystemFileError(
                    f"{self._path}: {where}: '{key}' must be a text, not {entry[key]!r}"
                )

    def check_names(self, entry: Mapping[str, Any], keys: Sequence[str], where: str) -> None:
        """Raise SystemFileError unless the texts under these keys are plain names or absent.

        Names become parts of file names and ROS names: letters, digits and ``_``, no digit first.
        """
        for key in keys:
            name = entry.get(key)
            if name and not PLAIN_NAME.fullmatch(name):
                raise SystemFileError(
                    f"{self._path}: {where}: '{key}' must be letters, digits and '_', not {name!r}"
                )

    def check_executable(self, entry: Mapping[str, Any], where: str) -> None:
        """Raise SystemFileError unless ``executable`` names a file in the folder of its package."""
        if not PLAIN_FILE.fullmatch(entry["executable"]):
            raise SystemFileError(
                f"{self._path}: {where}: 'executable' must be the name of a program of the "
                f"package, not {entry['executable']!r}"
            )

    def check_keys(
        self, entry: Any, allowed: set[str], where: str, needed: Sequence[str] = ()
    ) -> None:
        """Raise SystemFileError unless an entry is a mapping with allowed and all needed keys."""
        if not isinstance(entry, Mapping):
            raise SystemFileError(
                f"{self._path}: {where} must be a mapping of keys to values, not {entry!r}"
            )
        unknown = sorted(str(key) for key in entry if key not in allowed)
        if unknown:
            raise SystemFileError(
                f"{self._path}: {where}: unknown key '{unknown[0]}'; known: "
                f"{', '.join(sorted(allowed))}"
            )
        for key in needed:
            if not entry.get(key):
                raise SystemFileError(f"{self._path}: {where}: '{key}' is missing")
