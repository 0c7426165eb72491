"""References in a system file: ``${name}`` stands for an argument or a value of the run."""

from __future__ import annotations

import pathlib
import re
import socket
from typing import Any

from vtff_bringup.system.errors import SystemFileError
from vtff_bringup.system.yaml_file import read_mapping

__all__ = ["References", "free_port"]

REFERENCE = re.compile(r"\$\{([A-Za-z_][\w.]*)\}")
INNER_REFERENCE = re.compile(r"(\$\{[\w.]*)\$\{([A-Za-z_][\w.]*)\}")  # one within another


class References:
    """Values of the references of one system file.

    Parameters
    ----------
    path
        The system file, for messages.
    values
        Values by name; arguments are added while the file is read.
    """

    def __init__(self, path: pathlib.Path, values: dict[str, Any]) -> None:
        self.values = values
        self._path = path
        self._scenario: dict[str, Any] | None = None

    def resolve(self, value: Any, where: str) -> Any:
        """Return a value with its references replaced, also in lists and mappings.

        A text that is one reference becomes the value itself; within a longer text a reference
        becomes text.

        Parameters
        ----------
        value
            Value in the system file.
        where
            Entry that the value belongs to, for messages.

        Raises
        ------
        SystemFileError
            If a reference has no value.
        """
        if isinstance(value, dict):
            return {key: self.resolve(item, where) for key, item in value.items()}
        if isinstance(value, list):
            return [self.resolve(item, where) for item in value]
        if not isinstance(value, str):
            return value
        while INNER_REFERENCE.search(value):
            value = INNER_REFERENCE.sub(
                lambda match: match.group(1) + str(self._look_up(match.group(2), where)), value
            )
        whole = REFERENCE.fullmatch(value)
        if whole:
            return self._look_up(whole.group(1), where)
        return REFERENCE.sub(lambda match: str(self._look_up(match.group(1), where)), value)

    def _look_up(self, name: str, where: str) -> Any:
        if name in self.values:
            return self.values[name]
        if name.startswith("free_port."):
            return self.values.setdefault(name, free_port())
        if name == "seed" and "scenario" in self.values:
            return self._look_up_scenario("scenario.seed", where)
        if name == "vehicles" and "scenario" in self.values:
            # SimGEN's vehicles are in the order of the scenario's spacecraft.
            spacecraft = self._look_up_scenario("scenario.spacecraft", where)
            return [f"v{number}_m1" for number in range(1, len(spacecraft) + 1)]
        if name.startswith("scenario.") and "scenario" in self.values:
            return self._look_up_scenario(name, where)
        names = ", ".join(sorted(self.values))
        raise SystemFileError(f"{self._path}: {where}: unknown ${{{name}}}; known: {names}")

    def _look_up_scenario(self, name: str, where: str) -> Any:
        if self._scenario is None:
            self._scenario = read_mapping(pathlib.Path(str(self.values["scenario"])))
        entry: Any = self._scenario
        for key in name.split(".")[1:]:
            if isinstance(entry, list):  # scenario.spacecraft.deputy: the item of that name
                entry = {str(item.get("name")): item for item in entry if isinstance(item, dict)}
            if not isinstance(entry, dict) or key not in entry:
                raise SystemFileError(
                    f"{self._path}: {where}: {self.values['scenario']} has no "
                    f"'{name.removeprefix('scenario.')}'"
                )
            entry = entry[key]
        return entry


def free_port() -> int:
    """Return a TCP port of this machine that no program listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
