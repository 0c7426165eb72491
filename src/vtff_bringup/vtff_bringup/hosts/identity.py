"""What the parts of a run must have in common: the version of vtff and the system file."""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.util
import json
import pathlib
from collections.abc import Iterator, Mapping
from typing import Any

from vtff_bringup.system.description import SystemDescription
from vtff_node.executables import ExecutableNotFoundError, share_folder
from vtff_node.plain_yaml import PlainYamlError, parse_yaml

__all__ = ["describe_difference", "digest_system", "version_text"]

DIGEST_LENGTH = 12  # hexadecimal digits that are compared and shown


def version_text() -> str:
    """Return version and digest of the installed packages of vtff, e.g. ``0.1.0 (1f3a...)``.

    The digest covers the Python modules and the message definitions, so that two states of one
    version under development differ.
    """
    digest = hashlib.sha256()
    for path, name in sorted(_sources(), key=lambda item: item[1]):
        digest.update(name.encode() + b"\0" + path.read_bytes() + b"\0")
    version = importlib.metadata.version("vtff_bringup")
    return f"{version} (sources {digest.hexdigest()[:DIGEST_LENGTH]})"


def _sources() -> Iterator[tuple[pathlib.Path, str]]:
    names = {
        str(distribution.metadata["Name"]).replace("-", "_")
        for distribution in importlib.metadata.distributions()
    }
    for package in sorted(name for name in names if name.startswith("vtff_")):
        spec = importlib.util.find_spec(package)
        for folder in (spec.submodule_search_locations or []) if spec is not None else []:
            if package == "vtff_msgs":  # generated from the definitions below
                continue
            for path in pathlib.Path(folder).rglob("*.py"):
                yield path, f"{package}/{path.relative_to(folder)}"
    try:
        definitions = share_folder("vtff_msgs")
    except ExecutableNotFoundError:
        return
    for kind in ("msg", "srv", "action"):
        for path in (definitions / kind).glob(f"*.{kind}"):
            yield path, f"vtff_msgs/{path.name}"


def digest_system(description: SystemDescription, run_directory: pathlib.Path) -> dict[str, str]:
    """Return one digest for each part of a resolved system file.

    Files count by their content, whatever folder they are in on this machine; so do the files that
    a YAML file names.

    Parameters
    ----------
    description
        The system, loaded with the arguments and ports of the main host.
    run_directory
        Run folder on this host.
    """
    parts: dict[str, Any] = {
        f"argument {name}": value for name, value in description.arguments.items()
    }
    for host in description.hosts:
        parts[f"host {host.name}"] = host.address
    for process in description.processes:
        content = [process.package, process.executable, process.arguments, process.host]
        parts[f"process {process.name}"] = content
    for node in description.nodes:
        parts[f"node {node.qualified_name}"] = [
            node.package, node.executable, node.host, node.lockstep, node.prepares,
            node.ends_run, node.own_process, sorted(node.remaps.items()),
            sorted(node.parameters.items()), [str(file) for file in node.parameter_files],
        ]  # fmt: skip
    return {
        name: _digest(_without_paths(content, str(run_directory)))
        for name, content in parts.items()
    }


def describe_difference(main: Mapping[str, str], other: Mapping[str, str]) -> str:
    """Return the first part in which two systems differ; empty if they are equal."""
    names = [*main, *(name for name in other if name not in main)]
    return next((name for name in names if main.get(name) != other.get(name)), "")


def _without_paths(value: Any, run_directory: str) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_paths(item, run_directory) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_without_paths(item, run_directory) for item in value]
    if not isinstance(value, str):
        return value
    text = value.replace(run_directory, "${run_directory}")
    if text.startswith("/") and pathlib.Path(text).is_file():
        return _describe_file(pathlib.Path(text))
    return text


def _describe_file(path: pathlib.Path) -> list[Any]:
    content = path.read_bytes()
    described: list[Any] = [path.name, hashlib.sha256(content).hexdigest()]
    if path.suffix in (".yaml", ".yml"):
        try:
            entries = parse_yaml(content.decode("utf-8"))
        except (PlainYamlError, UnicodeDecodeError):
            return described
        for text in _texts(entries):
            named = path.parent / text
            if 0 < len(text) < 200 and "\n" not in text and named.is_file():
                described += [text, hashlib.sha256(named.read_bytes()).hexdigest()]
    return described


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, Mapping):
        for item in value.values():
            yield from _texts(item)
    elif isinstance(value, list):
        for item in value:
            yield from _texts(item)
    elif isinstance(value, str):
        yield value


def _digest(content: Any) -> str:
    text = json.dumps(content, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:DIGEST_LENGTH]
