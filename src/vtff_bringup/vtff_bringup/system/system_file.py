"""System files: the processes and nodes of a run, for `vtff run` and for launch files.

A system file (``config/system/*.yaml``) has these keys:

``description``
    One line.
``extends``
    A system file, relative to this one, to which this one adds; see
    `vtff_bringup.system.extension`.
``arguments``
    Values that the command line may set with ``key:=value``: name -> ``default``,
    ``description``, ``file: true`` for a path relative to the system file, ``file: receiver_log``
    for one that must hold NovAtel logs.
``processes``
    Programs without ROS, started first: ``name``, ``package``, ``executable``,
    ``arguments``; ``when`` (argument -> value: the program starts only if the argument has this
    value) and ``sets`` (argument -> new value if the program starts; an argument that was given on
    the command line keeps its value, unless ``when`` asks for it). Programs start with SIGINT and
    SIGTERM blocked and have to unblock them once their handlers are installed.
``nodes``
    ROS nodes: ``for_each`` (spacecraft | deputy, also of a process: one for each of them in the
    scenario, see below), ``package``, ``executable``, ``name``, ``namespace``, ``parameters``,
    ``parameter_files``, ``remaps``, ``lockstep`` (participant | side_branch: the node acknowledges
    each step; nodes between the simulator and the thruster need not, because the thrust that
    closes the loop comes after their work), ``prepares`` (the simulator starts only after the
    node has said on /sim/step_done that it is ready), ``ends_run`` (the orderly end of the node is
    the end of the run), ``own_process`` (the node is never composed).

``hosts``
    Machines of a run on several machines: name -> IPv4 address of an interface; an empty one
    leaves the machine out. A node or process with ``host`` runs there, the others on that of the
    node that ends the run. See docs/hosts.md.
``control_port``
    TCP and UDP port of the main host by which the parts of a run agree.

An entry with ``for_each: spacecraft`` or ``for_each: deputy`` stands for one node or process for
each of them; ``${spacecraft}`` or ``${deputy}`` is the name there, and ``${deputy.a.b}`` an entry
of that spacecraft in the scenario. A key of ``arguments``, ``hosts`` or ``sets``, or a text in a
list, with ``${spacecraft}`` or ``${deputy}`` in it stands for one for each. ``${chief}`` and
``${deputies}`` are the names of the chief and of all deputies everywhere.

``${name}`` stands for an argument, ``${scenario.a.b}`` for an entry of the scenario file,
``${hosts.name}`` for the address of a host,
and ``${run_directory}``, ``${free_port}``, ``${free_port.<any name>}`` (another one for each
name), ``${pacing}``, ``${seed}`` (of the run, else of the scenario), ``${nodes}`` (fully qualified
names of all nodes) and ``${vehicles}`` (SimGEN's vehicles, one for each spacecraft of the
scenario) for what the run provides.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

from vtff_bringup.system.description import (
    NodeDescription,
    ProcessDescription,
    RunSettings,
    SystemDescription,
)
from vtff_bringup.system.entries import PLAIN_NAME, EntryReader, describe_entry
from vtff_bringup.system.errors import SystemFileError
from vtff_bringup.system.extension import join_system
from vtff_bringup.system.free_ports import choose_free_port
from vtff_bringup.system.overrides import parse_override, sort_overrides
from vtff_bringup.system.placement import DEFAULT_CONTROL_PORT, place_on_hosts, read_hosts
from vtff_bringup.system.references import (
    DEPUTY,
    NUMBER_OF_DEPUTIES,
    SPACECRAFT,
    References,
)
from vtff_bringup.system.yaml_file import read_mapping, resolve_file
from vtff_gnss.files.observation_files import ObservationFileError, check_receiver_log
from vtff_node.executables import ExecutableNotFoundError, share_folder

__all__ = ["find_system_file", "list_settable", "load_system"]

FOR_EACH = (SPACECRAFT, DEPUTY)
LOCKSTEP_ROLES = ("participant", "side_branch")

SYSTEM_KEYS = {"description", "arguments", "hosts", "control_port", "processes", "nodes"}
ARGUMENT_KEYS = {"default", "description", "file"}
PROCESS_KEYS = {"for_each", "host", "name", "package", "executable", "arguments", "when", "sets"}
#: Value of the key `file` of an argument whose file must hold NovAtel logs.
RECEIVER_LOG = "receiver_log"
NODE_KEYS = {
    "for_each",
    "host",
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
        If there is no such file; the text lists the names of all system files.
    """
    path = pathlib.Path(name)
    if os.path.isfile(path):
        return path
    folders = [pathlib.Path("config/system")]
    with contextlib.suppress(ExecutableNotFoundError):
        folders.append(share_folder("vtff_bringup") / "config/system")
    for folder in folders:
        if os.path.isfile(folder / f"{name}.yaml"):
            return folder / f"{name}.yaml"
    names = sorted({file.stem for folder in folders for file in folder.glob("*.yaml")})
    raise SystemFileError(f"no system file '{name}'; there are: {', '.join(names) or 'none'}")


def load_system(
    path: pathlib.Path, overrides: Sequence[str] = (), settings: RunSettings | None = None
) -> SystemDescription:
    """Load a system file.

    Parameters
    ----------
    path
        The YAML file.
    overrides
        ``argument:=value`` or ``node.parameter:=value`` texts; ``namespace/node.parameter`` names
        one of several nodes of the same name.
    settings
        Settings of the run; lockstep in the current folder if they are not given.

    Raises
    ------
    SystemFileError
        If the file or an override is wrong; the text names the file and the entry.
    """
    settings = settings or RunSettings(run_directory=pathlib.Path.cwd())
    return _Loader(path, settings).load(overrides)


def list_settable(path: pathlib.Path) -> tuple[list[str], dict[str, Mapping[str, Any]]]:
    """Return what an override may name: arguments, and the entries of the nodes by their names.

    Arguments that must be given need not be.

    Raises
    ------
    SystemFileError
        If the file is wrong.
    """
    return _Loader(path, RunSettings(run_directory=pathlib.Path.cwd())).list_settable()


class _Loader:
    """Reads one system file."""

    def __init__(self, path: pathlib.Path, settings: RunSettings) -> None:
        self._path = path
        self._settings = settings
        self._entries = EntryReader(path)
        values: dict[str, Any] = {
            "run_directory": str(settings.run_directory),
            "pacing": settings.pacing,
            "free_port": choose_free_port(),
            **settings.free_ports,
        }
        if settings.seed is not None:
            values["seed"] = settings.seed
        self._references = References(path, values)

    def list_settable(self) -> tuple[list[str], dict[str, Mapping[str, Any]]]:
        content = join_system(self._path, read_mapping)
        arguments = self._entries.mapping(content, "arguments", "system file")
        nodes = self._entries.sequence(content, "nodes", "system file")
        for number, entry in enumerate(nodes, 1):
            self._check_node(entry, number)
        by_name = {entry.get("name") or entry["executable"]: entry for entry in nodes}
        return list(self._expand_arguments(arguments, ())), by_name

    def load(self, overrides: Sequence[str]) -> SystemDescription:
        content = join_system(self._path, read_mapping)
        self._entries.check_keys(content, SYSTEM_KEYS, "system file")
        argument_entries = self._entries.mapping(content, "arguments", "system file")
        process_entries = self._entries.sequence(content, "processes", "system file")
        node_entries = self._entries.sequence(content, "nodes", "system file")
        for number, entry in enumerate(node_entries, 1):
            self._check_node(entry, number)
        names = {entry.get("name") or entry["executable"] for entry in node_entries}
        argument_entries = self._expand_arguments(argument_entries, overrides)
        argument_values, parameter_values = sort_overrides(
            overrides, set(argument_entries), names, self._path.name
        )
        values = self._references.values
        for name, entry in argument_entries.items():
            values[name] = self._argument_value(name, entry, argument_values)
        declared_hosts = self._expand_keys(
            self._entries.mapping(content, "hosts", "system file"), "hosts"
        )
        addresses = read_hosts(self._path, declared_hosts, self._references)
        processes = tuple(self._read_processes(process_entries, set(argument_values)))
        each_node = [
            (entry, references)
            for entry in node_entries
            for references in self._references_of(entry, _describe_node(entry))
        ]
        values["nodes"] = [self._qualified_name(*node) for node in each_node]
        nodes = self._add_run_parameters(
            [self._read_node(*node, parameter_values) for node in each_node]
        )
        if not nodes:
            raise SystemFileError(f"{self._path}: no nodes")
        self._check_unique(nodes)
        node_names = {node.qualified_name.strip("/") for node in nodes}
        for name in parameter_values:
            if "/" in name and name not in node_names:
                known = ", ".join(sorted(node_names))
                raise SystemFileError(f"{self._path.name} has no node '{name}'; known: {known}")
        hosts, placed_nodes, placed_processes = place_on_hosts(
            self._path, declared_hosts, addresses, nodes, processes
        )
        return SystemDescription(
            path=self._path,
            description=str(content.get("description", "")),
            arguments={name: values[name] for name in argument_entries},
            processes=placed_processes,
            nodes=placed_nodes,
            hosts=hosts,
            control_port=self._control_port(content),
            free_ports={
                name: port for name, port in values.items() if name.split(".")[0] == "free_port"
            },
        )

    def _control_port(self, content: Mapping[str, Any]) -> int:
        port = self._references.resolve(
            content.get("control_port", DEFAULT_CONTROL_PORT), "system file"
        )
        if not isinstance(port, int) or not 0 < port < 65536:
            raise SystemFileError(f"{self._path}: control_port must be 1 to 65535, not {port!r}")
        return port

    def _references_of(self, entry: Mapping[str, Any], where: str) -> list[References]:
        """Return the references of an entry: one, or one for each spacecraft or deputy."""
        kind = entry.get("for_each")
        if kind is None:
            return [self._references]
        if kind not in FOR_EACH:
            raise SystemFileError(
                f"{self._path}: {where}: for_each is '{kind}'; choose {' or '.join(FOR_EACH)}"
            )
        return self._references.for_each(kind, where)

    def _check_unique(self, nodes: Sequence[NodeDescription]) -> None:
        names = [node.qualified_name for node in nodes]
        for name in names:
            if names.count(name) > 1:
                raise SystemFileError(f"{self._path}: two nodes have the name '{name}'")

    def _expand_keys(self, mapping: Mapping[str, Any], where: str) -> dict[str, Any]:
        """Return a mapping whose keys with ``${spacecraft}`` or ``${deputy}`` are one for each."""
        expanded: dict[str, Any] = {}
        for key, value in mapping.items():
            kinds = [kind for kind in FOR_EACH if f"${{{kind}}}" in key]
            if not kinds:
                expanded[key] = value
                continue
            for references in self._references.for_each(kinds[0], where):
                name = str(references.resolve(key, where))
                if name in expanded:
                    raise SystemFileError(f"{self._path}: {where}: '{name}' is given twice")
                expanded[name] = _with_craft(value, kinds[0], references.craft)
        return expanded

    def _expand_arguments(
        self, entries: Mapping[str, Any], overrides: Sequence[str]
    ) -> dict[str, Any]:
        """Return the arguments with those of each spacecraft; they need the scenario."""
        given = dict(parse_override(text) for text in overrides)
        for name, entry in entries.items():
            self._entries.check_keys(entry, ARGUMENT_KEYS, f"argument '{name}'")
        if any("${" in name for name in entries):
            for name in ("scenario", NUMBER_OF_DEPUTIES):
                if name in entries:
                    self._references.values[name] = self._argument_value(name, entries[name], given)
        return self._expand_keys(entries, "arguments")

    def _argument_value(self, name: str, entry: Mapping[str, Any], given: dict[str, Any]) -> Any:
        if name in given:
            value, base = given[name], pathlib.Path.cwd()
        elif "default" in entry:
            where = f"argument '{name}'"
            value = self._references.resolve(entry["default"], where)
            base = self._path.parent
        else:
            raise SystemFileError(
                f"{self._path.name} needs '{name}' ({entry.get('description', '')}): "
                f"give it as {name}:=..."
            )
        if not entry.get("file"):
            return value
        file = resolve_file(base, value)
        if not os.path.isfile(file):
            raise SystemFileError(f"argument '{name}': no file '{value}' (looked at {file})")
        if entry["file"] == RECEIVER_LOG:
            _check_receiver_log(name, file)
        return str(file)

    def _read_processes(
        self, entries: Sequence[Mapping[str, Any]], given: set[str]
    ) -> list[ProcessDescription]:
        processes = []
        values = self._references.values
        for number, entry in enumerate(entries, 1):
            where = describe_entry("process", entry, number)
            self._entries.check_keys(
                entry, PROCESS_KEYS, where, needed=("name", "package", "executable")
            )
            self._entries.check_texts(entry, ("name", "package", "executable", "host"), where)
            self._entries.check_names(entry, ("name", "package"), where)
            self._entries.check_executable(entry, where)
            conditions = self._entries.mapping(entry, "when", where)
            if any(str(values.get(key)) != str(value) for key, value in conditions.items()):
                continue
            changes = self._expand_keys(self._entries.mapping(entry, "sets", where), where)
            for key, value in changes.items():
                if key in conditions or key not in given:
                    values[key] = self._references.resolve(value, where)
            for references in self._references_of(entry, where):
                prefix = f"{references.craft}__" if references.craft else ""
                arguments = references.resolve(
                    self._entries.sequence(entry, "arguments", where), where
                )
                processes.append(
                    ProcessDescription(
                        name=f"{prefix}{entry['name']}",
                        package=entry["package"],
                        executable=entry["executable"],
                        host=str(references.resolve(entry.get("host") or "", where)),
                        arguments=tuple(
                            str(item)
                            for argument in arguments
                            for item in (argument if isinstance(argument, list) else [argument])
                        ),
                    )
                )
        return processes

    def _read_node(
        self,
        entry: Mapping[str, Any],
        references: References,
        overrides: Mapping[str, Mapping[str, Any]],
    ) -> NodeDescription:
        name = entry.get("name") or entry["executable"]
        where = _describe_node(entry)
        role = entry.get("lockstep", "")
        if role and role not in LOCKSTEP_ROLES:
            raise SystemFileError(
                f"{self._path}: {where}: lockstep is '{role}'; choose {' or '.join(LOCKSTEP_ROLES)}"
            )
        parameters = references.resolve(
            dict(self._entries.mapping(entry, "parameters", where)), where
        )
        qualified_name = self._qualified_name(entry, references)
        parameters.update(overrides.get(str(name), {}))
        parameters.update(overrides.get(qualified_name.strip("/"), {}))
        files = []
        for text in self._entries.sequence(entry, "parameter_files", where):
            file = resolve_file(self._path.parent, references.resolve(text, where))
            if not os.path.isfile(file):
                raise SystemFileError(f"{self._path}: {where}: no parameter file {file}")
            files.append(file)
        return NodeDescription(
            package=entry["package"],
            executable=entry["executable"],
            name=str(name),
            namespace=self._namespace(entry, references),
            parameters=parameters,
            parameter_files=tuple(files),
            remaps=self._read_remaps(entry, references, where),
            lockstep=role,
            prepares=bool(entry.get("prepares", False)),
            ends_run=bool(entry.get("ends_run", False)),
            own_process=bool(entry.get("own_process", False)),
            host=str(references.resolve(entry.get("host") or "", where)),
        )

    def _read_remaps(
        self, entry: Mapping[str, Any], references: References, where: str
    ) -> dict[str, str]:
        remaps = references.resolve(dict(self._entries.mapping(entry, "remaps", where)), where)
        for source, target in remaps.items():
            if not isinstance(target, str):
                raise SystemFileError(
                    f"{self._path}: {where}: remap '{source}' must be a name, not {target!r}"
                )
        return dict(remaps)

    def _namespace(self, entry: Mapping[str, Any], references: References) -> str:
        where = _describe_node(entry)
        given = str(references.resolve(entry.get("namespace") or "", where))
        namespace = given.strip("/")
        if namespace and not all(PLAIN_NAME.fullmatch(name) for name in namespace.split("/")):
            raise SystemFileError(
                f"{self._path}: {where}: 'namespace' must be names of letters, digits and '_' "
                f"with '/' between them, not {given!r}"
            )
        return f"/{namespace}"

    def _qualified_name(self, entry: Mapping[str, Any], references: References) -> str:
        name = entry.get("name") or entry["executable"]
        return f"{self._namespace(entry, references).rstrip('/')}/{name}"

    def _add_run_parameters(self, nodes: list[NodeDescription]) -> list[NodeDescription]:
        """Add the pacing to each node, and the names of all others to the one that ends the run."""
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
                if self._settings.max_lag is not None:
                    added["max_lag"] = float(self._settings.max_lag)
            complete.append(dataclasses.replace(node, parameters={**added, **node.parameters}))
        return complete

    def _check_node(self, entry: Any, number: int) -> None:
        where = describe_entry("node", entry, number)
        self._entries.check_keys(entry, NODE_KEYS, where, needed=("package", "executable"))
        self._entries.check_texts(
            entry, ("package", "executable", "name", "namespace", "host"), where
        )
        # Without a name the node is called like its executable.
        named = ("package", "name") if entry.get("name") else ("package", "executable")
        self._entries.check_names(entry, named, where)
        self._entries.check_executable(entry, where)


def _describe_node(entry: Mapping[str, Any]) -> str:
    return f"node '{entry.get('name') or entry['executable']}'"


def _with_craft(value: Any, kind: str, craft: str) -> Any:
    """Return a value with ``${spacecraft}`` or ``${deputy}`` replaced by a name."""
    if isinstance(value, dict):
        return {key: _with_craft(item, kind, craft) for key, item in value.items()}
    return value.replace(f"${{{kind}}}", craft) if isinstance(value, str) else value


def _check_receiver_log(argument: str, file: pathlib.Path) -> None:
    try:
        check_receiver_log(file)
    except ObservationFileError as error:
        raise SystemFileError(f"argument '{argument}': {error}") from None
    except OSError as error:
        raise SystemFileError(f"argument '{argument}': {file}: {error.strerror}") from None
