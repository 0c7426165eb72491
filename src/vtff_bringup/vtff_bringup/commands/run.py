"""`vtff run`: run a system file, record it, and report on it."""

from __future__ import annotations

import contextlib
import pathlib
from typing import Annotated, Optional

import typer

from vtff_bag.run.folder import RunFolderError, output_folder
from vtff_bringup.commands.command_line import command_line, folder_option
from vtff_bringup.discover.completion import complete_override, complete_system
from vtff_bringup.hosts.run_order import RunOrder
from vtff_bringup.run.console import make_console
from vtff_bringup.run.errors import exit_with_error
from vtff_bringup.run.exit_codes import EXIT_INTERRUPTED, EXIT_USAGE
from vtff_bringup.system.errors import SystemFileError


def run(
    system: Annotated[
        str,
        typer.Argument(
            help="System file or its name (vtff list systems), e.g. reference_software",
            autocompletion=complete_system,
        ),
    ],
    overrides: Annotated[
        Optional[list[str]],  # noqa: UP045 - typer reads the annotation at run time on 3.10
        typer.Argument(
            metavar="NAME:=VALUE",
            help="ARGUMENT:=VALUE of the system file, or NODE.PARAMETER:=VALUE, "
            "e.g. sdre_controller.design:=delay_aware",
            autocompletion=complete_override,
        ),
    ] = None,
    composed: Annotated[
        Optional[bool],  # noqa: UP045
        typer.Option(
            "--composed/--distributed",
            help="All nodes in one process, which is fastest, or each in a process of its own; "
            "default: --composed in lockstep, --distributed with --realtime.",
        ),
    ] = None,
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
    max_lag: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option(
            help="With --realtime: steps that the run may be late before it stops with zero "
            "thrust and exit code 1; 0 for no limit; default: 2.",
            min=0.0,
        ),
    ] = None,
    host: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option(
            help="Of a system on several machines: the part of this one, e.g. --host deputy. "
            "Start one part on each; the main one is given arguments and options, and leads.",
        ),
    ] = None,
    out: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        folder_option("Folder of the run, new or empty; default: bags/SYSTEM_DATE_TIME."),
    ] = None,
    report: Annotated[
        bool, typer.Option("--report/--no-report", help="Write plots and summary.json.")
    ] = True,
    verbose: Annotated[
        bool, typer.Option("--verbose", "-v", help="Show everything the nodes print.")
    ] = False,
) -> None:
    """Run a system of nodes, record every topic, report on it.

    Exit code: 0 complete, 1 a node failed or a message was not recorded, 2 a file, an argument
    or a parameter is wrong, 130 interrupted by Ctrl-C (the bag is complete up to then).

    On several machines (docs/hosts.md): vtff run reference_hosts chief_address:=192.0.2.1
    deputy_address:=192.0.2.2 --host chief on one, the same with --host deputy on the other.
    """
    # Imported here, because numpy, scipy and rclpy take a while.
    from vtff_bringup.hosts.take_part import check_host, conclude_on_other_host, take_part
    from vtff_bringup.run.flown import has_flown
    from vtff_bringup.run.host_session import Conclusion, HostSession
    from vtff_bringup.run.on_console import conclude_run, exit_on_run_errors, run_system
    from vtff_bringup.system.parameter_check import check_files, check_parameters
    from vtff_bringup.system.system_file import find_system_file, load_system

    console = make_console()
    if max_lag is not None and not realtime:
        raise exit_with_error(console, "--max-lag needs --realtime", EXIT_USAGE)
    try:
        path = find_system_file(system)
        run_directory = output_folder(out, path.stem, parent="bags", empty=True)
    except (SystemFileError, RunFolderError) as error:
        raise exit_with_error(console, error, EXIT_USAGE) from error
    order = RunOrder(
        overrides=tuple(overrides or ()),
        pacing="realtime" if realtime else "lockstep",
        duration=duration,
        seed=seed,
        max_lag=max_lag,
        composed=composed,
        report=report,
    )
    settings = order.settings(run_directory, {})
    with contextlib.ExitStack() as stack:
        stack.enter_context(exit_on_run_errors(console, run_directory))
        description = load_system(path, order.overrides, settings)
        check_host(description, host)
        check_files(description)
        check_parameters(description, order.overrides)
        session: HostSession | None = None
        if host is not None:
            session, order = stack.enter_context(
                take_part(console, description, host, order, run_directory)
            )
            description = session.description
            settings = order.settings(run_directory, description.free_ports)
        result = run_system(
            console,
            description,
            settings,
            command=command_line(without="--out"),
            composed=order.shares_process,
            verbose=verbose,
            session=session,
        )
        if session is not None and not session.records:
            raise typer.Exit(conclude_on_other_host(console, session, result))
        exit_code, message_count = conclude_run(console, run_directory, result)
        if session is not None:
            own = Conclusion(session.host, str(run_directory), exit_code, message_count)
            session.conclude(own)
    if order.report and message_count and exit_code in (0, EXIT_INTERRUPTED):
        if not has_flown(run_directory):
            console.print("nothing flew before the end: no report")
            raise typer.Exit(exit_code)
        # Imported after the flight, because matplotlib takes a while.
        from vtff_bringup.run.reporting import report_run

        exit_code = report_run(console, run_directory) or exit_code
        console.print(f"look at it: vtff view {run_directory}", markup=False, soft_wrap=True)
    raise typer.Exit(exit_code)
