"""`vtff bag`: content of a bag, and recovery of a damaged one."""

from __future__ import annotations

import pathlib
from typing import Annotated, Optional

import typer

from vtff_bag.file.errors import BagError, BagExistsError, BagReadError
from vtff_bringup.commands.command_line import RecordedRun, folder_option
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_USAGE

app = typer.Typer(help="Look at bags and recover damaged ones.", no_args_is_help=True)


@app.command("info", no_args_is_help=True)
def info_command(
    path: RecordedRun,
) -> None:
    """Show topics, types, counts, times and the state of a bag."""
    from vtff_bag.file.info import describe_bag

    try:
        typer.echo(describe_bag(path))
    except BagError as error:
        raise _exit_with_error(error) from error


@app.command("recover", no_args_is_help=True)
def recover_command(
    path: RecordedRun,
    out: Annotated[
        Optional[pathlib.Path],  # noqa: UP045 - typer reads the annotation at run time on 3.10
        folder_option("Folder to write; default: BAG_recovered beside it."),
    ] = None,
) -> None:
    """Copy what is intact into a new, complete bag.

    The original is not touched.
    """
    from vtff_bag.file.recover import recover

    try:
        typer.echo(str(recover(path, out)))
    except BagError as error:
        raise _exit_with_error(error) from error


def _exit_with_error(error: BagError) -> typer.Exit:
    # On standard error: the recovered path on standard output is for scripts.
    typer.echo(f"error: {error}", err=True)
    return typer.Exit(
        EXIT_USAGE if isinstance(error, (BagReadError, BagExistsError)) else EXIT_FAILURE
    )
