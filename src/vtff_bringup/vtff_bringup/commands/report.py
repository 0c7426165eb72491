"""`vtff report`: the report of a run, again or from a bag alone."""

from __future__ import annotations

import pathlib
from typing import Annotated, Optional

import typer
from rich.console import Console
from rich.markup import escape

from vtff_bag.file.errors import BagError
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_USAGE


def report(
    bag: Annotated[
        pathlib.Path, typer.Argument(help="Run folder, bag directory or .mcap file; any state.")
    ],
    out: Annotated[
        Optional[pathlib.Path],  # noqa: UP045 - typer reads the annotation at run time on 3.10
        typer.Option(help="Folder to write; default: RUN/report, or BAG_report beside a bag."),
    ] = None,
) -> None:
    """Write report.html, plots and summary.json of a run, and print its tables.

    report.html is one file that holds its pictures: it can be mailed and printed. What a run does
    not have is left out; of a damaged bag, what can be read is reported.
    """
    console = Console(highlight=False)
    # Imports matplotlib and rclpy, which takes a while.
    from vtff_analysis.report import write_report

    try:
        with console.status("reading the bag and drawing"):
            write_report(bag, console, output=out)
    except BagError as error:
        console.print(f"[red]error:[/red] {escape(str(error))}", soft_wrap=True)
        raise typer.Exit(EXIT_USAGE) from error
    except OSError as error:
        console.print(f"[red]error:[/red] no report: {escape(str(error))}", soft_wrap=True)
        raise typer.Exit(EXIT_FAILURE) from error
