"""`vtff run`: run a system file, record it, and report on it."""

from __future__ import annotations

import datetime
import pathlib
from typing import Annotated, Any, Optional

import typer
from rich.console import Console
from rich.markup import escape

from vtff_bringup.bag.reader import BagReader
from vtff_bringup.executables import ExecutableNotFoundError
from vtff_bringup.progress import RunProgress
from vtff_bringup.report import write_report
from vtff_bringup.runner import Runner, RunResult, check_counts
from vtff_bringup.system import (
    RunSettings,
    SystemDescription,
    SystemFileError,
    find_system_file,
    load_system,
)

EXIT_USAGE = 2


def run(
    system: Annotated[
        str,
        typer.Argument(help="System file or its name, e.g. config/system/reference_software.yaml"),
    ],
    overrides: Annotated[
        Optional[list[str]],  # noqa: UP045 - typer reads the annotation at run time on 3.10
        typer.Argument(
            help="argument:=value of the system file, or node.parameter:=value, "
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
        typer.Option(help="Folder of the run; default: bags/<system>_<date>_<time>."),
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
    or a parameter is wrong, 130 interrupted (the bag is complete up to then).
    """
    console = Console(highlight=False)
    run_directory = (out or _default_directory(pathlib.Path(system))).resolve()
    if (run_directory / "bag").exists():
        _stop(console, f"{run_directory} already holds a run; choose another --out")
    settings = RunSettings(
        run_directory=run_directory,
        pacing="realtime" if realtime else "lockstep",
        duration=duration,
        seed=seed,
    )
    try:
        description = load_system(find_system_file(system), overrides or [], settings)
        result = _run(console, description, settings, composed=composed, verbose=verbose)
    except (SystemFileError, ExecutableNotFoundError) as error:
        _stop(console, str(error))
    exit_code = _finish(console, description, run_directory, result, report=report)
    raise typer.Exit(exit_code)


def _run(
    console: Console,
    description: SystemDescription,
    settings: RunSettings,
    *,
    composed: bool,
    verbose: bool,
) -> RunResult:
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


def _finish(
    console: Console,
    description: SystemDescription,
    run_directory: pathlib.Path,
    result: RunResult,
    *,
    report: bool,
) -> int:
    exit_code = result.exit_code
    if result.reason:
        console.print(f"[red]{escape(result.reason)}[/red]")
    bag = run_directory / "bag"
    if not bag.exists():
        return exit_code or 1
    recorded = {name: topic.message_count for name, topic in BagReader(bag).topics.items()}
    lost = check_counts(run_directory, recorded) if exit_code in (0, 130) else []
    if lost:
        console.print("[red]not everything was recorded:[/red]")
        for line in lost:
            console.print(f"  {line}")
        exit_code = exit_code or 1
    console.print(f"{_speed(result)}; {sum(recorded.values())} messages, {len(recorded)} topics")
    if report and exit_code in (0, 130):
        write_report(run_directory, console=console, arguments=_shown(description))
    console.print(f"run: {run_directory}")
    return exit_code


def _speed(result: RunResult) -> str:
    done, unit = float(result.progress.get("done", 0.0)), result.progress.get("unit", "s")
    if unit != "s":
        return f"{done:.0f} {unit} in {result.wall_time:.1f} s"
    factor = done / result.wall_time
    return (
        f"{done:.0f} s of scenario in {result.wall_time:.1f} s "
        f"({factor:.0f} x real time, start and end included)"
    )


def _shown(description: SystemDescription) -> dict[str, Any]:
    return {"system": description.name, **description.arguments}


def _default_directory(system: pathlib.Path) -> pathlib.Path:
    now = datetime.datetime.now().strftime("%Y%m%d_%H%M%S")
    return pathlib.Path("bags") / f"{system.stem}_{now}"


def _stop(console: Console, text: str) -> None:
    console.print(f"[red]error:[/red] {escape(text)}")
    raise typer.Exit(EXIT_USAGE)
