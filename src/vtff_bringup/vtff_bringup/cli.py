"""The `vtff` command."""

from __future__ import annotations

import typer

from vtff_bringup.commands import bag, run, study

app = typer.Typer(
    name="vtff",
    help="Formation-flying and ionosphere testbed: run systems, look at bags, make studies.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
app.command("run", no_args_is_help=True)(run.run)
app.add_typer(bag.app, name="bag")
app.add_typer(study.app, name="study")


def main() -> None:
    """Run the command line."""
    app()


if __name__ == "__main__":
    main()
