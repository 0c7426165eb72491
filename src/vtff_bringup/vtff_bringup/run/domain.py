"""The DDS domain of a run: chosen and looked at before anything starts.

A run takes a domain that nobody uses, or the one in ``ROS_DOMAIN_ID`` if no other run is in it.
Runs on one machine exclude each other by an abstract socket, which ends with its process. Programs
that no ``vtff run`` started are found by the UDP ports that DDS prescribes for each domain, and
told apart by a look at the graph: a viewer that waits for the run does no harm, a second simulator
does.
"""

from __future__ import annotations

import contextlib
import os
import pathlib
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence

from vtff_node.executables import share_file

__all__ = [
    "DOMAIN_VARIABLE",
    "DomainOccupiedError",
    "add_dds_settings",
    "has_participants",
    "reserve_domain",
]

DOMAIN_VARIABLE = "ROS_DOMAIN_ID"
RANGE_VARIABLE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PROFILES_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"

#: Domains that a run may take by itself; above 101 their ports overlap those of other programs.
FREE_DOMAINS = range(1, 101)
#: UDP ports of DDS: the first of domain 0, and how many each domain has.
PORT_BASE, PORTS_PER_DOMAIN = 7400, 250
#: TCP port of domain 0 by which ROS's own `domain_coordinator` reserves domains for tests.
COORDINATOR_PORT_BASE = 32768

PROBE_LIMIT = 30.0  # s of wall time after which the look at a graph is given up


class DomainOccupiedError(RuntimeError):
    """Another run or simulator is in the domain; the text names it."""


@contextlib.contextmanager
def reserve_domain(environment: Mapping[str, str], nodes: Sequence[str]) -> Iterator[int]:
    """Yield a DDS domain that no other run uses, and keep it from other runs.

    Parameters
    ----------
    environment
        Environment of the processes of the run. ``ROS_DOMAIN_ID`` in it is the user's choice.
    nodes
        Fully qualified names of the nodes of the run; nodes of these names in the domain belong to
        another run.

    Raises
    ------
    DomainOccupiedError
        If the domain that the user chose is occupied or no number, or if all domains are occupied.
    """
    with contextlib.ExitStack() as reserved:
        chosen = environment.get(DOMAIN_VARIABLE, "").strip()
        if chosen:
            domain = _reserve_chosen(reserved, chosen, environment, nodes)
        else:
            domain = _reserve_free(reserved, environment, nodes)
        yield domain


def add_dds_settings(environment: dict[str, str]) -> None:
    """Add how DDS finds and reaches other programs, where the user has not chosen it.

    By default everything stays on the loopback interface. With a wider
    ``ROS_AUTOMATIC_DISCOVERY_RANGE`` the profile for several machines takes the place of the
    default one, which would keep them apart.

    Raises
    ------
    ExecutableNotFoundError
        If the profiles are not installed.
    """
    environment.setdefault(RANGE_VARIABLE, "LOCALHOST")
    local = share_file("vtff_bringup", "config/dds/fastdds.xml").resolve()
    chosen = environment.get(PROFILES_VARIABLE, "")
    if chosen and pathlib.Path(chosen).resolve() != local:
        return
    network = local.with_name("fastdds_network.xml")
    environment[PROFILES_VARIABLE] = str(network if _spans_machines(environment) else local)


def has_participants(domain: int) -> bool:
    """Return whether a DDS program of this machine uses a domain: it holds one of its UDP ports."""
    first = PORT_BASE + PORTS_PER_DOMAIN * domain
    return any(first <= port < first + PORTS_PER_DOMAIN for port in _udp_ports())


def _reserve_chosen(
    reserved: contextlib.ExitStack, text: str, environment: Mapping[str, str], nodes: Sequence[str]
) -> int:
    if not text.isdecimal() or int(text) > 232:
        raise DomainOccupiedError(f"{DOMAIN_VARIABLE} is '{text}'; it must be 0 to 232")
    domain = int(text)
    advice = f"set another {DOMAIN_VARIABLE}, or none for a free one"
    lock = _lock(domain)
    if lock is None:
        raise DomainOccupiedError(
            f"another vtff run of this machine is in {DOMAIN_VARIABLE} {domain}; {advice}"
        )
    reserved.callback(lock.close)
    if _spans_machines(environment) or has_participants(domain):
        occupant = _find_occupant(domain, environment, nodes)
        if occupant:
            raise DomainOccupiedError(f"{DOMAIN_VARIABLE} {domain}: {occupant}; {advice}")
    return domain


def _reserve_free(
    reserved: contextlib.ExitStack, environment: Mapping[str, str], nodes: Sequence[str]
) -> int:
    for domain in FREE_DOMAINS:
        with contextlib.ExitStack() as attempt:
            coordinated = _bind_coordinator(domain)
            if coordinated is None:
                continue
            attempt.callback(coordinated.close)
            lock = _lock(domain)
            if lock is None:
                continue
            attempt.callback(lock.close)
            if has_participants(domain):
                continue
            if _spans_machines(environment) and _find_occupant(domain, environment, nodes):
                continue
            reserved.push(attempt.pop_all())
            return domain
    raise DomainOccupiedError(
        f"every domain from {FREE_DOMAINS[0]} to {FREE_DOMAINS[-1]} is occupied; "
        f"end other runs or set {DOMAIN_VARIABLE}"
    )


def _lock(domain: int) -> socket.socket | None:
    """Return a socket whose name no other run of this machine can have; None if one has it."""
    lock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        lock.bind(f"\0vtff_run_domain_{domain}")
    except OSError:
        lock.close()
        return None
    return lock


def _bind_coordinator(domain: int) -> socket.socket | None:
    bound = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        bound.bind(("", COORDINATOR_PORT_BASE + domain))
    except OSError:
        bound.close()
        return None
    return bound


def _udp_ports() -> set[int]:
    """Return the UDP ports that the programs of this machine have bound."""
    ports = set()
    for table in ("udp", "udp6"):
        try:
            lines = pathlib.Path("/proc/net", table).read_text(encoding="ascii").splitlines()[1:]
        except OSError:  # a machine without IPv6
            continue
        ports |= {int(line.split()[1].rpartition(":")[2], 16) for line in lines}
    return ports


def _spans_machines(environment: Mapping[str, str]) -> bool:
    return environment.get(RANGE_VARIABLE, "LOCALHOST").upper() not in ("LOCALHOST", "OFF")


def _find_occupant(domain: int, environment: Mapping[str, str], nodes: Sequence[str]) -> str:
    """Return what in the domain would disturb a run; empty if nothing does."""
    probe = subprocess.run(
        [sys.executable, "-m", "vtff_bringup.run.domain_probe", *nodes],
        env={**os.environ, **environment, DOMAIN_VARIABLE: str(domain)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=PROBE_LIMIT,
        start_new_session=True,  # Ctrl-C is for the run, which looks after this
    )
    if probe.returncode:
        last = (probe.stderr.strip().splitlines() or ["no reason given"])[-1]
        return f"the graph cannot be looked at: {last}"
    return probe.stdout.strip()
