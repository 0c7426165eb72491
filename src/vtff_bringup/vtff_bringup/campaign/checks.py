"""Every check of a campaign against its system before anything is flown; makes the flight plan."""

from __future__ import annotations

import dataclasses
import difflib
import importlib.metadata
import math
import os
import pathlib
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from vtff_analysis.studies.figures import figure_problem
from vtff_bringup.campaign.campaign_file import Campaign, CampaignError
from vtff_bringup.campaign.cases import Case
from vtff_bringup.campaign.library_flight import (
    CONTROLLER_PARAMETERS,
    THRUSTER_PARAMETERS,
    fly_library_case,
)
from vtff_bringup.campaign.plan import (
    FileContent,
    FlightPlan,
    case_files,
    case_overrides,
    override,
    set_entry,
)
from vtff_bringup.system.description import NodeDescription, RunSettings, SystemDescription
from vtff_bringup.system.errors import SystemFileError
from vtff_bringup.system.extension import join_system
from vtff_bringup.system.system_file import find_system_file, load_system
from vtff_bringup.system.yaml_file import read_mapping, resolve_file
from vtff_node.executables import ExecutableNotFoundError, node_class
from vtff_node.node import CommonParameters
from vtff_node.parameters import ParameterError, check
from vtff_node.plain_yaml import format_yaml
from vtff_sim_bridge.gnss.configuration import load_gnss_configuration
from vtff_sim_bridge.truth.scenario import read_scenario
from vtff_sim_bridge.truth.scenario_fields import ScenarioError, read_yaml

__all__ = ["plan_flights"]

_LIBRARY_NODES = frozenset({"simgen_bridge", "sdre_controller", "thruster_model", "bag_recorder"})
"""Nodes of a system that the closed loop without ROS can fly."""

_START_ALLOWANCE = 300.0
"""s of the default time-out beside the duration: a case slower than real time hangs."""


def plan_flights(
    campaign: Campaign, cases: Sequence[Case], folder: pathlib.Path, keep: str
) -> FlightPlan:
    """Check a campaign and return what its workers need.

    Parameters
    ----------
    campaign
        As read from its file.
    cases
        Its cases.
    folder, keep
        See `FlightPlan`.

    Raises
    ------
    CampaignError
        If a key, a parameter, a value, a figure or a file is wrong; one line.
    """
    return _Planner(campaign, cases).plan(folder, keep)


class _Planner:
    def __init__(self, campaign: Campaign, cases: Sequence[Case]) -> None:
        self._campaign = campaign
        self._cases = cases
        self._base = campaign.path.parent
        # Field of the campaign file by the key that it sets.
        self._places = {key: f"fixed.{key}" for key in campaign.fixed}
        for variable in campaign.variables:
            for key in variable.keys:
                if key in self._places:
                    raise campaign.error(
                        f"vary.{variable.name}", f"'{key}' stands under 'fixed' as well"
                    )
                self._places[key] = f"vary.{variable.name}"

    def plan(self, folder: pathlib.Path, keep: str) -> FlightPlan:
        system_file = self._system_file()
        arguments = self._arguments(system_file)
        file_arguments = {name for name, entry in arguments.items() if entry.get("file")}
        in_files = [key for key in self._places if self._is_in_file(key, file_arguments)]
        fixed = {
            key: self._absolute(key, value) if key in file_arguments else value
            for key, value in self._campaign.fixed.items()
        }
        overrides = [override(k, v) for k, v in fixed.items() if k not in in_files]
        system = self._load(system_file, overrides)
        self._check_keys(system, arguments, in_files)
        if self._campaign.loop == "library":
            self._check_library(system)
        files = self._files(system, in_files, file_arguments)
        duration = self._campaign.duration
        self._check_duration(files, system)
        plan = FlightPlan(
            campaign=self._campaign.name,
            loop=self._campaign.loop,
            system=self._portable_name(system_file),
            overrides=tuple(overrides),
            files=files,
            controller={},
            thruster={},
            controller_name="",
            thruster_name="",
            duration=duration,
            timeout=self._timeout(files, system, duration),
            composed=self._campaign.composed,
            figures=self._campaign.figures,
            version=importlib.metadata.version("vtff_bringup"),
            folder=str(folder),
            keep=keep,
        )
        self._check_values(plan, system)
        self._check_figures(plan, system)
        if self._campaign.loop == "library":
            self._check_library_keys(system)
            plan = self._library_plan(plan, system)
            self._try_library(plan)
        return plan

    def _system_file(self) -> pathlib.Path:
        beside = self._base / self._campaign.system
        if os.path.isfile(beside):
            return beside.resolve()
        try:
            return find_system_file(self._campaign.system).resolve()
        except SystemFileError as error:
            raise self._campaign.error("system", str(error)) from None

    def _arguments(self, system_file: pathlib.Path) -> dict[str, Any]:
        """Return the entries of the arguments of a system file by name."""
        try:
            return dict(join_system(system_file, read_mapping).get("arguments") or {})
        except SystemFileError as error:
            raise self._campaign.error("system", str(error)) from None

    def _portable_name(self, system_file: pathlib.Path) -> str:
        """Return the name of a system of vtff, which any worker finds, else the absolute path."""
        try:
            if find_system_file(system_file.stem).resolve() == system_file:
                return system_file.stem
        except SystemFileError:
            pass
        return str(system_file)

    def _is_in_file(self, key: str, file_arguments: set[str]) -> bool:
        argument, dot, _ = key.partition(".")
        return bool(dot) and argument in file_arguments

    def _absolute(self, key: str, value: Any) -> str:
        try:
            file = resolve_file(self._base, value)
        except SystemFileError as error:
            raise self._campaign.error(f"fixed.{key}", str(error)) from None
        if not os.path.isfile(file):
            raise self._campaign.error(f"fixed.{key}", f"no file '{value}' (looked at {file})")
        return str(file)

    def _load(self, system_file: pathlib.Path, overrides: Sequence[str]) -> SystemDescription:
        with tempfile.TemporaryDirectory() as folder:
            settings = RunSettings(pathlib.Path(folder), duration=self._campaign.duration, seed=1)
            try:
                return load_system(system_file, overrides, settings)
            except SystemFileError as error:
                for key, place in self._places.items():
                    if f"'{override(key, self._campaign.fixed.get(key))}'" in str(error):
                        raise self._campaign.error(place, str(error)) from None
                raise self._campaign.error("", str(error)) from None

    def _check_keys(
        self, system: SystemDescription, arguments: Mapping[str, Any], in_files: Sequence[str]
    ) -> None:
        names = {node.name for node in system.nodes}
        names |= {node.qualified_name.strip("/") for node in system.nodes}
        for key, place in self._places.items():
            node, dot, _ = key.partition(".")
            if key in in_files or key in arguments or (dot and node in names):
                continue
            choices = sorted(arguments) + [f"{name}.<parameter>" for name in sorted(names)]
            raise self._campaign.error(
                place,
                f"{system.path.name} has no argument or node '{node}'; there are: "
                f"{', '.join(choices)}",
            )

    def _files(
        self, system: SystemDescription, in_files: Sequence[str], file_arguments: set[str]
    ) -> dict[str, FileContent]:
        files = {}
        needed = {key.partition(".")[0] for key in in_files}
        if self._campaign.loop == "library":
            needed |= {"scenario"} & file_arguments
        for argument in sorted(needed):
            if argument not in _READERS:
                key = next(key for key in in_files if key.startswith(f"{argument}."))
                raise self._campaign.error(
                    self._places[key],
                    f"entries of '{argument}' cannot be set, only those of: "
                    f"{', '.join(sorted(_READERS))}",
                )
            path = pathlib.Path(str(system.arguments[argument]))
            try:
                fields = _with_absolute_paths(read_yaml(path), path.parent)
            except ScenarioError as error:
                raise self._campaign.error("", str(error)) from None
            for key, value in self._campaign.fixed.items():
                if key in in_files and key.startswith(f"{argument}."):
                    try:
                        set_entry(fields, key.removeprefix(f"{argument}."), value)
                    except LookupError as error:
                        raise self._campaign.error(f"fixed.{key}", str(error)) from None
            files[argument] = FileContent(path.name, fields)
            _read_checked(self._campaign, argument, files[argument], "fixed")
        return files

    def _timeout(
        self, files: Mapping[str, FileContent], system: SystemDescription, duration: float | None
    ) -> float:
        if self._campaign.timeout is not None:
            return self._campaign.timeout
        if duration is None and "scenario" in system.arguments:
            fields = (
                files["scenario"].fields
                if "scenario" in files
                else read_yaml(pathlib.Path(str(system.arguments["scenario"])))
            )
            duration = float(fields.get("duration", 0.0))
        return _START_ALLOWANCE + (duration or 0.0)

    def _check_duration(self, files: Mapping[str, FileContent], system: SystemDescription) -> None:
        """Check the campaign's duration against the step of the scenario."""
        if self._campaign.duration is None or "scenario" not in system.arguments:
            return
        path = pathlib.Path(str(system.arguments["scenario"]))
        fields = files["scenario"].fields if "scenario" in files else read_yaml(path)
        try:
            scenario = read_scenario(fields, path.name)
            dataclasses.replace(scenario, duration=self._campaign.duration)
        except ValueError as error:
            raise self._campaign.error("", str(error)) from None

    def _check_values(self, plan: FlightPlan, system: SystemDescription) -> None:
        """Check the first case, and every value of a list and the ends of a distribution in it."""
        tables = {node.qualified_name: _tables(self._campaign, node) for node in system.nodes}

        def check_case(place: str, case: Case) -> None:
            for node in system.nodes:
                self._check_parameters(node, tables[node.qualified_name], case, place)
            try:
                files = case_files(plan, case)
            except LookupError as error:
                raise self._campaign.error(place, str(error)) from None
            for argument, content in files.items():
                _read_checked(self._campaign, argument, content, place)

        first = self._cases[0]
        try:
            check_case("vary", first)
        except CampaignError:
            # By which variable alone? Where it is none, they do not go together.
            for variable in self._campaign.variables:
                settings = {key: first.settings[key] for key in variable.keys}
                alone = dataclasses.replace(first, settings=settings)
                check_case(f"vary.{variable.name}", alone)
            raise
        for place, case in self._trials():
            check_case(place, case)
        self._load(system.path, case_overrides(plan, first))

    def _trials(self) -> Iterator[tuple[str, Case]]:
        """Yield cases that differ from the first in one variable, with the field it stands in."""
        first = self._cases[0]
        for variable in self._campaign.variables:
            place = f"vary.{variable.name}"
            values = list(variable.values)
            if variable.distribution is not None:
                flown = [case.inputs[variable.name] for case in self._cases]
                values = [min(flown), max(flown)]
            for value in values:
                settings = {**first.settings, **dict.fromkeys(variable.keys, value)}
                yield place, dataclasses.replace(first, settings=settings)

    def _check_parameters(
        self, node: NodeDescription, tables: Sequence[type], case: Case, place: str
    ) -> None:
        names = (node.name, node.qualified_name.strip("/"))
        values = node.all_parameters()
        for key, value in {**self._campaign.fixed, **case.settings}.items():
            owner, dot, name = key.partition(".")
            if dot and owner in names:
                fields = {f.name: f for table in tables for f in dataclasses.fields(table)}
                problem = _parameter_problem(node, fields, name, value)
                if problem:
                    raise self._campaign.error(self._places[key], problem)
                values[name] = value
        for table in tables:
            _filled(self._campaign, table, values, place)

    def _check_figures(self, plan: FlightPlan, system: SystemDescription) -> None:
        spacecraft, deputies = [], []
        if "scenario" in system.arguments:
            fields = read_yaml(pathlib.Path(str(system.arguments["scenario"])))
            spacecraft = [craft["name"] for craft in fields["spacecraft"]]
            deputies = spacecraft[1:]
        for figure in plan.figures:
            library = plan.loop == "library"
            problem = figure_problem(figure, spacecraft, deputies, library=library)
            if problem:
                raise self._campaign.error("figures", problem)

    def _check_library(self, system: SystemDescription) -> None:
        """Check that the closed loop without ROS can fly the system."""
        for node in system.nodes:
            if node.executable not in _LIBRARY_NODES:
                raise self._campaign.error(
                    "loop",
                    f"library flies truth, controller and thruster alone, but "
                    f"{system.path.name} has the node '{node.name}'",
                )
        self._library_nodes(system)

    def _check_library_keys(self, system: SystemDescription) -> None:
        """Check that the closed loop without ROS can set every key."""
        controller, thruster = self._library_nodes(system)
        allowed = {controller.name: CONTROLLER_PARAMETERS, thruster.name: THRUSTER_PARAMETERS}
        for key, place in self._places.items():
            owner, _, name = key.partition(".")
            if owner == "scenario" or name in allowed.get(owner.rpartition("/")[2], ()):
                continue
            raise self._campaign.error(place, f"loop library cannot set '{key}'")

    def _library_nodes(self, system: SystemDescription) -> tuple[NodeDescription, NodeDescription]:
        """Return the controller and the thruster of a system that has one of each."""
        controllers = [node for node in system.nodes if node.executable == "sdre_controller"]
        thrusters = [node for node in system.nodes if node.executable == "thruster_model"]
        if len(controllers) != 1 or len(thrusters) != 1:
            raise self._campaign.error("loop", "library needs one sdre_controller and one thruster")
        return controllers[0], thrusters[0]

    def _library_plan(self, plan: FlightPlan, system: SystemDescription) -> FlightPlan:
        controller, thruster = self._library_nodes(system)
        return dataclasses.replace(
            plan,
            controller=self._parameters(controller),
            thruster=self._parameters(thruster),
            controller_name=controller.name,
            thruster_name=thruster.name,
        )

    def _parameters(self, node: NodeDescription) -> dict[str, Any]:
        """Return every parameter of a node, given or by default."""
        values = node.all_parameters()
        filled = [_filled(self._campaign, t, values, "") for t in _tables(self._campaign, node)]
        return {
            name: value for table in filled for name, value in dataclasses.asdict(table).items()
        }

    def _try_library(self, plan: FlightPlan) -> None:
        """Fly two steps of the first case: values that the closed loop refuses are refused now."""
        scenario = read_scenario(plan.files["scenario"].fields, plan.files["scenario"].name)
        try:
            short = dataclasses.replace(plan, duration=2.0 * scenario.step)
            fly_library_case(short, self._cases[0])
        except ValueError as error:
            raise self._campaign.error("", str(error)) from None


def _tables(campaign: Campaign, node: NodeDescription) -> list[type]:
    """Return the parameter tables of a node's class."""
    try:
        own = node_class(node.package, node.executable).Parameters
    except (ExecutableNotFoundError, ImportError) as error:
        raise campaign.error("system", str(error)) from error
    return [CommonParameters, *([] if own is None else [own])]


def _filled(campaign: Campaign, table: type, values: Mapping[str, Any], place: str) -> Any:
    """Return a parameter table with values in it, checked as the node checks it."""
    names = {field.name for field in dataclasses.fields(table)}
    try:
        return table(**{name: value for name, value in values.items() if name in names})
    except (ParameterError, ValueError) as error:
        raise campaign.error(place, str(error)) from None


def _parameter_problem(
    node: NodeDescription, fields: Mapping[str, Any], name: str, value: Any
) -> str:
    """Tell what is wrong with a value of a node's parameter; empty if nothing is."""
    if name not in fields:
        near = difflib.get_close_matches(name, fields, n=3) or sorted(fields)
        return f"node '{node.name}' has no parameter '{name}'; did you mean: {', '.join(near)}?"
    kind = str(fields[name].type)
    if not _TYPES[kind](value):
        return f"parameter '{name}' is {value!r}; its type is {kind}"
    try:
        check(name, fields[name], value)
    except ParameterError as error:
        return str(error)
    return ""


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _list_of(is_item: Callable[[Any], bool]) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, list) and all(map(is_item, value))


_TYPES: dict[str, Callable[[Any], bool]] = {
    "bool": lambda value: isinstance(value, bool),
    "int": _is_whole,
    "float": _is_number,
    "str": lambda value: isinstance(value, str),
    "list[float]": _list_of(_is_number),
    "list[int]": _list_of(_is_whole),
    "list[str]": _list_of(lambda value: isinstance(value, str)),
}


def _with_absolute_paths(content: Any, folder: pathlib.Path) -> Any:
    """Return a file's content in which the paths of existing files are absolute."""
    if isinstance(content, dict):
        return {key: _with_absolute_paths(value, folder) for key, value in content.items()}
    if isinstance(content, list):
        return [_with_absolute_paths(value, folder) for value in content]
    if isinstance(content, str) and "/" in content and os.path.isfile(folder / content):
        return str((folder / content).resolve())
    return content


def _read_checked(campaign: Campaign, argument: str, content: FileContent, place: str) -> None:
    try:
        _READERS[argument](content)
    except (ScenarioError, ValueError) as error:
        raise campaign.error(place, str(error)) from None


def _read_scenario(content: FileContent) -> None:
    read_scenario(content.fields, content.name)


def _read_gnss(content: FileContent) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / content.name
        path.write_text(format_yaml(content.fields), encoding="utf-8")
        try:
            load_gnss_configuration(path)
        except ValueError as error:
            raise ValueError(str(error).replace(str(path), content.name)) from None


_READERS: dict[str, Callable[[FileContent], None]] = {
    "scenario": _read_scenario,
    "gnss": _read_gnss,
}
"""Readers of the files whose entries a campaign can set, by argument."""
