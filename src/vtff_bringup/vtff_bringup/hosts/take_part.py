"""`vtff run --host`: the part of this host, from its meeting with the others to its conclusion."""

from __future__ import annotations

import contextlib
import pathlib
from collections.abc import Iterator

from rich.console import Console
from rich.markup import escape

from vtff_bringup.hosts.identity import digest_system, version_text
from vtff_bringup.hosts.joining_part import JoiningPart
from vtff_bringup.hosts.main_part import MainPart
from vtff_bringup.hosts.part import quote_host
from vtff_bringup.hosts.run_order import RunOrder
from vtff_bringup.run.exit_codes import EXIT_FAILURE
from vtff_bringup.run.host_session import Conclusion, HostSession
from vtff_bringup.run.runner import RunResult
from vtff_bringup.system.description import SystemDescription
from vtff_bringup.system.errors import SystemFileError
from vtff_bringup.system.system_file import load_system

__all__ = ["check_host", "conclude_on_other_host", "take_part"]


def check_host(description: SystemDescription, host: str | None) -> None:
    """Raise SystemFileError unless a host is chosen for a system that has several, and only then.

    The text names the parts of the run.
    """
    name, hosts = description.path.name, description.hosts
    if not hosts:
        if host is not None:
            raise SystemFileError(f"--host {host}: {name} runs on this machine alone")
        return
    if host is None or host not in {entry.name for entry in hosts}:
        parts = ", ".join(f"--host {entry.name} ({entry.address})" for entry in hosts)
        problem = "" if host is None else f"--host {host} is none of them; "
        raise SystemFileError(
            f"{problem}{name} runs on {len(hosts)} hosts; start one part on each: {parts}; "
            f"the first leads the run"
        )


@contextlib.contextmanager
def take_part(
    console: Console,
    description: SystemDescription,
    host: str,
    order: RunOrder,
    run_directory: pathlib.Path,
) -> Iterator[tuple[HostSession, RunOrder]]:
    """Meet the other parts of the run; yield the session and the order of the main part.

    Parameters
    ----------
    console
        Where to print for whom this part waits.
    description
        The system, as this host has loaded it.
    host
        Name of this host.
    order
        What this part was told.
    run_directory
        Run folder on this host.

    Raises
    ------
    HostError
        If this part cannot take part, or is refused.
    DomainOccupiedError
        If no domain is free on all hosts.
    """

    def say(line: str) -> None:
        console.print(escape(line), soft_wrap=True)

    def load(
        settled: RunOrder, free_ports: dict[str, int]
    ) -> tuple[SystemDescription, dict[str, str]]:
        settings = settled.settings(run_directory, free_ports)
        loaded = load_system(description.path, settled.overrides, settings)
        check_host(loaded, host)
        return loaded, digest_system(loaded, run_directory)

    with contextlib.ExitStack() as stack:
        if host == description.hosts[0].name:
            digests = digest_system(description, run_directory)
            main = MainPart(
                description,
                order,
                version_text(),
                digests,
                lambda ports: load(order, ports)[0],
                say,
            )
            stack.callback(main.close)
            main.gather()
            yield main, order
            return
        part = JoiningPart(description, host, order, version_text(), load, say)
        stack.callback(part.close)
        part.join()
        yield part, part.order


def conclude_on_other_host(console: Console, session: HostSession, result: RunResult) -> int:
    """Print how the run ended on a host that does not record; return the exit code."""
    exit_code = result.exit_code
    if result.reason:
        console.print(f"[red]{escape(result.reason)}[/red]", soft_wrap=True)
    for line in result.last_output:
        console.print(f"  {line}", markup=False, soft_wrap=True)
    conclusion = session.conclude(None)
    if conclusion is None:
        console.print("[red]error:[/red] the host that records did not say where the bag is")
        return exit_code or EXIT_FAILURE
    console.print(describe_conclusion(session, conclusion), markup=False, soft_wrap=True)
    return exit_code or conclusion.exit_code


def describe_conclusion(session: HostSession, conclusion: Conclusion) -> str:
    """Return where the bag is and what is in it."""
    host = next(host for host in session.description.hosts if host.name == conclusion.host)
    state = "complete" if conclusion.exit_code == 0 else f"exit code {conclusion.exit_code} there"
    return (
        f"run: {conclusion.bag} on host {quote_host(host)}; "
        f"{conclusion.message_count} messages, {state}"
    )
