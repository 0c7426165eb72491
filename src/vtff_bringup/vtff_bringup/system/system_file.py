"""System files: which nodes a run consists of. One loader for `vtff run` and launch files.

A system file (``config/system/*.yaml``) has these keys:

``description``
    One line.
``extends``
    A system file, relative to this one, to which this one adds; see
    `vtff_bringup.system.extension`.
``arguments``
    What the command line may set with ``key:=value``: name -> ``default``,
    ``description``, ``file: true`` for a path relative to the system file.
``processes``
    Programs without ROS, started first: ``name``, ``package``, ``executable``,
    ``arguments``; ``when`` (argument -> value: start it only then) and ``sets``
    (argument -> new value, once it is started; an argument that was given on the command line
    keeps its value, unless ``when`` asks for it). They start with SIGINT and SIGTERM blocked and
    have to unblock them once their handlers are installed.
``nodes``
    ROS nodes: ``package``, ``executable``, ``name``, ``namespace``, ``parameters``,
    ``parameter_files``, ``remaps``, ``lockstep`` (participant | side_branch: it acknowledges
    each step; nodes between the simulator and the thruster need not, because the thrust that
    closes the loop comes after their work), ``prepares`` (the simulator starts only when the
    node has told on /sim/step_done that it is ready), ``ends_run`` (its orderly end is the end of
    the run), ``own_process`` (never composed).

``${name}`` stands for an argument, ``${scenario.a.b}`` for an entry of the scenario file,
and ``${run_directory}``, ``${free_port}``, ``${free_port.<any name>}`` (another one for each
name), ``${pacing}``, ``${seed}`` (of the run, else of the scenario), ``${nodes}`` (fully qualified
names of all nodes) and ``${vehicles}`` (SimGEN's vehicles, one for each spacecraft of the
scenario) for what the run provides.
"""

from __future__ import annotations

import contextlib
import dataclasses
import pathlib
import re
import socket
from collections.abc import Mapping, Sequence
from typing import Any

import yaml

from vtff_bringup.system.extension import SystemFileError, joined_system
from vtff_node.executables import ExecutableNotFoundError, share_folder

REFERENCE = re.compile(r"\$\{([A-Za-z_][\w.]*)\}")
LOCKSTEP_ROLES = ("participant", "side_branch")

SYSTEM_KEYS = {"description", "arguments", "processes", "nodes"}
ARGUMENT_KEYS = {"default", "description", "file"}
PROCESS_KEYS = {"name", "package", "executable", "arguments", "when", "sets"}
NODE_KEYS = {
    "package",
    "executable",
    "name",
    "namespace",
    "parameters",
    "parameter_files",
    "remaps",
    "lockstep",
    "prepares",
    "ends_run",
    "own_process",
}


@dataclasses.dataclass(frozen=True)
class ProcessDescription:
    """A program without ROS that belongs to a run."""

    name: str
    package: str
    executable: str
    arguments: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class NodeDescription:
    """A ROS node of a run, with everything resolved."""

    package: str
    executable: str
    name: str
    namespace: str
    parameters: dict[str, Any]
    parameter_files: tuple[pathlib.Path, ...]
    remaps: dict[str, str]
    lockstep: str
    prepares: bool
    ends_run: bool
    own_process: bool

    @property
    def qualified_name(self) -> str:
        """Fully qualified node name, e.g. ``/deputy/thruster``."""
        return f"{self.namespace.rstrip('/')}/{self.name}"

    def all_parameters(self) -> dict[str, Any]:
        """Return the parameters in force: those of the parameter files, then the node's own.

        Of a file count the sections ``/**`` and that of the node itself, as they stand in it.

        Raises
        ------
        SystemFileError
            If a parameter file cannot be read or has not the form of one.
        """
        values: dict[str, Any] = {}
        for path in self.parameter_files:
            for section, content in _read_yaml(path).items():
                names = ("**", self.name, self.qualified_name.strip("/"))
                if str(section).strip("/") in names:
                    values.update(_ros_parameters(path, section, content))
        return {**values, **self.parameters}

    def ros_arguments(self, parameter_file: pathlib.Path | None = None) -> list[str]:
        """Command line after the executable.

        Parameters
        ----------
        parameter_file
            File holding `parameters`; without it they are given one by one.
        """
        arguments = ["--ros-args", "-r", f"__node:={self.name}", "-r", f"__ns:={self.namespace}"]
        for path in self.parameter_files:
            arguments += ["--params-file", str(path)]
        if parameter_file is not None:
            arguments += ["--params-file", str(parameter_file)]
        else:
            for key, value in self.parameters.items():
                arguments += ["-p", f"{key}:={yaml.safe_dump(value, default_flow_style=True)}"]
        for source, target in self.remaps.items():
            arguments += ["-r", f"{source}:={target}"]
        return arguments


@dataclasses.dataclass(frozen=True)
class SystemDescription:
    """A system file with arguments and overrides applied."""

    path: pathlib.Path
    description: str
    arguments: dict[str, Any]
    processes: tuple[ProcessDescription, ...]
    nodes: tuple[NodeDescription, ...]

    @property
    def name(self) -> str:
        """Name of the system: its file name without ending."""
        return self.path.stem


@dataclasses.dataclass(frozen=True)
class RunSettings:
    """What a run provides to its system file."""

    run_directory: pathlib.Path
    pacing: str = "lockstep"
    duration: float | None = None
    seed: int | None = None


def parse_override(text: str) -> tuple[str, Any]:
    """Split ``key:=value``; the value is read as YAML.

    Raises
    ------
    SystemFileError
        If the text has not that form.
    """
    key, separator, value = text.partition(":=")
    if not separator or not key:
        raise SystemFileError(f"'{text}' is not of the form key:=value")
    try:
        return key.strip(), yaml.safe_load(value) if value.strip() else ""
    except yaml.YAMLError as error:
        raise SystemFileError(f"'{text}': the value is not valid YAML ({error})") from error


def find_system_file(name: str) -> pathlib.Path:
    """Return the system file of a name or path.

    Parameters
    ----------
    name
        A path, or the name of a file in ``config/system`` of this folder or of the installed
        package.

    Raises
    ------
    SystemFileError
        If there is none; the text lists the names there are.
    """
    path = pathlib.Path(name)
    if path.is_file():
        return path
    folders = [pathlib.Path("config/system")]
    with contextlib.suppress(ExecutableNotFoundError):
        folders.append(share_folder("vtff_bringup") / "config/system")
    for folder in folders:
        if (folder / f"{name}.yaml").is_file():
            return folder / f"{name}.yaml"
    known = sorted({file.stem for folder in folders for file in folder.glob("*.yaml")})
    raise SystemFileError(f"no system file '{name}'; there are: {', '.join(known) or 'none'}")


def load_system(
    path: pathlib.Path, overrides: Sequence[str] = (), settings: RunSettings | None = None
) -> SystemDescription:
    """Load a system file.

    Parameters
    ----------
    path
        The YAML file.
    overrides
        ``argument:=value`` or ``node.parameter:=value`` texts; with ``namespace/node`` for one
        of several nodes of the same name.
    settings
        What the run provides; launch files use the defaults.

    Raises
    ------
    SystemFileError
        Naming the file and the entry that is wrong.
    """
    settings = settings or RunSettings(run_directory=pathlib.Path.cwd())
    return _Loader(path, settings).load(overrides)


class _Loader:
    def __init__(self, path: pathlib.Path, settings: RunSettings) -> None:
        self._path = path
        self._settings = settings
        self._values: dict[str, Any] = {}
        self._scenario: dict[str, Any] | None = None

    def load(self, overrides: Sequence[str]) -> SystemDescription:
        content = joined_system(self._path, _read_yaml)
        self._check_keys(content, SYSTEM_KEYS, "system file")
        argument_entries = self._mapping(content, "arguments", "system file")
        process_entries = self._sequence(content, "processes", "system file")
        node_entries = self._sequence(content, "nodes", "system file")
        for number, entry in enumerate(node_entries, 1):
            self._check_node(entry, number)
        names = {entry.get("name") or entry["executable"] for entry in node_entries}
        argument_values, parameter_values = self._sort_overrides(
            overrides, set(argument_entries), names
        )
        self._values = {
            "run_directory": str(self._settings.run_directory),
            "pacing": self._settings.pacing,
            "free_port": _free_port(),
        }
        if self._settings.seed is not None:
            self._values["seed"] = self._settings.seed
        for name, entry in argument_entries.items():
            self._check_keys(entry, ARGUMENT_KEYS, f"argument '{name}'")
            self._values[name] = self._argument_value(name, entry, argument_values)
        processes = tuple(self._processes(process_entries, set(argument_values)))
        self._values["nodes"] = [self._qualified_name(entry) for entry in node_entries]
        nodes = self._with_run_parameters(
            [self._node(entry, parameter_values) for entry in node_entries]
        )
        if not nodes:
            raise SystemFileError(f"{self._path}: no nodes")
        places = {node.qualified_name.strip("/") for node in nodes}
        for name in parameter_values:
            if "/" in name and name not in places:
                known = ", ".join(sorted(places))
                raise SystemFileError(f"{self._path.name} has no node '{name}'; known: {known}")
        return SystemDescription(
            path=self._path,
            description=str(content.get("description", "")),
            arguments={name: self._values[name] for name in argument_entries},
            processes=processes,
            nodes=tuple(nodes),
        )

    def _sort_overrides(
        self, overrides: Sequence[str], arguments: set[str], nodes: set[Any]
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        argument_values: dict[str, Any] = {}
        parameter_values: dict[str, dict[str, Any]] = {}
        for text in overrides:
            key, value = parse_override(text)
            node, _, parameter = key.partition(".")
            if key in arguments:
                argument_values[key] = value
            elif parameter and node.rpartition("/")[2] in nodes:
                parameter_values.setdefault(node, {})[parameter] = value
            else:
                known = sorted(arguments) + [f"{name}.<parameter>" for name in sorted(nodes)]
                raise SystemFileError(
                    f"'{text}': {self._path.name} has no argument or node '{node}'; "
                    f"known: {', '.join(known)}"
                )
        return argument_values, parameter_values

    def _argument_value(self, name: str, entry: Mapping[str, Any], given: dict[str, Any]) -> Any:
        if name in given:
            value, base = given[name], pathlib.Path.cwd()
        elif "default" in entry:
            value, base = entry["default"], self._path.parent
        else:
            raise SystemFileError(
                f"{self._path.name} needs '{name}' ({entry.get('description', '')}): "
                f"give it as {name}:=..."
            )
        if not entry.get("file"):
            return value
        file = (base / str(value)).resolve()
        if not file.is_file():
            raise SystemFileError(f"argument '{name}': no file '{value}' (looked at {file})")
        return str(file)

    def _processes(
        self, entries: Sequence[Mapping[str, Any]], given: set[str]
    ) -> list[ProcessDescription]:
        processes = []
        for number, entry in enumerate(entries, 1):
            where = self._where("process", entry, number)
            self._check_keys(entry, PROCESS_KEYS, where, needed=("name", "package", "executable"))
            self._check_texts(entry, ("name", "package", "executable"), where)
            conditions = self._mapping(entry, "when", where)
            if any(str(self._values.get(key)) != str(value) for key, value in conditions.items()):
                continue
            for key, value in self._mapping(entry, "sets", where).items():
                if key in conditions or key not in given:
                    self._values[key] = self._resolve(value, where)
            arguments = self._resolve(self._sequence(entry, "arguments", where), where)
            processes.append(
                ProcessDescription(
                    name=entry["name"],
                    package=entry["package"],
                    executable=entry["executable"],
                    arguments=tuple(
                        str(item)
                        for argument in arguments
                        for item in (argument if isinstance(argument, list) else [argument])
                    ),
                )
            )
        return processes

    def _node(
        self, entry: Mapping[str, Any], overrides: Mapping[str, Mapping[str, Any]]
    ) -> NodeDescription:
        name = entry.get("name") or entry["executable"]
        where = f"node '{name}'"
        role = entry.get("lockstep", "")
        if role and role not in LOCKSTEP_ROLES:
            raise SystemFileError(
                f"{self._path}: {where}: lockstep is '{role}'; choose {' or '.join(LOCKSTEP_ROLES)}"
            )
        parameters = self._resolve(dict(self._mapping(entry, "parameters", where)), where)
        qualified_name = self._qualified_name(entry)
        parameters.update(overrides.get(str(name), {}))
        parameters.update(overrides.get(qualified_name.strip("/"), {}))
        files = []
        for text in self._sequence(entry, "parameter_files", where):
            file = (self._path.parent / str(self._resolve(text, where))).resolve()
            if not file.is_file():
                raise SystemFileError(f"{self._path}: {where}: no parameter file {file}")
            files.append(file)
        return NodeDescription(
            package=entry["package"],
            executable=entry["executable"],
            name=str(name),
            namespace=self._namespace(entry),
            parameters=parameters,
            parameter_files=tuple(files),
            remaps=self._remaps(entry, where),
            lockstep=role,
            prepares=bool(entry.get("prepares", False)),
            ends_run=bool(entry.get("ends_run", False)),
            own_process=bool(entry.get("own_process", False)),
        )

    def _remaps(self, entry: Mapping[str, Any], where: str) -> dict[str, str]:
        remaps = self._resolve(dict(self._mapping(entry, "remaps", where)), where)
        for source, target in remaps.items():
            if not isinstance(target, str):
                raise SystemFileError(
                    f"{self._path}: {where}: remap '{source}' must be a name, not {target!r}"
                )
        return dict(remaps)

    def _namespace(self, entry: Mapping[str, Any]) -> str:
        return "/" + str(self._resolve(entry.get("namespace", ""), "namespace")).strip("/")

    def _qualified_name(self, entry: Mapping[str, Any]) -> str:
        name = entry.get("name") or entry["executable"]
        return f"{self._namespace(entry).rstrip('/')}/{name}"

    def _with_run_parameters(self, nodes: list[NodeDescription]) -> list[NodeDescription]:
        """Tell every node of the pacing, and the node that ends the run who takes part."""
        lockstep = self._settings.pacing == "lockstep"
        roles: dict[str, list[str]] = {role: [] for role in LOCKSTEP_ROLES}
        for node in nodes:
            if node.lockstep:
                roles[node.lockstep].append(node.qualified_name)
        preparing = [node.qualified_name for node in nodes if node.prepares]
        complete = []
        for node in nodes:
            added: dict[str, Any] = {"lockstep": lockstep}
            added["acknowledge_steps"] = lockstep and bool(node.lockstep)
            if node.prepares:
                added["reports_ready"] = True
            if node.ends_run and preparing:
                added["lockstep_preparing"] = preparing
            if node.ends_run:
                added["lockstep_participants"] = roles["participant"] if lockstep else []
                added["lockstep_side_branches"] = roles["side_branch"] if lockstep else []
                others = [other.qualified_name for other in nodes if other is not node]
                added["expected_nodes"] = others
                if self._settings.duration is not None:
                    added["duration"] = float(self._settings.duration)
                if self._settings.seed is not None:
                    added["seed"] = int(self._settings.seed)
            complete.append(dataclasses.replace(node, parameters={**added, **node.parameters}))
        return complete

    def _resolve(self, value: Any, where: str) -> Any:
        if isinstance(value, dict):
            return {key: self._resolve(item, where) for key, item in value.items()}
        if isinstance(value, list):
            return [self._resolve(item, where) for item in value]
        if not isinstance(value, str):
            return value
        whole = REFERENCE.fullmatch(value)
        if whole:
            return self._look_up(whole.group(1), where)
        return REFERENCE.sub(lambda match: str(self._look_up(match.group(1), where)), value)

    def _look_up(self, name: str, where: str) -> Any:
        if name in self._values:
            return self._values[name]
        if name.startswith("free_port."):
            return self._values.setdefault(name, _free_port())
        if name == "seed" and "scenario" in self._values:
            return self._look_up_scenario("scenario.seed", where)
        if name == "vehicles" and "scenario" in self._values:
            # SimGEN's vehicles in the order of the scenario's spacecraft.
            spacecraft = self._look_up_scenario("scenario.spacecraft", where)
            return [f"v{number}_m1" for number in range(1, len(spacecraft) + 1)]
        if name.startswith("scenario.") and "scenario" in self._values:
            return self._look_up_scenario(name, where)
        known = ", ".join(sorted(self._values))
        raise SystemFileError(f"{self._path}: {where}: unknown ${{{name}}}; known: {known}")

    def _look_up_scenario(self, name: str, where: str) -> Any:
        if self._scenario is None:
            self._scenario = _read_yaml(pathlib.Path(str(self._values["scenario"])))
        entry: Any = self._scenario
        for key in name.split(".")[1:]:
            if isinstance(entry, list):  # e.g. scenario.spacecraft.deputy: the item of that name
                entry = {item.get("name"): item for item in entry if isinstance(item, dict)}
            if not isinstance(entry, dict) or key not in entry:
                raise SystemFileError(
                    f"{self._path}: {where}: {self._values['scenario']} has no "
                    f"'{name.removeprefix('scenario.')}'"
                )
            entry = entry[key]
        return entry

    def _mapping(self, entry: Mapping[str, Any], key: str, where: str) -> dict[str, Any]:
        """Return the mapping under a key with text as keys; empty if it is absent."""
        content = entry.get(key)
        if content is None:
            return {}
        if not isinstance(content, dict) or not all(isinstance(name, str) for name in content):
            raise SystemFileError(
                f"{self._path}: {where}: '{key}' must be a mapping of names to values, "
                f"not {content!r}"
            )
        return content

    def _sequence(self, entry: Mapping[str, Any], key: str, where: str) -> list[Any]:
        """Return the list under a key; empty if it is absent."""
        content = entry.get(key)
        if content is None:
            return []
        if not isinstance(content, list):
            raise SystemFileError(f"{self._path}: {where}: '{key}' must be a list, not {content!r}")
        return content

    def _check_node(self, entry: Any, number: int) -> None:
        where = self._where("node", entry, number)
        self._check_keys(entry, NODE_KEYS, where, needed=("package", "executable"))
        self._check_texts(entry, ("package", "executable", "name", "namespace"), where)

    def _check_texts(self, entry: Mapping[str, Any], keys: Sequence[str], where: str) -> None:
        for key in keys:
            if not isinstance(entry.get(key) or "", str):
                raise SystemFileError(
                    f"{self._path}: {where}: '{key}' must be a text, not {entry[key]!r}"
                )

    @staticmethod
    def _where(kind: str, entry: Any, number: int) -> str:
        """Name an entry of a list: by its own name, or by its place where it has none."""
        name = (entry.get("name") or entry.get("executable")) if isinstance(entry, dict) else None
        return f"{kind} '{name}'" if isinstance(name, str) else f"{kind} {number}"

    def _check_keys(
        self, entry: Any, known: set[str], where: str, needed: Sequence[str] = ()
    ) -> None:
        if not isinstance(entry, Mapping):
            raise SystemFileError(
                f"{self._path}: {where} must be a mapping of keys to values, not {entry!r}"
            )
        unknown = sorted(str(key) for key in entry if key not in known)
        if unknown:
            raise SystemFileError(
                f"{self._path}: {where}: unknown key '{unknown[0]}'; known: "
                f"{', '.join(sorted(known))}"
            )
        for key in needed:
            if not entry.get(key):
                raise SystemFileError(f"{self._path}: {where}: '{key}' is missing")


def _read_yaml(path: pathlib.Path) -> dict[str, Any]:
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SystemFileError(f"cannot read {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise SystemFileError(f"{path} is not a text file: {error}") from error
    except yaml.YAMLError as error:
        raise SystemFileError(f"{path} is not valid YAML: {error}") from error
    if not isinstance(content, dict):
        raise SystemFileError(f"{path} is empty or not a mapping")
    return content


def _ros_parameters(path: pathlib.Path, section: object, content: object) -> dict[str, Any]:
    """Return the parameters of one section of a ROS parameter file."""
    if content is None:
        return {}
    parameters = content.get("ros__parameters") if isinstance(content, dict) else None
    if not isinstance(parameters, dict):
        raise SystemFileError(f"{path}: '{section}' has no mapping 'ros__parameters'")
    return parameters


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
