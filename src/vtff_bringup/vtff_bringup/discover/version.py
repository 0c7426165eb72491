"""`vtff --version`."""

from __future__ import annotations

from typing import Annotated

import typer


def print_version(wanted: bool) -> None:
    """Print version and commit, and end the command, if that is wanted."""
    if not wanted:
        return
    from vtff_bag.run.environment import describe_environment

    environment = describe_environment()
    commit = environment["git_commit"]
    changed = ", with changes" if environment["git_modified"] else ""
    where = f" (commit {commit[:12]}{changed})" if commit else ""
    typer.echo(f"vtff {environment['vtff_version'] or 'of no installed package'}{where}")
    raise typer.Exit


def common_options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Version and commit.", is_eager=True, callback=print_version
        ),
    ] = False,
) -> None:
    """Take the options that stand before the name of a command."""
