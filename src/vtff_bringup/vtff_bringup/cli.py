"""The `vtff` command."""

from __future__ import annotations

import gc
import os
import sys
from typing import TYPE_CHECKING

from vtff_bringup.run.exit_codes import EXIT_INTERRUPTED
from vtff_bringup.system.blas_threads import ONE_BLAS_THREAD

if TYPE_CHECKING:
    import typer

#: New objects after which Python looks for garbage in cycles. Imports and files make many objects
#: that stay: with the default, 700, the search takes an eighth of a command, with 100 000 a
#: twentieth.
OBJECTS_BETWEEN_COLLECTIONS = 500_000


def make_app() -> typer.Typer:
    """Return the command line with all its commands."""
    # Imported here, so that `main` catches a Ctrl-C in the second that importing takes.
    import typer

    from vtff_bringup.commands import (
        bag,
        baseline,
        campaign,
        compare,
        export,
        replay,
        report,
        reprocess,
        run,
        study,
        tec,
        view,
    )
    from vtff_bringup.discover import guidance, list_installed, node, survey, topic, version

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
    app.command("run", no_args_is_help=True)(run.run)
    app.command("replay", no_args_is_help=True)(replay.replay)
    app.command("reprocess", no_args_is_help=True)(reprocess.reprocess)
    app.command("report", no_args_is_help=True)(report.report)
    app.command("compare", no_args_is_help=True)(compare.compare)
    app.command("export", no_args_is_help=True)(export.export)
    app.command("view", no_args_is_help=True)(view.view)
    app.command("baseline", no_args_is_help=True)(baseline.baseline)
    app.command("campaign", no_args_is_help=True)(campaign.campaign)
    app.command("tec", no_args_is_help=True)(tec.tec)
    app.command("list")(list_installed.list_installed)
    app.command("node", no_args_is_help=True, add_help_option=False)(node.node)
    app.command("survey", no_args_is_help=True)(survey.survey)
    app.add_typer(topic.app, name="topic")
    app.add_typer(guidance.app, name="guidance")
    app.add_typer(bag.app, name="bag")
    app.add_typer(study.app, name="study")
    return app


def main() -> None:
    """Run the command line."""
    gc.set_threshold(OBJECTS_BETWEEN_COLLECTIONS)
    os.environ.update({**ONE_BLAS_THREAD, **os.environ})
    try:
        make_app()(prog_name="vtff")
    except KeyboardInterrupt:
        sys.exit(EXIT_INTERRUPTED)


if __name__ == "__main__":
    main()
