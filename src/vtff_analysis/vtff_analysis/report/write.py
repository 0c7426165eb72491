"""Report of a run: ``report.html``, ``summary.json``, plots, and tables on the console."""

from __future__ import annotations

import dataclasses
import json
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape

from vtff_analysis.closed_loop.truth_fed import summarise_truth_fed
from vtff_analysis.evaluation.fluctuations import read_fluctuation_lag
from vtff_analysis.evaluation.formation_flight import SETTLED_AFTER, formation_flight
from vtff_analysis.evaluation.ionosphere import summarise_ionosphere
from vtff_analysis.evaluation.receiver_comparison import compare_with_receiver
from vtff_analysis.evaluation.safety import passing_sentences, safety_sentences
from vtff_analysis.evaluation.scintillation import scintillating_windows
from vtff_analysis.evaluation.summary import plain_value, summarise_run
from vtff_analysis.recordings.errors import RecordingError
from vtff_analysis.recordings.history import RunHistory
from vtff_analysis.recordings.ionosphere_truth import IonosphereTruth, read_ionosphere_truth
from vtff_analysis.recordings.orbits import read_orbits
from vtff_analysis.recordings.recording import read_run
from vtff_analysis.recordings.run_place import find_run
from vtff_analysis.recordings.settings import RunSettings, read_settings
from vtff_analysis.recordings.topics import key_part
from vtff_analysis.report.html import render_report
from vtff_analysis.report.ionosphere_table import print_ionosphere
from vtff_analysis.report.pictures import draw_pictures
from vtff_analysis.report.tables import print_formation, print_message_counts, print_receivers
from vtff_analysis.report.verdict import find_verdict
from vtff_analysis.survey.figures import simulated_regions, survey_sentences
from vtff_analysis.survey.truth import summarise_survey_truth
from vtff_bag.file.reader import BagReader
from vtff_bag.run.description import RunDescription, describe_run
from vtff_bag.run.environment import describe_environment
from vtff_dynamics.time.timescales import GpsTime
from vtff_sim_bridge.atmosphere.walls import WallTruth, find_wall_truth

REPORT_FOLDER = "report"
SUMMARY_FILE = "summary.json"
HTML_FILE = "report.html"
_SURVEY_INTERVAL = 10.0  # s between true states: the speed over the Earth is even
PROCESSOR_TOPIC = "/iono/slant_tec"  # end of the ionosphere processor's topics of contents


def write_report(
    path: pathlib.Path,
    console: Console,
    arguments: Mapping[str, Any] | None = None,
    output: pathlib.Path | None = None,
) -> pathlib.Path:
    """Write the report of a run from its bag and print its tables.

    Parameters
    ----------
    path
        Run folder with the bag in ``bag`` and the parameter files in ``parameters``, or a bag
        alone: directory or ``.mcap`` file.
    console
        Console that the tables are printed on.
    arguments
        Name of the system under ``system``, and the arguments that it was run with. If they are
        not given, those that the run folder or the bag records.
    output
        Folder for the report. If it is not given, ``report`` in the run folder, or
        ``<bag>_report`` beside a bag that has none.

    Returns
    -------
    pathlib.Path
        The report folder with ``report.html``, ``summary.json`` with the keys of docs/summary.md,
        and PNG plots of every subject that the run has.

    Raises
    ------
    vtff_bag.file.errors.BagReadError
        If there is no bag or nothing in it can be read.
    OSError
        If the report cannot be written.
    """
    run_path = find_run(pathlib.Path(path))
    history = read_run(run_path.bag)
    reader = BagReader(run_path.bag)
    described = describe_run(run_path.folder, reader.custom_data)
    if arguments is not None:
        described = dataclasses.replace(described, arguments=dict(arguments))
    settings = read_settings(described)
    flights = {}
    for name, deputy in history.deputies.items():
        flight = formation_flight(deputy, settings.controller(name))
        if flight is not None:
            flights[name] = flight
    truth = None
    processed = [topic for topic in history.slant_tec if topic.endswith(PROCESSOR_TOPIC)]
    if processed or any(pair.density is not None for pair in history.pairs.values()):
        truth = read_ionosphere_truth(reader, described, run_path.folder)
    wall_truth = _read_wall_truth(history, described, reader)
    summary = {
        "run_name": run_path.name,
        **_named_arguments(described.arguments),
        **(described.environment or describe_environment()),
        **summarise_run(history, settings, flights),
        **_summarise_truth_fed(history, described, settings, list(flights)),
        **_summarise_ionosphere(history, reader, truth),
        **_summarise_survey(history, wall_truth),
    }
    folder = output or run_path.output_folder(REPORT_FOLDER)
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(summary, indent=1, allow_nan=False, ensure_ascii=False)
    (folder / SUMMARY_FILE).write_text(text + "\n", encoding="utf-8")
    pictures = draw_pictures(history, settings, flights, folder, run_path.name, truth, wall_truth)
    safety = safety_sentences(history.safety, history.start_time)
    notes = (*history.notes, *settings.notes, *safety)
    survey = survey_sentences(history.survey, history.start_time)
    remarks = (*passing_sentences(history.safety), *survey)
    page = render_report(summary, history, described, list(flights), pictures, notes, remarks)
    (folder / HTML_FILE).write_text(page, encoding="utf-8")
    _print_tables(console, summary, history, list(flights), run_path.name)
    verdict = find_verdict(summary, list(flights))
    for note in notes:
        console.print(f"[yellow]note:[/yellow] {escape(note)}")
    for remark in remarks:
        console.print(escape(remark), style="dim")
    style = "bold" if verdict.is_good else "bold red"
    console.print(f"[{style}]{escape(verdict.sentence)}[/{style}]")
    console.print(escape(verdict.conditions), style="dim")
    console.print(f"report: {escape(str(folder / HTML_FILE))}", soft_wrap=True)
    return folder


def _summarise_truth_fed(
    history: RunHistory, described: RunDescription, settings: RunSettings, deputies: Sequence[str]
) -> dict[str, Any]:
    """Return how the twins of navigated deputies keep the formation; empty for short runs."""
    duration = (history.end_time - history.start_time) * 1e-9
    summary: dict[str, Any] = {}
    for name in deputies:
        if history.deputies[name].estimate is None or duration <= SETTLED_AFTER:
            continue
        prefix = f"{key_part(name)}_" if len(deputies) > 1 else ""
        twin = summarise_truth_fed(described, name, settings.seed, duration)
        summary.update({prefix + key: value for key, value in twin.items()})
    return summary


def _summarise_ionosphere(
    history: RunHistory, reader: BagReader, truth: IonosphereTruth | None
) -> dict[str, Any]:
    """Return the numbers of the ionosphere by their keys; several deputies each have their own."""
    summary: dict[str, Any] = {}
    windows, length = scintillating_windows(history)
    pairs = history.pair_histories()
    for pair in pairs:
        lag = None
        if len(windows):
            start, end = int(windows[0]) - length, int(windows[-1])
            fluctuation_lag = read_fluctuation_lag(reader, (pair.chief, pair.deputy), start, end)
            lag = None if fluctuation_lag is None else fluctuation_lag.lag
        prefix = f"{key_part(pair.deputy)}_" if len(pairs) > 1 else ""
        numbers = summarise_ionosphere(pair, truth, lag)
        summary.update({prefix + key: value for key, value in numbers.items()})
    for comparison in compare_with_receiver(history):
        summary.update(comparison.summarise())
    return {key: plain_value(value) for key, value in summary.items()}


def _read_wall_truth(
    history: RunHistory, described: RunDescription, reader: BagReader
) -> WallTruth | None:
    """Return the emulated bubbles of a survey and what was truly crossed; None without a survey."""
    if history.survey is None:
        return None
    start = GpsTime.from_unix_nanoseconds(history.start_time)
    regions = simulated_regions(described)
    try:
        orbits = read_orbits(reader, _SURVEY_INTERVAL) if regions else []
    except RecordingError:  # no orbit: nothing is known of true crossings
        orbits = []
    tracks = {
        orbit.name: (np.array([time - start for time in orbit.time]), orbit.state_itrf[:, :3])
        for orbit in orbits
        if orbit.source == "truth"
    }
    return find_wall_truth(regions, start, tracks)


def _summarise_survey(history: RunHistory, truth: WallTruth | None) -> dict[str, Any]:
    """Return the numbers of a survey beside the truth; empty without one."""
    if history.survey is None or truth is None:
        return {}
    return summarise_survey_truth(history.survey, truth)


def _print_tables(
    console: Console,
    summary: Mapping[str, Any],
    history: RunHistory,
    deputies: Sequence[str],
    run_name: str,
) -> None:
    if deputies:
        print_formation(console, summary, deputies, run_name)
    if history.receivers:
        print_receivers(console, summary, list(history.receivers), run_name)
    print_ionosphere(console, summary, run_name, list(history.pairs))
    if not deputies and not history.receivers:
        print_message_counts(console, history.message_counts, run_name)


def _named_arguments(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return the system under its own key and each argument as ``argument_<name>``."""
    return {
        key if key == "system" else f"argument_{key}": _flatten(value)
        for key, value in arguments.items()
    }


def _flatten(value: Any) -> Any:
    """Return a number or text; lists and mappings as JSON text, to keep the summary flat."""
    value = plain_value(value)
    if value is None or isinstance(value, (str, int, float, bool)):
        return value
    return json.dumps(value, default=str)
