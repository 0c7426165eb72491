"""`vtff compare`: two or more runs side by side."""

from __future__ import annotations

import json
import pathlib
from typing import TYPE_CHECKING, Annotated, Optional

import typer
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from vtff_bag.file.errors import BagError
from vtff_bag.run.folder import RunFolderError, output_folder
from vtff_bringup.commands.command_line import command_line, folder_option
from vtff_bringup.discover.completion import complete_run
from vtff_bringup.run.console import make_console
from vtff_bringup.run.errors import exit_with_error, print_note
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_USAGE
from vtff_bringup.run.flown import require_flight

if TYPE_CHECKING:
    from vtff_analysis.compare.comparison import ComparedRun

COMPARISON_FILE = "comparison.json"
COMPARISON_PAGE = "comparison.html"

# Characters of the label and of a number in the table on the console.
_LABEL_WIDTH, _NUMBER_WIDTH = 40, 11


def compare(
    bags: Annotated[
        list[pathlib.Path],
        typer.Argument(
            help="Run folders, bags or .mcap files; two or more.", autocompletion=complete_run
        ),
    ],
    out: Annotated[
        Optional[pathlib.Path],  # noqa: UP045 - typer reads the annotation at run time on 3.10
        folder_option("Folder for plots and numbers; default: bags/compare_DATE_TIME."),
    ] = None,
) -> None:
    """Set runs side by side in tables and plots.

    Compared are errors against the truth, dv per axis and phase, fix rate, latency and TEC. Errors
    of navigation are compared at the epochs that all runs have. Prints a table with one column a
    run and the difference of two, and writes comparison.html with the paper's numbers and overlaid
    plots, and comparison.json.

    Example: vtff compare bags/paper bags/delay_aware
    """
    console = make_console()
    if len(bags) < 2:
        console.print("[red]error:[/red] name at least two bags to compare")
        raise typer.Exit(EXIT_USAGE)
    # Imported here, because rclpy and matplotlib take a while.
    from vtff_analysis.compare.comparison import (
        comparable_summaries,
        names_of_runs,
        read_compared_run,
    )
    from vtff_analysis.compare.page import render_comparison
    from vtff_analysis.compare.plots import plot_comparison

    try:
        for path in bags:
            require_flight(path)
        names = names_of_runs(bags)
        with console.status("reading the bags"):
            runs = [read_compared_run(path, name) for path, name in zip(bags, names, strict=True)]
        folder = output_folder(out, "compare", parent="bags")
    except (BagError, RunFolderError) as error:
        raise exit_with_error(console, error, EXIT_USAGE) from error
    _print_table(console, runs)
    try:
        content = dict(zip(names, comparable_summaries(runs), strict=True))
        text = json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False)
        (folder / COMPARISON_FILE).write_text(text + "\n", encoding="utf-8")
        with console.status("drawing"):
            pictures = plot_comparison(runs, folder)
        page = render_comparison(runs, pictures, command_line(without="--out"))
        (folder / COMPARISON_PAGE).write_text(page, encoding="utf-8")
    except OSError as error:
        raise exit_with_error(console, error, EXIT_FAILURE) from error
    console.print(f"comparison: {folder / COMPARISON_PAGE}", markup=False, soft_wrap=True)


def _print_table(console: Console, runs: list[ComparedRun]) -> None:
    from vtff_analysis.compare.comparison import comparison_table

    heads, sections = comparison_table(runs)
    # What has no room here, the paper's numbers first, stands on the page.
    room = max(len(runs), (console.width - _LABEL_WIDTH) // _NUMBER_WIDTH)
    heads = heads[:room]
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1))
    table.add_column("", no_wrap=True)
    for head in heads:
        table.add_column(escape(head), justify="right", overflow="fold")
    for heading, rows in sections:
        table.add_section()
        table.add_row(f"[bold]{escape(heading)}[/bold]")
        for label, texts in rows:
            table.add_row(f"  {escape(label)}", *texts[:room])
    console.print(table)
    for run in runs:
        for note in run.history.notes:
            print_note(console, f"{run.name}: {note}")
