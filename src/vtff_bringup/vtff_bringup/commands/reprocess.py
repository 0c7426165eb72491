"""`vtff reprocess`: chosen nodes run again on recorded observations, into a new bag."""

from __future__ import annotations

import pathlib
from typing import TYPE_CHECKING, Annotated, Optional

import typer
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from vtff_bag.file.errors import BagError
from vtff_bag.run.folder import RunFolderError, output_folder
from vtff_bringup.commands.command_line import RecordedRun, command_line, folder_option
from vtff_bringup.discover.completion import (
    complete_override,
    complete_system,
)
from vtff_bringup.run.console import make_console
from vtff_bringup.run.errors import exit_with_error, print_error
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_USAGE
from vtff_bringup.system.description import RunSettings, SystemDescription
from vtff_bringup.system.errors import SystemFileError

if TYPE_CHECKING:
    from vtff_bag.file.reader import BagReader
    from vtff_bringup.run.reprocess import OutputComparison

BAG_ARGUMENT = "bag"  # argument of system files for reprocessing


def reprocess(
    bag: RecordedRun,
    system: Annotated[
        str,
        typer.Option(
            help="System file or its name, with the nodes to run again.",
            autocompletion=complete_system,
        ),
    ] = "navigation_only",
    settings: Annotated[
        Optional[list[str]],  # noqa: UP045 - typer reads the annotation at run time on 3.10
        typer.Option(
            "--set",
            metavar="NAME:=VALUE",
            help="NODE.PARAMETER:=VALUE or ARGUMENT:=VALUE; may be repeated.",
            autocompletion=complete_override,
        ),
    ] = None,
    duration: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(help="Recorded seconds to replay; default: all.", min=1.0),
    ] = None,
    out: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        folder_option("Folder of the new run; default: bags/SYSTEM_DATE_TIME."),
    ] = None,
    distributed: Annotated[
        bool, typer.Option("--distributed", help="Each node in a process of its own: slower.")
    ] = False,
    report: Annotated[
        bool, typer.Option("--report/--no-report", help="Write the report of the new run.")
    ] = True,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Show everything the nodes print.")
    ] = False,
) -> None:
    """Replay a bag in lockstep through chosen nodes.

    What they make of it is recorded. The nodes of the system file run again; what they publish is
    left out of the replay and recorded anew, everything else goes into the new bag as it was.
    Afterwards each recomputed topic is compared with the recorded one: with unchanged parameters
    the bytes are the same.

    Example: vtff reprocess bags/mine --set relative_ekf.estimator:=paper
    """
    # Imported here, because numpy, scipy and rclpy take a while.
    from vtff_bag.file.reader import BagReader
    from vtff_bringup.run.on_console import conclude_run, exit_on_run_errors, run_system
    from vtff_bringup.run.reprocess import carry_over_parameters
    from vtff_bringup.system.parameter_check import check_parameters
    from vtff_bringup.system.system_file import find_system_file, load_system

    console = make_console()
    try:
        recorded = BagReader(bag)
        path = find_system_file(system)
        run_directory = output_folder(out, path.stem, parent="bags", empty=True)
    except (BagError, SystemFileError, RunFolderError) as error:
        raise exit_with_error(console, error, EXIT_USAGE) from error
    run_settings = RunSettings(run_directory=run_directory, duration=duration)
    overrides = [f"{BAG_ARGUMENT}:={recorded.path.resolve()}", *(settings or [])]
    with exit_on_run_errors(console, run_directory):
        description = load_system(path, overrides, run_settings)
        check_parameters(description, overrides)
        result = run_system(
            console,
            description,
            run_settings,
            command=command_line(without="--out"),
            composed=not distributed,
            verbose=verbose,
            prepare=lambda: carry_over_parameters(recorded, run_directory),
        )
    exit_code, message_count = conclude_run(console, run_directory, result)
    if exit_code == 0:
        exit_code = _print_comparison(console, recorded, run_directory, description)
    if report and message_count and exit_code == 0:
        # Imported after the flight, because matplotlib takes a while.
        from vtff_bringup.run.reporting import report_run

        exit_code = report_run(console, run_directory)
    raise typer.Exit(exit_code)


def _print_comparison(
    console: Console,
    recorded: BagReader,
    run_directory: pathlib.Path,
    description: SystemDescription,
) -> int:
    """Print the comparison of each recomputed topic with the recorded one; return an exit code."""
    from vtff_bag.file.reader import BagReader
    from vtff_bringup.run.reprocess import compare_outputs, recomputed_topics

    replaying = [
        node.qualified_name for node in description.nodes if node.ends_run or node.own_process
    ]
    try:
        topics = recomputed_topics(run_directory, replaying)
        compared = compare_outputs(recorded, BagReader(run_directory), topics)
    except (BagError, OSError) as error:
        print_error(console, error)
        return EXIT_FAILURE
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1))
    table.add_column("recomputed topic", overflow="fold")
    for title in ("recorded", "recomputed"):
        table.add_column(title, justify="right")
    table.add_column("")
    for output in compared:
        table.add_row(
            escape(output.topic),
            str(output.recorded),
            str(output.recomputed),
            _verdict_text(output),
        )
    console.print(table)
    return 0


def _verdict_text(output: OutputComparison) -> str:
    if output.identical:
        return "identical"
    if not output.recorded:
        return "new"
    if output.first_difference is None:
        return "identical as far as both go"
    return f"{output.differing} differ, the first at {output.first_difference:.0f} s"
