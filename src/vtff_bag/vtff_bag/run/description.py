"""Description of a run: system, arguments, versions, parameters and scenario.

`vtff run` writes ``run.json`` and ``parameters/`` into the run folder. The recorder copies both,
with the scenario file and the versions, into the custom data of the bag, so that a bag without its
run folder still has the description.
"""

from __future__ import annotations

import dataclasses
import json
import pathlib
from collections.abc import Mapping
from typing import Any

from vtff_node.plain_yaml import PlainYamlError, parse_yaml

RUN_FILE = "run.json"
PARAMETER_FOLDER = "parameters"

#: Keys of the run file that are no arguments: they differ between equal runs, and so stay out of
#: the bag. ROS domain; on several hosts, the one that wrote the folder and by how much the clocks
#: of others are ahead; in real time, steps that began late and the largest delay of one in s.
MEASURED_KEYS = ("ros_domain_id", "host", "clock_offsets_s", "late_steps", "largest_lag_s")

#: Keys of the bag's custom data.
ARGUMENTS_KEY = "run"
ENVIRONMENT_KEY = "environment"
SCENARIO_KEY = "scenario"
PARAMETERS_PREFIX = "parameters/"

SCENARIO_PARAMETER = "scenario_file"

#: Key of the run file under which the command stands that makes the run again.
COMMAND_KEY = "command"


@dataclasses.dataclass(frozen=True)
class RunDescription:
    """System, arguments, environment, parameters and scenario of a run.

    Attributes
    ----------
    arguments
        The arguments of the run, with the name of the system under ``system``.
    command
        The command that makes the run again; empty if it is not recorded.
    environment
        Versions and machine, with the keys of docs/summary.md; empty if they are unknown.
    parameter_texts
        ROS parameter files as YAML texts, by the name of the node.
    scenario_text
        The scenario file as YAML text; empty if the run had none.
    """

    arguments: dict[str, Any] = dataclasses.field(default_factory=dict)
    command: str = ""
    environment: dict[str, Any] = dataclasses.field(default_factory=dict)
    parameter_texts: dict[str, str] = dataclasses.field(default_factory=dict)
    scenario_text: str = ""

    def as_custom_data(self, run_directory: str = "", current_folder: str = "") -> dict[str, str]:
        """Return the texts that the recorder writes into the metadata of the bag.

        Parameters
        ----------
        run_directory, current_folder
            Absolute paths; the first is written as ``${run_directory}``, the second is left out.
            A bag may be read on another machine, and equal runs shall have equal texts.
        """
        texts = {
            f"{PARAMETERS_PREFIX}{name}": text
            for name, text in sorted(self.parameter_texts.items())
        }
        if self.arguments:
            texts[ARGUMENTS_KEY] = json.dumps(self.arguments, default=str)
        if self.command:
            texts[COMMAND_KEY] = self.command
        if self.environment:
            texts[ENVIRONMENT_KEY] = json.dumps(self.environment, default=str)
        if self.scenario_text:
            texts[SCENARIO_KEY] = self.scenario_text
        return {
            key: _without_paths(text, run_directory, current_folder) for key, text in texts.items()
        }


def _without_paths(text: str, run_directory: str, current_folder: str) -> str:
    """Return a text without the paths of this machine."""
    if run_directory.count("/") > 1:
        text = text.replace(run_directory, "${run_directory}")
    if current_folder.count("/") > 1:
        text = text.replace(f"{current_folder}/", "")
    return text


def write_arguments(
    run_directory: pathlib.Path, arguments: Mapping[str, Any], measured: Mapping[str, Any]
) -> None:
    """Write system, arguments and command into the run folder.

    Parameters
    ----------
    run_directory
        The folder; made if it does not exist.
    arguments
        Arguments of the run, with the name of the system under ``system`` and the command that
        makes the run again under `COMMAND_KEY`.
    measured
        How the run goes on this machine, with keys of `MEASURED_KEYS`.

    Raises
    ------
    OSError
        If the folder cannot be written.
    """
    run_directory.mkdir(parents=True, exist_ok=True)
    text = json.dumps({**arguments, **measured}, indent=1, default=str)
    (run_directory / RUN_FILE).write_text(text + "\n", encoding="utf-8")


def add_measured(run_directory: pathlib.Path, measured: Mapping[str, Any]) -> None:
    """Add what was measured, with keys of `MEASURED_KEYS`, to the run file.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    content = _parse_mapping(_read_text(run_directory / RUN_FILE))
    write_arguments(run_directory, content, measured)


def describe_run_folder(run_directory: pathlib.Path) -> RunDescription:
    """Return the description in the files of a run folder, without unreadable files."""
    parameters = {
        path.stem: text
        for path in sorted((run_directory / PARAMETER_FOLDER).glob("*.yaml"))
        if (text := _read_text(path))
    }
    content = _parse_mapping(_read_text(run_directory / RUN_FILE))
    return RunDescription(
        arguments={
            key: value for key, value in content.items() if key not in (*MEASURED_KEYS, COMMAND_KEY)
        },
        command=str(content.get(COMMAND_KEY, "")),
        parameter_texts=parameters,
        scenario_text=_read_scenario(parameters.values()),
    )


def describe_from_bag(custom_data: Mapping[str, str]) -> RunDescription:
    """Return the description in the custom data of a bag."""
    return RunDescription(
        arguments=_parse_mapping(custom_data.get(ARGUMENTS_KEY, "")),
        command=custom_data.get(COMMAND_KEY, ""),
        environment=_parse_mapping(custom_data.get(ENVIRONMENT_KEY, "")),
        parameter_texts={
            key.removeprefix(PARAMETERS_PREFIX): text
            for key, text in custom_data.items()
            if key.startswith(PARAMETERS_PREFIX)
        },
        scenario_text=custom_data.get(SCENARIO_KEY, ""),
    )


def describe_run(run_directory: pathlib.Path, custom_data: Mapping[str, str]) -> RunDescription:
    """Return the description of a run; texts that stand in both come from the folder.

    Environment and scenario come from the bag first: the folder does not keep them.
    """
    folder, bag = describe_run_folder(run_directory), describe_from_bag(custom_data)
    return RunDescription(
        arguments=folder.arguments or bag.arguments,
        command=folder.command or bag.command,
        environment=bag.environment,
        parameter_texts=folder.parameter_texts or bag.parameter_texts,
        scenario_text=bag.scenario_text or folder.scenario_text,
    )


def _read_scenario(parameter_texts: Any) -> str:
    """Return the text of the scenario file that a parameter of a node names; empty without one."""
    for text in parameter_texts:
        for values in node_parameters(text).values():
            if SCENARIO_PARAMETER in values:
                return _read_text(pathlib.Path(str(values[SCENARIO_PARAMETER])))
    return ""


def node_parameters(text: str) -> dict[str, Mapping[str, Any]]:
    """Return the parameters by node of a ROS parameter file; empty for any other text."""
    try:
        content = parse_yaml(text)
    except PlainYamlError:
        return {}
    if not isinstance(content, Mapping):
        return {}
    sections = {
        str(node): section.get("ros__parameters")
        for node, section in content.items()
        if isinstance(section, Mapping)
    }
    return {node: values for node, values in sections.items() if isinstance(values, Mapping)}


def _read_text(path: pathlib.Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError, ValueError):
        return ""


def _parse_mapping(text: str) -> dict[str, Any]:
    try:
        content = json.loads(text) if text else {}
    except ValueError:
        return {}
    return content if isinstance(content, dict) else {}
