"""`vtff run`: run a system file, record it, and report on it."""

from __future__ import annotations

import pathlib
from typing import Annotated, Optional

import typer
from rich.console import Console
from rich.markup import escape

from vtff_bag.file.errors import BagError
from vtff_bag.file.reader import BagReader
from vtff_bag.run.description import write_arguments
from vtff_bag.run.folder import (
    RunFolderError,
    output_folder,
    remove_if_empty,
)
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_INTERRUPTED, EXIT_USAGE
from vtff_bringup.run.progress import RunProgress
from vtff_bringup.run.runner import Runner, RunResult, check_counts
from vtff_bringup.system.system_file import (
    RunSettings,
    SystemDescription,
    SystemFileError,
    find_system_file,
    load_system,
)
from vtff_node.executables import ExecutableNotFoundError


def run(
    system: Annotated[
        str,
        typer.Argument(help="System file or its name, e.g. config/system/reference_software.yaml"),
    ],
    overrides: Annotated[
        Optional[list[str]],  # noqa: UP045 - typer reads the annotation at run time on 3.10
        typer.Argument(
            help="ARGUMENT:=VALUE of the system file, or NODE.PARAMETER:=VALUE, "
            "e.g. sdre_controller.design:=delay_aware"
        ),
    ] = None,
    composed: Annotated[
        bool, typer.Option("--composed", help="All nodes in one process: fastest.")
    ] = False,
    realtime: Annotated[
        bool, typer.Option("--realtime", help="Pace with the wall clock instead of lockstep.")
    ] = False,
    duration: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(help="Scenario seconds to run; default: as the scenario says.", min=1.0),
    ] = None,
    seed: Annotated[
        Optional[int],  # noqa: UP045
        typer.Option(help="Seed of every random stream; default: as the scenario says.", min=0),
    ] = None,
    out: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        typer.Option(help="Folder of the run, new or empty; default: bags/SYSTEM_DATE_TIME."),
    ] = None,
    report: Annotated[
        bool, typer.Option("--report/--no-report", help="Write plots and summary.json.")
    ] = True,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Show everything the nodes print.")
    ] = False,
) -> None:
    """Run a system of nodes, record every topic, and report on the run.

    Exit code: 0 complete, 1 a node failed or a message was not recorded, 2 a file, an argument
    or a parameter is wrong, 130 interrupted by Ctrl-C (the bag is complete up to then).
    """
    console = Console(highlight=False)
    try:
        path = find_system_file(system)
        run_directory = output_folder(out, path.stem, parent="bags", empty=True)
    except (SystemFileError, RunFolderError) as error:
        raise _stop(console, error, EXIT_USAGE) from error
    settings = RunSettings(
        run_directory=run_directory,
        pacing="realtime" if realtime else "lockstep",
        duration=duration,
        seed=seed,
    )
    try:
        description = load_system(path, overrides or [], settings)
        write_arguments(run_directory, {"system": description.name, **description.arguments})
        result = run_system(console, description, settings, composed=composed, verbose=verbose)
    except (SystemFileError, ExecutableNotFoundError) as error:
        remove_if_empty(run_directory)
        raise _stop(console, error, EXIT_USAGE) from error
    except OSError as error:
        raise _stop(console, error, EXIT_FAILURE) from error
    exit_code, message_count = conclude_run(console, run_directory, result)
    if report and message_count and exit_code in (0, EXIT_INTERRUPTED):
        exit_code = report_run(console, run_directory) or exit_code
    raise typer.Exit(exit_code)


def run_system(
    console: Console,
    description: SystemDescription,
    settings: RunSettings,
    *,
    composed: bool,
    verbose: bool,
) -> RunResult:
    """Run a loaded system in its run folder, with its progress on the console.

    Raises
    ------
    ExecutableNotFoundError
        If an executable of the system is not installed.
    OSError
        If the run folder cannot be written.
    """
    console.print(f"[bold]{description.name}[/bold]: {escape(description.description)}")
    with RunProgress(console) as progress:

        def show_line(name: str, line: str, noteworthy: bool) -> None:
            if verbose or noteworthy:
                progress.print(f"[{name}] {line}")

        runner = Runner(
            description,
            settings.run_directory,
            composed=composed,
            on_progress=progress.update,
            on_line=show_line,
        )
        return runner.run()


def conclude_run(
    console: Console, run_directory: pathlib.Path, result: RunResult
) -> tuple[int, int]:
    """Say how the run ended; return the exit code and the number of messages in the bag."""
    exit_code = result.exit_code
    if result.reason:
        console.print(f"[red]{escape(result.reason)}[/red]", soft_wrap=True)
    for line in result.last_output:
        console.print(f"  {line}", markup=False, soft_wrap=True)
    recorded: dict[str, int] = {}
    if (run_directory / "bag").exists():
        try:
            topics = BagReader(run_directory / "bag").topics
        except BagError as error:
            console.print(f"[red]error:[/red] {escape(str(error))}", soft_wrap=True)
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
        console.print(f"{_speed(result)}; {held}", soft_wrap=True)
    console.print(f"run: {run_directory}", markup=False, soft_wrap=True)
    return exit_code, message_count


def _check_bag(
    console: Console, run_directory: pathlib.Path, recorded: dict[str, int], exit_code: int
) -> int:
    if exit_code not in (0, EXIT_INTERRUPTED):
        return exit_code
    differences = check_counts(run_directory, recorded)
    if not differences:
        return exit_code
    console.print("[red]the bag does not hold exactly what the nodes published:[/red]")
    for line in differences:
        console.print(f"  {line}", markup=False, soft_wrap=True)
    return exit_code or EXIT_FAILURE


def report_run(console: Console, run_directory: pathlib.Path) -> int:
    """Write the report; return an exit code, 0 if it is written."""
    try:
        # Imports matplotlib, which takes a while.
        from vtff_analysis.report import write_report

        write_report(run_directory, console)
    except KeyboardInterrupt:
        console.print("[red]report interrupted[/red]; the bag is complete")
        return EXIT_INTERRUPTED
    except (BagError, OSError) as error:
        console.print(f"[red]error:[/red] no report: {escape(str(error))}")
        return EXIT_FAILURE
    return 0


def _speed(result: RunResult) -> str:
    done, unit = float(result.progress.get("done", 0.0)), result.progress.get("unit", "s")
    if unit != "s":
        return f"{done:.0f} {unit} in {result.wall_time:.1f} s"
    factor = done / result.wall_time
    return (
        f"{done:.0f} s of scenario in {result.wall_time:.1f} s "
        f"({factor:.0f} x real time, start and end included)"
    )


def _stop(console: Console, error: Exception, exit_code: int) -> typer.Exit:
    console.print(f"[red]error:[/red] {escape(str(error))}", soft_wrap=True)
    return typer.Exit(exit_code)
