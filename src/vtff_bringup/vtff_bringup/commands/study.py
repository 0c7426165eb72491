"""`vtff study`: parameter studies."""

from __future__ import annotations

import pathlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Optional

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import Progress
from rich.table import Table

from vtff_bag.file.errors import BagError
from vtff_bag.run.description import write_arguments
from vtff_bag.run.folder import RunFolderError, chosen_folder, output_folder
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_USAGE
from vtff_bringup.system.system_file import RunSettings, find_system_file, load_system
from vtff_node.executables import ExecutableNotFoundError, share_file

if TYPE_CHECKING:
    from vtff_analysis.studies.radial_offset import OffsetResult
    from vtff_analysis.studies.thrust_cap import ThrustCapFindings, ThrustCapPoint

_LARGEST_OFFSET = 50e3  # m; farther down the deputy would be in the dense atmosphere

app = typer.Typer(help="Parameter studies, beside the paper's.", no_args_is_help=True)


@app.callback()
def studies() -> None:
    """Parameter studies, beside the paper's."""


@app.command("thrust_cap")
def thrust_cap(
    scenario: Annotated[
        Optional[pathlib.Path],  # noqa: UP045 - typer reads the annotation at run time on 3.10
        typer.Option(help="Scenario file; default: the reference formation."),
    ] = None,
    out: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        typer.Option(help="Folder for plot and CSV; default: studies/thrust_cap_DATE_TIME."),
    ] = None,
) -> None:
    """Fly the reference formation with thrust caps from 0.01 to 10 m/s2 (paper 000, figure A2)."""
    # Imported here, because numpy and matplotlib take a while.
    from vtff_analysis.studies.thrust_cap import (
        default_caps,
        find_landmarks,
        run_thrust_cap_study,
        write_csv,
        write_plot,
    )
    from vtff_sim_bridge.truth.scenario import ScenarioError, load_scenario

    console = Console(highlight=False)
    try:
        file = scenario or share_file("vtff_bringup", "config/scenario/reference.yaml")
        flown = load_scenario(file)
        folder = output_folder(out, "thrust_cap", parent="studies")
    except (ScenarioError, ExecutableNotFoundError, RunFolderError) as error:
        console.print(f"[red]error:[/red] {escape(str(error))}")
        raise typer.Exit(EXIT_USAGE) from error
    with Progress(console=console, transient=True) as bar:
        task = bar.add_task("flying", total=len(default_caps()))

        def show(done: int, total: int, point: ThrustCapPoint) -> None:
            bar.update(task, completed=done, total=total, description=f"cap {point.cap:g} m/s2")

        points = run_thrust_cap_study(flown, progress=show)
    try:
        write_csv(points, folder / "thrust_cap.csv")
        write_plot(points, folder / "thrust_cap.png")
    except OSError as error:
        console.print(f"[red]error:[/red] {escape(str(error))}")
        raise typer.Exit(EXIT_FAILURE) from error
    console.print(_findings_table(find_landmarks(points)))
    console.print(f"{len(points)} caps; plot and table: {folder}", markup=False)


@app.command("radial_offset")
def radial_offset(
    model: Annotated[
        bool, typer.Option("--model", help="Only the paper's 75 dB model, no flights (seconds).")
    ] = False,
    offset: Annotated[
        Optional[list[float]],  # noqa: UP045
        typer.Option(help="Radial offset in m; may be repeated. Default: 100, 1000, 3000, 10000."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of every random stream.", min=0)] = 1,
    runs: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        typer.Option(help="Folder of the flights; complete ones there are not flown again."),
    ] = None,
    out: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        typer.Option(help="Folder for plots, CSV and flights; default: studies/radial_offset_..."),
    ] = None,
) -> None:
    """Retrieve the PLUMEX-like density with offsets of 0.1 to 10 km (paper 000, section 4.4).

    Each offset is flown for an hour, receivers and navigation in the loop, as vtff run plumex does;
    the deputy starts on its offset. That takes about 3 minutes each on two cores. Beside it stands
    the paper's simplified model: 75 dB of noise on the vertical TEC.

    Exit code: 0 complete, 1 a flight failed, 2 a file or an option is wrong, 130 interrupted by
    Ctrl-C: complete flights are kept, --runs goes on from there.
    """
    from vtff_analysis.studies.radial_offset import OFFSETS, OffsetError, flown_offset, run_offsets
    from vtff_sim_bridge.atmosphere.electron_density import ProfileError, read_profile

    console = Console(highlight=False)
    offsets = sorted(set(offset or OFFSETS))
    try:
        if offsets[0] <= 0.0 or offsets[-1] > _LARGEST_OFFSET:
            raise OffsetError(f"--offset: more than 0 and at most {_LARGEST_OFFSET:g} m expected")
        profile = read_profile(share_file("vtff_bringup", "config/ionosphere/plumex.csv"))
        folder = output_folder(out, "radial_offset", parent="studies")
        flights = None if model else chosen_folder(runs or folder / "runs", empty=False)
    except (ProfileError, OSError, ValueError, ExecutableNotFoundError) as error:
        raise _stopped(console, error, EXIT_USAGE) from error
    flown = [] if flights is None else _fly(console, flights, offsets, seed)
    with Progress(console=console, transient=True) as bar:
        task = bar.add_task("retrieving", total=len(offsets) + len(flown))
        try:
            results = run_offsets(
                profile, offsets, lambda done, _: bar.update(task, completed=done), seed
            )
            for one, run in zip(offsets, flown, strict=False):
                results.append(flown_offset(run, one))
                bar.advance(task)
        except (OffsetError, BagError, OSError) as error:
            raise _stopped(console, error, EXIT_FAILURE) from error
    _write_offsets(console, results, folder)


def _fly(
    console: Console, runs: pathlib.Path, offsets: Sequence[float], seed: int
) -> list[pathlib.Path]:
    """Return the run folder of each offset; those that are not there are flown."""
    from vtff_analysis.studies.offset_flights import (
        SYSTEM,
        complete_flight,
        flight_folder,
        write_offset_scenario,
    )
    from vtff_bringup.commands.run import conclude_run, run_system

    found = []
    for number, offset in enumerate(offsets, 1):
        folder = complete_flight(runs, offset, seed)
        if folder is not None:
            console.print(f"{offset:g} m: flown already, {folder}", markup=False, soft_wrap=True)
            found.append(folder)
            continue
        console.print(f"[bold]{offset:g} m[/bold], flight {number} of {len(offsets)}")
        try:
            folder = flight_folder(runs, offset)
            base = share_file("vtff_bringup", f"config/scenario/{SYSTEM}.yaml")
            scenario = write_offset_scenario(base, offset, seed, runs / f"{folder.name}.yaml")
            settings = RunSettings(run_directory=folder, seed=seed)
            system = load_system(find_system_file(SYSTEM), [f"scenario:={scenario}"], settings)
            write_arguments(folder, {"system": system.name, **system.arguments})
            result = run_system(console, system, settings, composed=True, verbose=False)
        except (ExecutableNotFoundError, OSError, ValueError) as error:
            raise _stopped(console, error, EXIT_USAGE) from error
        exit_code, _ = conclude_run(console, folder, result)
        if exit_code:
            again = f"complete flights are kept; go on with --runs {runs}"
            console.print(again, markup=False, soft_wrap=True)
            raise typer.Exit(exit_code)
        found.append(folder)
    return found


def _write_offsets(console: Console, results: Sequence[OffsetResult], folder: pathlib.Path) -> None:
    """Write table and figures, those of the model and of the flights each by themselves."""
    from vtff_analysis.studies.radial_offset_output import (
        results_table,
        write_csv,
        write_profiles_plot,
        write_spectra_plot,
    )

    try:
        write_csv(results, folder / "radial_offset.csv")
        for source in sorted({result.source for result in results}):
            mine = [result for result in results if result.source == source]
            write_profiles_plot(mine, folder / f"profiles_{source}.png")
            write_spectra_plot(mine, folder / f"spectra_{source}.png")
    except OSError as error:
        raise _stopped(console, error, EXIT_FAILURE) from error
    console.print(results_table(results))
    console.print(
        "mean error: of single samples, against the truth averaged over the separation. departs: "
        "squared spectrum ratio below -3.9 dB. resolved: neither averaged away nor in the noise."
    )
    console.print(f"plots and table: {folder}", markup=False, soft_wrap=True)


def _stopped(console: Console, error: Exception, exit_code: int) -> typer.Exit:
    console.print(f"[red]error:[/red] {escape(str(error))}", soft_wrap=True)
    return typer.Exit(exit_code)


def _findings_table(found: ThrustCapFindings) -> Table:
    table = Table(title="thrust cap, reference formation, 1 h", title_justify="left")
    table.add_column("")
    table.add_column("measured", justify="right")
    table.add_column("paper 000", justify="right")
    rows = [
        ("smallest cap that settles, m/s2", f"{found.smallest_settling_cap:.3f}", "0.02"),
        ("minimum in-track changes sign at, m/s2", f"{found.sign_change_cap:.2f}", "1.20"),
        ("least in-track dv of region 2 at, m/s2", f"{found.optimum_cap:.2f}", "1.4"),
        ("  that dv, m/s", f"{found.optimum_delta_v:.2f}", ""),
        ("largest minimum in-track, m", f"{found.largest_minimum_in_track:.2f}", "69.02"),
        ("  at, m/s2", f"{found.largest_minimum_cap:.2f}", "1.95"),
        ("in-track dv at the largest cap, m/s", f"{found.asymptotic_delta_v:.2f}", "constant"),
    ]
    for row in rows:
        table.add_row(*row)
    return table
