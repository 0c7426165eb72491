"""`vtff report`: the report of a run or of a bag."""

from __future__ import annotations

import os
import pathlib
from typing import Annotated, Optional

import typer

from vtff_bag.file.errors import BagError
from vtff_bag.run.folder import RunFolderError, chosen_folder
from vtff_bringup.commands.command_line import RecordedRun, folder_option
from vtff_bringup.run.console import make_console
from vtff_bringup.run.errors import exit_with_error
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_USAGE
from vtff_bringup.run.flown import require_flight


def report(
    bag: RecordedRun,
    out: Annotated[
        Optional[pathlib.Path],  # noqa: UP045 - typer reads the annotation at run time on 3.10
        folder_option("Folder to write; default: RUN/report, or BAG_report beside a bag."),
    ] = None,
    svg: Annotated[
        bool, typer.Option("--svg", help="Also write each picture as SVG beside its PNG file.")
    ] = False,
) -> None:
    """Write the report of a run: page, plots and summary.

    Written are report.html, plots and summary.json; the tables are printed. report.html is one
    file that holds its pictures: it can be mailed and printed. Subjects that a run does not have
    are left out; the report of a damaged bag covers what can be read.
    """
    console = make_console()
    # Imported here, because matplotlib and rclpy take a while.
    from vtff_analysis.plot_style import FIGURES_VARIABLE
    from vtff_analysis.report import write_report

    if svg:
        os.environ[FIGURES_VARIABLE] = "svg"
    try:
        require_flight(bag)
        if out is not None:
            out = chosen_folder(out, empty=False)
        with console.status("reading the bag and drawing"):
            write_report(bag, console, output=out)
    except (BagError, RunFolderError) as error:
        raise exit_with_error(console, error, EXIT_USAGE) from error
    except OSError as error:
        raise exit_with_error(console, f"no report: {error}", EXIT_FAILURE) from error
