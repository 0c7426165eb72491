"""References in a system file: ``${name}`` stands for an argument or a value of the run."""

from __future__ import annotations

import pathlib
import re
from typing import Any

from vtff_bringup.system.errors import SystemFileError
from vtff_bringup.system.free_ports import choose_free_port
from vtff_bringup.system.yaml_file import read_mapping, resolve_file
from vtff_sim_bridge.truth.repeated_spacecraft import repeat_spacecraft
from vtff_sim_bridge.truth.scenario_fields import DEFAULT_HARD_RADIUS, ScenarioError

__all__ = ["DEPUTY", "SPACECRAFT", "References"]

REFERENCE = re.compile(r"\$\{([A-Za-z_][\w.]*)\}")
INNER_REFERENCE = re.compile(r"(\$\{[\w.]*)\$\{([A-Za-z_][\w.]*)\}")  # one within another
SPACECRAFT, DEPUTY = "spacecraft", "deputy"
NUMBER_OF_DEPUTIES = "number_of_deputies"


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
        self._each: dict[str, str] = {}

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
            return [
                references.resolve(item, where)
                for item in value
                for references in self._references_of_item(item, where)
            ]
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

    def _references_of_item(self, item: Any, where: str) -> list[References]:
        """Return one for each spacecraft or deputy if the text of a list names them, else these."""
        for kind in (SPACECRAFT, DEPUTY):
            if isinstance(item, str) and f"${{{kind}}}" in item and kind not in self._each:
                return self.for_each(kind, where)
        return [self]

    def for_each(self, kind: str, where: str) -> list[References]:
        """Return the references of each spacecraft or deputy of the scenario.

        In them ``${spacecraft}`` or ``${deputy}`` is the name, and ``${deputy.target...}`` an entry
        of that spacecraft in the scenario file.

        Parameters
        ----------
        kind
            ``spacecraft`` or ``deputy``.
        where
            Entry that is repeated, for messages.

        Raises
        ------
        SystemFileError
            If there is no scenario that lists the spacecraft.
        """
        names = self.spacecraft_names(where)[kind == DEPUTY :]
        each = []
        for name in names:
            references = References(self._path, self.values)
            references._scenario, references._each = self._scenario, {kind: name}
            each.append(references)
        return each

    @property
    def craft(self) -> str:
        """Name of the spacecraft that these references are of; empty outside of `for_each`."""
        return next(iter(self._each.values()), "")

    def spacecraft_names(self, where: str) -> list[str]:
        """Return the names of the spacecraft of the scenario, the chief first.

        Raises
        ------
        SystemFileError
            If there is no scenario that lists the spacecraft.
        """
        if "scenario" not in self.values:
            raise SystemFileError(f"{self._path}: {where}: there is no argument 'scenario'")
        entries = self._look_up_scenario("scenario.spacecraft", where)
        names = [str(entry.get("name")) for entry in entries if isinstance(entry, dict)]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice or not names or len(names) < len(entries):
            problem = f"'{twice[0]}' is listed twice" if twice else "names of all are needed"
            raise SystemFileError(f"{self.values['scenario']}: spacecraft: {problem}")
        return names

    def _look_up(self, name: str, where: str) -> Any:
        kind, _, entry = name.partition(".")
        if kind in self._each:
            craft = self._each[kind]
            if not entry:
                return craft
            return self._look_up_scenario(f"scenario.spacecraft.{craft}.{entry}", where)
        if name in self.values:
            return self.values[name]
        if name.startswith("free_port."):
            taken = [
                port for key, port in self.values.items() if key.partition(".")[0] == "free_port"
            ]
            return self.values.setdefault(name, choose_free_port(taken))
        if "scenario" in self.values:
            if name == "seed":
                return self._look_up_scenario("scenario.seed", where)
            if name == "vehicles":
                # SimGEN's vehicles are in the order of the scenario's spacecraft.
                count = len(self.spacecraft_names(where))
                return [f"v{number}_m1" for number in range(1, count + 1)]
            if name == "chief":
                return self.spacecraft_names(where)[0]
            if name == "deputies":
                chief, *deputies = self.spacecraft_names(where)
                if not deputies:
                    raise SystemFileError(
                        f"{self.values['scenario']}: spacecraft: a deputy or more expected beside "
                        f"'{chief}'"
                    )
                return deputies
            if name.startswith("scenario."):
                return self._look_up_scenario(name, where)
        names = ", ".join(sorted({*self.values, *self._each}))
        raise SystemFileError(f"{self._path}: {where}: unknown ${{{name}}}; known: {names}")

    def _read_scenario(self) -> dict[str, Any]:
        path = pathlib.Path(str(self.values["scenario"]))
        resolve_file(path.parent, path.name)
        number = self.values.get(NUMBER_OF_DEPUTIES) or 0
        if isinstance(number, bool) or not isinstance(number, int):
            raise SystemFileError(
                f"{self._path}: '{NUMBER_OF_DEPUTIES}': a whole number expected, got {number!r}"
            )
        try:
            scenario: dict[str, Any] = repeat_spacecraft(read_mapping(path), str(path), number)
            return {"hard_radius": DEFAULT_HARD_RADIUS, **scenario}
        except ScenarioError as error:
            raise SystemFileError(str(error)) from error

    def _look_up_scenario(self, name: str, where: str) -> Any:
        if self._scenario is None:
            self._scenario = self._read_scenario()
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
