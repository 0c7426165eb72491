"""The `vtff` command."""

from __future__ import annotations

import importlib
import os
import sys
from typing import TYPE_CHECKING, Any

from vtff_bringup.run.exit_codes import EXIT_INTERRUPTED
from vtff_bringup.system.blas_threads import ONE_BLAS_THREAD

if TYPE_CHECKING:
    import typer

#: The commands in the order of the help: module and function, or app of a group.
_COMMANDS = {
    "run": "commands.run:run",
    "replay": "commands.replay:replay",
    "reprocess": "commands.reprocess:reprocess",
    "report": "commands.report:report",
    "compare": "commands.compare:compare",
    "export": "commands.export:export",
    "view": "commands.view:view",
    "baseline": "commands.baseline:baseline",
    "campaign": "commands.campaign:campaign",
    "tec": "commands.tec:tec",
    "list": "discover.list_installed:list_installed",
    "node": "discover.node:node",
    "survey": "discover.survey:survey",
    "topic": "discover.topic:app",
    "guidance": "discover.guidance:app",
    "bag": "commands.bag:app",
    "study": "commands.study:app",
}
#: What `typer.Typer.command` is told of a command that is not shown its help without arguments, or
#: makes its help itself.
_COMMAND_OPTIONS: dict[str, dict[str, Any]] = {
    "list": {},
    "node": {"no_args_is_help": True, "add_help_option": False},
}


def make_app() -> typer.Typer:
    """Return the command line with all its commands."""
    # Imported here, so that `main` catches a Ctrl-C in the second that importing takes.
    import typer

    from vtff_bringup.discover import version

    app = typer.Typer(
        name="vtff",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
    )
    help_text = (
        "Formation-flying and ionosphere testbed: run systems, look at bags, make studies.\n\n"
        "Exit codes: 0 complete, 1 something failed on the way, 2 a file, an argument or a "
        "parameter is wrong, 130 interrupted by Ctrl-C.\n\n"
        "For a begin: vtff run reference --duration 300; vtff list; vtff view bags/sample"
    )
    app.callback(help=help_text)(version.common_options)
    for name, place in _COMMANDS.items():
        module, _, attribute = place.partition(":")
        found = getattr(importlib.import_module(f"vtff_bringup.{module}"), attribute)
        if attribute == "app":
            app.add_typer(found, name=name)
        else:
            app.command(name, **_COMMAND_OPTIONS.get(name, {"no_args_is_help": True}))(found)
    return app


def main() -> None:
    """Run the command line."""
    os.environ.update({**ONE_BLAS_THREAD, **os.environ})
    try:
        make_app()(prog_name="vtff")
    except KeyboardInterrupt:
        sys.exit(EXIT_INTERRUPTED)


if __name__ == "__main__":
    main()
