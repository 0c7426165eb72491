"""`vtff study`: parameter studies in one process, without ROS."""

from __future__ import annotations

import typer

app = typer.Typer(help="Parameter studies in one process, without ROS.", no_args_is_help=True)
