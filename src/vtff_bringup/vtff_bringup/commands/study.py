"""`vtff study`: parameter studies in one process, without ROS."""

from __future__ import annotations

import pathlib
from typing import TYPE_CHECKING, Annotated, Optional

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import Progress
from rich.table import Table

from vtff_bringup.executables import ExecutableNotFoundError, share_file
from vtff_bringup.exit_codes import EXIT_FAILURE, EXIT_USAGE
from vtff_bringup.run_folder import RunFolderError, output_folder

if TYPE_CHECKING:
    from vtff_bringup.studies.thrust_cap import ThrustCapFindings, ThrustCapPoint

app = typer.Typer(help="Parameter studies in one process, without ROS.", no_args_is_help=True)


@app.callback()
def studies() -> None:
    """Parameter studies in one process, without ROS."""


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
    from vtff_bringup.studies.thrust_cap import (
        default_caps,
        find_landmarks,
        run_thrust_cap_study,
        write_csv,
        write_plot,
    )
    from vtff_sim_bridge.scenario import ScenarioError, load_scenario

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
    out: Annotated[
        Optional[pathlib.Path],  # noqa: UP045
        typer.Option(help="Folder for plot and CSV; default: studies/radial_offset_DATE_TIME."),
    ] = None,
) -> None:
    """Retrieve the PLUMEX-like density with offsets of 0.1 to 10 km (paper 000, section 4.4).

    The paper's simplified model: noise of 75 dB on the vertical TEC, no flight.
    """
    from vtff_bringup.studies.radial_offset import run_offsets, write_csv, write_plot
    from vtff_sim_bridge.atmosphere.electron_density import ProfileError, read_profile

    console = Console(highlight=False)
    try:
        profile = read_profile(share_file("vtff_bringup", "config/ionosphere/plumex.csv"))
        folder = output_folder(out, "radial_offset", parent="studies")
    except (ProfileError, OSError, ExecutableNotFoundError, RunFolderError) as error:
        console.print(f"[red]error:[/red] {escape(str(error))}")
        raise typer.Exit(EXIT_USAGE) from error
    with Progress(console=console, transient=True) as bar:
        task = bar.add_task("retrieving", total=None)
        results = run_offsets(profile, progress=lambda d, t: bar.update(task, completed=d, total=t))
    try:
        write_csv(results, folder / "radial_offset.csv")
        write_plot(results, folder / "radial_offset.png")
    except OSError as error:
        console.print(f"[red]error:[/red] {escape(str(error))}")
        raise typer.Exit(EXIT_FAILURE) from error
    table = Table(title="radial offset, PLUMEX-like profile (synthetic)", title_justify="left")
    for name in ("offset, km", "mean error, cm-3", "departs below, km", "deconvolved, km", "paper"):
        table.add_column(name, justify="right")
    for result, paper in zip(results, ("", "6e4 cm-3", "6 km", "20 km"), strict=True):
        table.add_row(
            f"{result.offset / 1e3:g}",
            f"{result.mean_error / 1e6:.3g}",
            f"{result.departure / 1e3:.2f}",
            f"{result.departure_deconvolved / 1e3:.2f}",
            paper,
        )
    console.print(table)
    console.print(f"plot and table: {folder}", markup=False)


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
