"""Plan with which a worker flies any case of a campaign, and the changes of a case."""

from __future__ import annotations

import copy
import re
from collections.abc import Mapping, MutableMapping
from dataclasses import dataclass
from typing import Any

from vtff_bringup.campaign.cases import Case
from vtff_node.plain_yaml import format_yaml

__all__ = ["FileContent", "FlightPlan", "case_files", "case_overrides", "override", "set_entry"]


@dataclass(frozen=True)
class FileContent:
    """Content of a YAML file that cases change.

    Attributes
    ----------
    name
        Name of the file, for messages and comments.
    fields
        Its content; paths of other files in it are absolute.
    """

    name: str
    fields: Any


@dataclass(frozen=True)
class FlightPlan:
    """The part of a campaign that all cases share, as workers get it.

    Attributes
    ----------
    campaign
        Name of the campaign.
    loop
        ``run`` or ``library``.
    system
        Name or path of the system file.
    overrides
        ``key:=value`` texts that are the same in every case.
    files
        Content by argument, of the files of which a case changes entries; entries under
        ``fixed`` are in force already.
    controller, thruster
        With ``library``: every parameter of these nodes.
    controller_name, thruster_name
        With ``library``: names of these nodes in keys.
    duration
        Scenario seconds; None as the scenario says.
    timeout
        Wall seconds after which a case counts as hanging.
    composed
        Whether the nodes of a run share one process.
    figures
        Names of the figures to keep.
    version
        Version of vtff that the campaign was started with.
    folder
        Folder of the campaign.
    keep
        Which run folders stay: ``bags`` all, ``failed`` those of failed cases, ``none``.
    """

    campaign: str
    loop: str
    system: str
    overrides: tuple[str, ...]
    files: Mapping[str, FileContent]
    controller: Mapping[str, Any]
    thruster: Mapping[str, Any]
    controller_name: str
    thruster_name: str
    duration: float | None
    timeout: float
    composed: bool
    figures: tuple[str, ...]
    version: str
    folder: str
    keep: str


def case_files(plan: FlightPlan, case: Case) -> dict[str, FileContent]:
    """Return the content by argument of the files of a case.

    Raises
    ------
    LookupError
        If an entry that the case sets is not there; the text names it.
    """
    files = {}
    for argument, file in plan.files.items():
        prefix = f"{argument}."
        fields = copy.deepcopy(file.fields)
        for key, value in case.settings.items():
            if key.startswith(prefix):
                set_entry(fields, key.removeprefix(prefix), value)
        files[argument] = FileContent(file.name, fields)
    return files


def case_overrides(plan: FlightPlan, case: Case) -> list[str]:
    """Return the ``key:=value`` texts of a case, without those of its files."""
    prefixes = tuple(f"{argument}." for argument in plan.files)
    own = [override(k, v) for k, v in case.settings.items() if not k.startswith(prefixes or "\n")]
    return [*plan.overrides, *own]


def override(key: str, value: Any) -> str:
    """Return ``key:=value`` with the value as YAML on one line, to its last digit."""
    return f"{key}:={format_yaml(value, on_one_line=True)}"


def set_entry(fields: Any, path: str, value: Any) -> None:
    """Set an entry of a file's content.

    Parameters
    ----------
    fields
        Content of the file; changed.
    path
        Names with dots between; an item of a list is named by its ``name`` or by its index. The
        last name of a mapping may be new, all before it must be there.
    value
        New value.

    Raises
    ------
    LookupError
        If there is no such entry; the text names it.
    """
    *before, last = path.split(".")
    entry = fields
    for count, name in enumerate(before, 1):
        entry = _entry(entry, name, ".".join(before[:count]))
    if isinstance(entry, MutableMapping):
        entry[last] = copy.deepcopy(value)
    elif isinstance(entry, list):
        entry[_index(entry, last, path)] = copy.deepcopy(value)
    else:
        raise LookupError(f"there is no entry '{path}'")


def _entry(entry: Any, name: str, path: str) -> Any:
    if isinstance(entry, list):
        return entry[_index(entry, name, path)]
    if isinstance(entry, Mapping) and name in entry:
        return entry[name]
    raise LookupError(f"there is no entry '{path}'")


def _index(items: list[Any], name: str, path: str) -> int:
    """Return the index of an item that is named by its index or by its ``name``."""
    if re.fullmatch("[0-9]+", name) and int(name) < len(items):
        return int(name)
    for index, item in enumerate(items):
        if isinstance(item, Mapping) and item.get("name") == name:
            return index
    raise LookupError(f"there is no entry '{path}'")
