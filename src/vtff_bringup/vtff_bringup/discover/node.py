"""`vtff node`: what a node does, and its parameters with units, ranges and defaults."""

from __future__ import annotations

from typing import Annotated

import typer

from vtff_bringup.discover.completion import complete_node
from vtff_bringup.discover.installed import nodes
from vtff_bringup.run.console import make_console
from vtff_bringup.run.errors import exit_with_error
from vtff_bringup.run.exit_codes import EXIT_USAGE


def node(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NODE", help="As in `vtff list nodes`.", autocompletion=complete_node
        ),
    ],
    show_help: Annotated[
        bool, typer.Option("--help", "-h", help="The same as without: the node's parameters.")
    ] = False,
) -> None:
    """Show what a node does, and its parameters.

    Each parameter with its unit, its range or choices, and its default. A parameter is set with
    NODE.PARAMETER:=VALUE after `vtff run SYSTEM`. Example: vtff node sdre_controller --help
    """
    console = make_console()
    installed = {installed_name: package for installed_name, package, _ in nodes()}
    if name not in installed:
        text = f"no node '{name}'; there are: {', '.join(sorted(installed))}"
        raise exit_with_error(console, text, EXIT_USAGE)
    # Imported here, because rclpy takes a while.
    from vtff_node.executables import node_class
    from vtff_node.main import help_text

    print(help_text(node_class(installed[name], name)))
