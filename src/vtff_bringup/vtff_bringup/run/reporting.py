"""Report of a run for a command; its modules take a second to import, matplotlib among them."""

from __future__ import annotations

import pathlib

from rich.console import Console
from rich.markup import escape

from vtff_analysis.report import write_report
from vtff_bag.file.errors import BagError
from vtff_bringup.run.exit_codes import EXIT_FAILURE, EXIT_INTERRUPTED

__all__ = ["report_run"]


def report_run(console: Console, run_directory: pathlib.Path) -> int:
    """Write the report of a run; return an exit code, 0 if it is written."""
    try:
        write_report(run_directory, console)
    except KeyboardInterrupt:
        console.print("[red]report interrupted[/red]; the bag is complete")
        return EXIT_INTERRUPTED
    except (BagError, OSError) as error:
        console.print(f"[red]error:[/red] no report: {escape(str(error))}")
        return EXIT_FAILURE
    return 0
