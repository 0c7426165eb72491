"""The page of the `vtff` command: every command with its arguments and options."""

from __future__ import annotations

import inspect

import click
import typer.main

from vtff_bringup.cli import make_app


def command_page() -> str:
    """Return the page of all commands."""
    lines = ["# Commands", "", "`vtff COMMAND --help` prints the same.", ""]
    command = typer.main.get_command(make_app())
    lines += _describe(command, click.Context(command, info_name="vtff"))
    return "\n".join(lines)


def _describe(command: click.Command, context: click.Context) -> list[str]:
    if isinstance(command, click.Group):
        lines = []
        for name in command.list_commands(context):
            below = command.get_command(context, name)
            assert below is not None
            lines += _describe(below, click.Context(below, info_name=name, parent=context))
        return lines
    help_text = inspect.cleandoc(command.help or "").replace("\b\n", "")
    usage = " ".join(command.collect_usage_pieces(context))
    lines = [f"## {context.command_path}", "", f"`{context.command_path} {usage}`", ""]
    lines += [help_text, "", "| argument or option | meaning |", "|---|---|"]
    for parameter in command.get_params(context):
        record = parameter.get_help_record(context)
        if record is None:  # arguments have no record in older versions of click
            record = (parameter.make_metavar(context), getattr(parameter, "help", "") or "")
        name, meaning = (str(text).replace("|", "\\|") for text in record)
        lines.append(f"| `{name}` | {meaning} |")
    return [*lines, ""]
