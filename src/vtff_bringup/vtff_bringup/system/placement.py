"""Hosts of a system file: their addresses, and on which of them each node and process runs."""

from __future__ import annotations

import dataclasses
import ipaddress
import pathlib
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from vtff_bringup.system.description import HostDescription, NodeDescription, ProcessDescription
from vtff_bringup.system.entries import PLAIN_NAME
from vtff_bringup.system.errors import SystemFileError
from vtff_bringup.system.references import References

__all__ = ["DEFAULT_CONTROL_PORT", "HOST_STEP_TIMEOUT", "place_on_hosts", "read_hosts"]

#: TCP and UDP port on which the parts of a run speak to the main one.
DEFAULT_CONTROL_PORT = 15660

#: Step time-out of a run on several hosts, s: longer than a host may be silent.
HOST_STEP_TIMEOUT = 40.0


def read_hosts(
    path: pathlib.Path, declared: Mapping[str, Any], references: References
) -> dict[str, str]:
    """Return the address of each host by its name, and let ``${hosts.NAME}`` stand for it.

    A host whose address is empty takes no part.

    Raises
    ------
    SystemFileError
        If a name or an address is wrong, or two hosts have one address.
    """
    hosts: dict[str, str] = {}
    for name, value in declared.items():
        where = f"host '{name}'"
        if not PLAIN_NAME.fullmatch(name):
            raise SystemFileError(f"{path}: {where}: a name of a host is letters, digits and '_'")
        address = str(references.resolve(value, where) or "").strip()
        if not address:
            continue
        try:
            is_usable = not (parsed := ipaddress.IPv4Address(address)).is_multicast
            is_usable = is_usable and not parsed.is_unspecified
        except ValueError:
            is_usable = False
        if not is_usable:
            raise SystemFileError(
                f"{path}: {where}: the IPv4 address of one of its interfaces is needed, "
                f"not {address!r}"
            )
        for other, its_address in hosts.items():
            if address == its_address:
                raise SystemFileError(
                    f"{path}: hosts '{other}' and '{name}' have the same address {address}"
                )
        hosts[name] = address
        references.values[f"hosts.{name}"] = address
    return hosts


def place_on_hosts(
    path: pathlib.Path,
    declared: Collection[str],
    addresses: Mapping[str, str],
    nodes: Sequence[NodeDescription],
    processes: Sequence[ProcessDescription],
) -> tuple[
    tuple[HostDescription, ...], tuple[NodeDescription, ...], tuple[ProcessDescription, ...]
]:
    """Return the hosts of a run, the main one first, and its entries with their hosts.

    Entries without ``host`` run on the main host, that of the node that ends the run. Where
    everything runs on one host there are no hosts: the run is one of this machine.

    Parameters
    ----------
    path
        The system file, for messages.
    declared
        Names of all hosts of the file.
    addresses
        Address of each host by its name.
    nodes, processes
        All entries.

    Raises
    ------
    SystemFileError
        If an entry names a host that is not there, or no main host can be told.
    """
    for kind, name, host in [
        *(("node", node.qualified_name, node.host) for node in nodes),
        *(("process", process.name, process.host) for process in processes),
    ]:
        if host and host not in addresses:
            has_no_address = host in declared
            problem = "has no address" if has_no_address else "is not one of 'hosts'"
            raise SystemFileError(
                f"{path}: {kind} '{name}': host '{host}' {problem}; "
                f"hosts with an address: {', '.join(addresses) or 'none'}"
            )
    used = {node.host for node in nodes} | {process.host for process in processes}
    used.discard("")
    if not used:
        return (), tuple(nodes), tuple(processes)
    main = next((node.host for node in nodes if node.ends_run), "")
    if not main:
        raise SystemFileError(
            f"{path}: the node with 'ends_run' needs a 'host': it makes that host the main one"
        )
    if used == {main}:
        nodes = [dataclasses.replace(node, host="") for node in nodes]
        processes = [dataclasses.replace(process, host="") for process in processes]
        return (), tuple(nodes), tuple(processes)
    names = [main, *(name for name in addresses if name in used and name != main)]
    return (
        tuple(HostDescription(name, addresses[name]) for name in names),
        tuple(
            dataclasses.replace(
                node,
                host=node.host or main,
                parameters=_with_patience(node.parameters) if node.ends_run else node.parameters,
            )
            for node in nodes
        ),
        tuple(dataclasses.replace(process, host=process.host or main) for process in processes),
    )


def _with_patience(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters of the step source that let a step wait while a link is cut."""
    return {"step_timeout": HOST_STEP_TIMEOUT, **parameters}
