"""A run of a system for a command: its progress, its end and its report on the console."""

from __future__ import annotations

import contextlib
import pathlib
from collections.abc import Callable, Iterator
from typing import Any

from rich.console import Console
from rich.markup import escape

from vtff_bag.file.errors import BagError
from vtff_bag.file.reader import RUN_SUBDIRECTORY, BagReader
from vtff_bag.run.description import COMMAND_KEY, add_measured, write_arguments
from vtff_bag.run.folder import remove_if_empty
from vtff_bringup.run.domain import DOMAIN_VARIABLE, DomainOccupiedError
from vtff_bringup.run.errors import describe_os_error, exit_with_error, print_error
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_INTERRUPTED, EXIT_USAGE
from vtff_bringup.run.host_session import HostError, HostSession
from vtff_bringup.run.progress import LinkLines, RunProgress
from vtff_bringup.run.runner import Runner, RunResult, check_counts
from vtff_bringup.system.description import RunSettings, SystemDescription
from vtff_bringup.system.errors import SystemFileError
from vtff_node.executables import ExecutableNotFoundError

__all__ = ["conclude_run", "exit_on_run_errors", "run_system"]


@contextlib.contextmanager
def exit_on_run_errors(console: Console, run_directory: pathlib.Path) -> Iterator[None]:
    """End the command with one line where a system cannot be loaded or started.

    A wrong system file, an executable that is not installed or an occupied ROS domain ends it with
    exit code 2 and leaves no empty run folder, a folder that cannot be written with exit code 1.
    """
    try:
        yield
    except (SystemFileError, ExecutableNotFoundError, DomainOccupiedError, HostError) as error:
        remove_if_empty(run_directory)
        raise exit_with_error(console, error, EXIT_USAGE) from error
    except OSError as error:
        raise exit_with_error(console, error, EXIT_FAILURE) from error
    except KeyboardInterrupt:  # while other hosts are waited for
        remove_if_empty(run_directory)
        raise


def run_system(
    console: Console,
    description: SystemDescription,
    settings: RunSettings,
    *,
    command: str,
    composed: bool,
    verbose: bool,
    prepare: Callable[[], None] | None = None,
    session: HostSession | None = None,
) -> RunResult:
    """Run a loaded system in its run folder, with its progress on the console.

    The system, its arguments and the ROS domain are written into the folder.

    Parameters
    ----------
    console, description, settings
        Where to print, what to run, and how.
    command
        The command that makes the run again.
    composed
        Whether all nodes that allow it share one process.
    verbose
        Whether every line of the processes is shown.
    prepare
        Writes further files into the run folder before the first process starts.
    session
        The run on the other hosts, of a system that has several.

    Raises
    ------
    DomainOccupiedError
        If another run is in the ROS domain; then nothing is written.
    ExecutableNotFoundError
        If an executable of the system is not installed.
    OSError
        If the run folder cannot be written.
    """
    console.print(f"[bold]{description.name}[/bold]: {escape(description.description)}")

    def begin(domain: int) -> None:
        console.print(f"{DOMAIN_VARIABLE} {domain}")
        arguments = {"system": description.name, COMMAND_KEY: command, **description.arguments}
        measured: dict[str, Any] = {"ros_domain_id": domain}
        if session is not None:
            measured["host"] = session.host
            measured["clock_offsets_s"] = session.clock_offsets
        write_arguments(settings.run_directory, arguments, measured)
        if prepare is not None:
            prepare()

    links = LinkLines(description)
    for told in links.first:
        console.print(told, markup=False, soft_wrap=True)
    with RunProgress(console) as progress:

        def show_line(name: str, line: str, noteworthy: bool) -> None:
            if verbose or noteworthy or links.is_new(name, line):
                progress.print(f"[{name}] {line}")

        if session is not None:
            session.say = progress.print
        runner = Runner(
            description,
            settings.run_directory,
            composed=composed,
            on_domain=begin,
            on_progress=progress.update,
            on_line=show_line,
            session=session,
        )
        result = runner.run()
    late_steps = result.progress.get("late_steps")
    if late_steps is not None:
        largest = round(float(result.progress["largest_lag"]), 3)
        measured = {"late_steps": late_steps, "largest_lag_s": largest}
        try:
            add_measured(settings.run_directory, measured)
        except OSError as error:
            print_error(console, describe_os_error(error))
    return result


def conclude_run(
    console: Console, run_directory: pathlib.Path, result: RunResult
) -> tuple[int, int]:
    """Print how the run ended; return the exit code and the number of messages in the bag."""
    exit_code = result.exit_code
    if result.reason:
        console.print(f"[red]{escape(result.reason)}[/red]", soft_wrap=True)
    for line in result.last_output:
        console.print(f"  {line}", markup=False, soft_wrap=True)
    recorded: dict[str, int] = {}
    if (run_directory / RUN_SUBDIRECTORY).exists():
        try:
            topics = BagReader(run_directory / RUN_SUBDIRECTORY).topics
        except BagError as error:
            print_error(console, error)
            exit_code = exit_code or EXIT_FAILURE
        else:
            recorded = {name: topic.message_count for name, topic in topics.items()}
            exit_code = _check_bag(console, run_directory, recorded, exit_code)
    elif not result.reason:
        console.print("[red]error:[/red] no bag was written")
        exit_code = EXIT_FAILURE
    message_count = sum(recorded.values())
    if result.progress.get("done", 0.0) > 0.0:
        topic_count = sum(count > 0 for count in recorded.values())
        held = f"{message_count} messages, {topic_count} topics"
        console.print(f"{_speed_text(result)}; {held}", soft_wrap=True)
    console.print(f"run: {run_directory}", markup=False, soft_wrap=True)
    if result.full_disk:
        line = f"[red]the disk is full:[/red] {escape(result.full_disk)}"
        console.print(line, soft_wrap=True)
    return exit_code, message_count


def _check_bag(
    console: Console, run_directory: pathlib.Path, recorded: dict[str, int], exit_code: int
) -> int:
    """Print the topics whose counts differ from those of the nodes; return the exit code."""
    if exit_code not in (0, EXIT_INTERRUPTED):
        return exit_code
    differences = check_counts(run_directory, recorded)
    if not differences:
        return exit_code
    console.print("[red]the bag does not hold exactly what the nodes published:[/red]")
    for line in differences:
        console.print(f"  {line}", markup=False, soft_wrap=True)
    return exit_code or EXIT_FAILURE


def _speed_text(result: RunResult) -> str:
    done, unit = float(result.progress.get("done", 0.0)), result.progress.get("unit", "s")
    if unit != "s":
        return f"{done:.0f} {unit} in {result.wall_time:.1f} s"
    factor = done / result.wall_time
    late_steps = result.progress.get("late_steps", 0)
    lateness = (
        f"; {late_steps} steps began late, the worst by {result.progress['largest_lag']:.1f} s"
        if late_steps
        else ""
    )
    return (
        f"{done:.0f} s of scenario in {result.wall_time:.1f} s "
        f"({factor:.0f} x real time, start and end included){lateness}"
    )
