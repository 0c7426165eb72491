"""Report of a run: ``report/summary.json``, plots, and tables on the console."""

from __future__ import annotations

import json
import pathlib
from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.markup import escape

from vtff_bringup.report.environment import describe_environment
from vtff_bringup.report.plots import plot_formation, plot_receiver
from vtff_bringup.report.recording import read_run
from vtff_bringup.report.settings import read_settings
from vtff_bringup.report.summary import formation_flight, key_part, plain, summarise_run
from vtff_bringup.report.tables import print_formation, print_message_counts, print_receivers

REPORT_FOLDER = "report"
SUMMARY_FILE = "summary.json"


def write_report(
    run_directory: pathlib.Path, console: Console, arguments: Mapping[str, Any]
) -> pathlib.Path:
    """Write the report of a run from its bag and print its tables.

    Parameters
    ----------
    run_directory
        Folder of the run with the bag in ``bag`` and the parameter files in ``parameters``.
    console
        Where the tables go.
    arguments
        Name of the system under ``system``, and the arguments that it was run with.

    Returns
    -------
    pathlib.Path
        The report folder: ``summary.json`` with the keys of docs/summary.md, and PNG plots of
        every part that the run has.

    Raises
    ------
    vtff_bringup.bag.errors.BagReadError
        If there is no bag or nothing in it can be read.
    OSError
        If the report cannot be written.
    """
    run_directory = pathlib.Path(run_directory).resolve()
    history = read_run(run_directory / "bag")
    settings = read_settings(run_directory)
    found = {
        name: formation_flight(deputy, settings.controller(name))
        for name, deputy in history.deputies.items()
    }
    flights = {name: flight for name, flight in found.items() if flight is not None}
    summary = {
        "run_name": run_directory.name,
        **_named_arguments(arguments),
        **describe_environment(),
        **summarise_run(history, settings, flights),
    }
    folder = run_directory / REPORT_FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(summary, indent=1, allow_nan=False, ensure_ascii=False)
    (folder / SUMMARY_FILE).write_text(text + "\n", encoding="utf-8")
    scenario = history.simulator.scenario if history.simulator is not None else ""
    for name, flight in flights.items():
        prefix = f"{key_part(name)}_" if len(flights) > 1 else ""
        cap = settings.controller(name).acceleration_cap
        plot_formation(flight, folder, prefix, run_directory.name, scenario, cap)
    for receiver in history.receivers.values():
        plot_receiver(receiver, folder, f"{key_part(receiver.name)}_", run_directory.name)
    if flights:
        print_formation(console, summary, list(flights), run_directory.name)
    if history.receivers:
        print_receivers(console, summary, list(history.receivers), run_directory.name)
    if not flights and not history.receivers:
        print_message_counts(console, history.message_counts, run_directory.name)
    for note in (*history.notes, *settings.notes):
        console.print(f"[yellow]note:[/yellow] {escape(note)}")
    console.print(f"report: {escape(str(folder))}")
    return folder


def _named_arguments(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return the system under its own key and each argument as ``argument_<name>``."""
    return {
        key if key == "system" else f"argument_{key}": _flat(value)
        for key, value in arguments.items()
    }


def _flat(value: Any) -> Any:
    """Return a number or text; lists and mappings as JSON text, to keep the summary flat."""
    value = plain(value)
    if value is None or isinstance(value, (str, int, float, bool)):
        return value
    return json.dumps(value, default=str)
