"""Comparison of runs: the same numbers of all runs side by side."""

from __future__ import annotations

import dataclasses
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vtff_analysis.compare.common_epochs import summarise_common_epochs
from vtff_analysis.evaluation.formation_flight import (
    SETTLED_AFTER,
    FormationFlight,
    formation_flight,
)
from vtff_analysis.evaluation.navigation import NavigationError, navigation_error
from vtff_analysis.evaluation.summary import plain_value, summarise_flight, summarise_run
from vtff_analysis.paper_reference import formation_columns
from vtff_analysis.recordings.history import AXES, DeputyHistory, RunHistory
from vtff_analysis.recordings.ionosphere_truth import GNSS_ARGUMENT
from vtff_analysis.recordings.recording import read_run
from vtff_analysis.recordings.run_place import find_run
from vtff_analysis.recordings.settings import read_settings
from vtff_analysis.report.tables import (
    MILLIMETRES,
    Row,
    incomparable_keys,
    paper_text,
    scaled_text,
)
from vtff_bag.file.reader import BagReader
from vtff_bag.run.description import describe_run
from vtff_nav.relative.common.solution import SOLUTION_FIXED

#: Heading and rows of the table.
SECTIONS: tuple[tuple[str, tuple[Row, ...]], ...] = (
    (
        "run",
        (
            Row("length, s", "run_duration_s", 0),
            Row("times real time", "real_time_factor", 0),
            Row("late commands", "late_commands", 0),
        ),
    ),
    (
        "control",
        (
            Row("compared, s", "common_duration_s", 0),
            Row("closest approach, m", "minimum_separation_m", 2),
            Row("minimum in-track, m", "minimum_in_track_m", 2),
            Row("settled, s", "settling_time_s", 0),
            *(Row(f"  {axis}", f"settling_time_{axis}_s", 0) for axis in AXES),
            *(
                Row(f"keeping RMS {axis}, mm", f"keeping_{axis}_rms_m", 2, MILLIMETRES)
                for axis in AXES
            ),
            *(
                Row(
                    f"  from {SETTLED_AFTER:.0f} s on {axis}, mm",
                    f"settled_keeping_{axis}_rms_m",
                    2,
                    MILLIMETRES,
                )
                for axis in AXES
            ),
            Row("  dv in an hour, m/s", "settled_keeping_delta_v_m_per_s_per_h", 4),
        ),
    ),
    *(
        (
            f"dv {phase}, m/s",
            tuple(Row(f"  {axis}", f"delta_v_{phase}_{axis}_m_per_s", 4) for axis in AXES),
        )
        for phase in ("acquisition", "keeping", "total")
    ),
    (
        "navigation against truth",
        (
            Row("epochs with a solution", "navigation_epochs", 0),
            Row("epochs that all have", "navigation_common_epochs", 0),
            *(
                Row(f"  RMS {axis}, mm", f"navigation_common_{axis}_rms_m", 3, MILLIMETRES)
                for axis in AXES
            ),
            Row("  largest, mm", "navigation_common_maximum_m", 3, MILLIMETRES),
            Row("  settled in all", "navigation_common_settled_epochs", 0),
            Row("    3-D RMS, mm", "navigation_common_settled_3d_rms_m", 3, MILLIMETRES),
            Row("within 3 sigma, %", "navigation_within_three_sigma_percent", 1),
            Row("fixed, % of the time", "navigation_fixed_percent", 1),
            Row("first fixed, s", "navigation_first_fixed_s", 0),
        ),
    ),
    (
        "latency",
        (
            Row("of a step, sum of nodes, median, ms", "step_compute_time_median_ms", 3),
            Row("  99 % below, ms", "step_compute_time_99_percent_ms", 3),
        ),
    ),
    (
        "ionosphere",
        (
            Row("mean vertical TEC, TECU", "vertical_tec_mean_tecu", 2),
            Row("largest S4", "s4_maximum", 3),
        ),
    ),
)

#: Headings of the sections that do not belong to one deputy.
_RECORDER = "/bag_recorder"
_SECTIONS_OF_RUN = ("run", "latency", "ionosphere")


@dataclasses.dataclass(frozen=True, eq=False)
class ComparedRun:
    """One run of a comparison.

    Attributes
    ----------
    name
        Name in tables and plots; unique in the comparison.
    summary
        Numbers by the keys of docs/summary.md and of `SECTIONS`.
    flights, errors
        Flights and errors of navigation by deputy.
    history
        The run as recorded.
    """

    name: str
    summary: dict[str, Any]
    flights: dict[str, FormationFlight]
    errors: dict[str, NavigationError]
    history: RunHistory


def read_compared_run(path: pathlib.Path, name: str) -> ComparedRun:
    """Read a run folder or bag.

    Raises
    ------
    vtff_bag.file.errors.BagReadError
        If there is no bag or nothing in it can be read.
    """
    run_path = find_run(path)
    history = read_run(run_path.bag)
    described = describe_run(run_path.folder, BagReader(run_path.bag).custom_data)
    settings = read_settings(described)
    flights = {}
    errors = {}
    for deputy, recorded in history.deputies.items():
        flight = formation_flight(recorded, settings.controller(deputy))
        error = navigation_error(recorded)
        if flight is not None:
            flights[deputy] = flight
        if error is not None:
            errors[deputy] = error
    summary = summarise_run(history, settings, flights)
    if GNSS_ARGUMENT in described.arguments:
        # Its name: the same world has another path on another machine.
        world = pathlib.PurePath(str(described.arguments[GNSS_ARGUMENT])).name
        summary[f"argument_{GNSS_ARGUMENT}"] = world
    for deputy, recorded in history.deputies.items():
        prefix = f"{deputy}_" if len(flights) > 1 else ""
        quality = _summarise_navigation(recorded, errors.get(deputy))
        summary.update({f"{prefix}{key}": plain_value(value) for key, value in quality.items()})
    summary.update({key: plain_value(value) for key, value in _summarise_latency(history).items()})
    summary.update(
        {key: plain_value(value) for key, value in _summarise_ionosphere(history).items()}
    )
    return ComparedRun(name, summary, flights, errors, history)


def names_of_runs(paths: Sequence[pathlib.Path]) -> list[str]:
    """Return a short unique name for each run: its folder, with a number where two are alike."""
    names = [find_run(path).name for path in paths]
    unique = []
    for index, name in enumerate(names):
        earlier = names[:index].count(name)
        unique.append(f"{name} ({earlier + 1})" if names.count(name) > 1 else name)
    return unique


def comparable_summaries(runs: Sequence[ComparedRun]) -> list[dict[str, Any]]:
    """Return the numbers of each run, those of flight and navigation over what all runs have.

    Flights are cut where the shortest ends, errors of navigation are those of common epochs.
    """
    summaries = [dict(run.summary) for run in runs]
    for deputy in sorted({name for run in runs for name in run.flights}):
        flights = {i: run.flights[deputy] for i, run in enumerate(runs) if deputy in run.flights}
        end = min(float(flight.time[-1]) for flight in flights.values())
        for index, flight in flights.items():
            numbers = {"common_duration_s": end, **summarise_flight(flight.until(end))}
            prefix = _prefix(runs[index], deputy)
            # What a shorter flight does not have is no figure of the common time.
            for key in summarise_flight(flight):
                summaries[index].pop(prefix + key, None)
            summaries[index].update({prefix + k: plain_value(v) for k, v in numbers.items()})
    for deputy in sorted({name for run in runs for name in run.errors}):
        having = [index for index, run in enumerate(runs) if deputy in run.errors]
        common = summarise_common_epochs([runs[index].errors[deputy] for index in having])
        for index, numbers in zip(having, common, strict=True):
            prefix = _prefix(runs[index], deputy)
            summaries[index].update({prefix + key: value for key, value in numbers.items()})
    return summaries


def comparison_table(
    runs: Sequence[ComparedRun],
) -> tuple[list[str], list[tuple[str, list[tuple[str, list[str]]]]]]:
    """Return the table as texts: one column a run, the difference of two, and the paper's.

    Returns
    -------
    heads, sections
        Heads of the columns of numbers; heading and rows of each section, a row is a label and one
        text for each head.
    """
    scenarios = {run.summary.get("scenario") for run in runs}
    papers = formation_columns(scenarios.pop()) if len(scenarios) == 1 else ()
    is_pair = len(runs) == 2
    heads = [run.name for run in runs]
    heads += ["difference"] * is_pair + [column.title.replace("\n", " ") for column in papers]
    left_out = incomparable_keys(min(run.summary["run_duration_s"] for run in runs))
    sections = []
    for heading, rows in comparison_rows(runs):
        shown = []
        for row, values in rows:
            texts = [_value_text(value, row) for value in values]
            if is_pair:
                texts.append(_difference_text(values, row))
            texts += ["" if row.key in left_out else paper_text(paper, row) for paper in papers]
            shown.append((row.label, texts))
        sections.append((heading, shown))
    return heads, sections


def _value_text(value: Any, row: Row) -> str:
    """Return a number, ``not yet`` where it does not exist, a blank without its subject."""
    if value is ...:
        return ""
    return "not yet" if value is None else scaled_text(value, row.decimals, row.scale)


def _difference_text(values: Sequence[Any], row: Row) -> str:
    """Return the second value less the first; a blank where one is missing."""
    if any(value is ... or value is None for value in values):
        return ""
    return f"{(values[1] - values[0]) * row.scale:+.{row.decimals}f}"


def comparison_rows(
    runs: Sequence[ComparedRun],
) -> list[tuple[str, list[tuple[Row, list[Any]]]]]:
    """Return the table: heading and rows of each section that any run has.

    Returns
    -------
    list
        Heading and rows; a row has one value for each run: None where the number does not exist,
        ``...`` (Ellipsis) where the run has no such subject.
    """
    summaries = comparable_summaries(runs)
    prefixes = sorted({_prefix(run, deputy) for run in runs for deputy in run.flights} or {""})
    sections = []
    for prefix in prefixes:
        for heading, section in SECTIONS:
            is_of_run = heading in _SECTIONS_OF_RUN
            if is_of_run and prefix != prefixes[0]:
                continue
            section_prefix = "" if is_of_run else prefix
            rows = []
            for row in section:
                values = [summary.get(section_prefix + row.key, ...) for summary in summaries]
                if any(value is not ... for value in values):
                    rows.append((row._replace(label=row.label.replace("_", "-")), values))
            if rows:
                sections.append((f"{section_prefix.rstrip('_')} {heading}".strip(), rows))
    return sections


def _prefix(run: ComparedRun, deputy: str) -> str:
    return f"{deputy}_" if len(run.flights) > 1 else ""


def _summarise_navigation(
    recorded: DeputyHistory, error: NavigationError | None
) -> Mapping[str, Any]:
    numbers: dict[str, Any] = {}
    inside = None if error is None else error.fraction_within_three_sigma()
    if inside is not None:
        numbers["navigation_within_three_sigma_percent"] = 100.0 * float(inside.mean())
    quality = recorded.navigation
    if quality is not None and quality.time.size:
        fixed = quality.solution == SOLUTION_FIXED
        numbers["navigation_fixed_percent"] = 100.0 * float(fixed.mean())
        states = recorded.truth or recorded.estimate
        assert states is not None
        first = np.flatnonzero(fixed)
        numbers["navigation_first_fixed_s"] = (
            float((quality.time[first[0]] - states.time[0]) * 1e-9) if first.size else None
        )
    return numbers


def _summarise_latency(history: RunHistory) -> Mapping[str, Any]:
    """Sum the wall times that the nodes took for the same step."""
    # A run in which the recorder alone acknowledges steps does not know what its nodes took.
    nodes = {node: t for node, t in history.compute_time.items() if not node.endswith(_RECORDER)}
    complete = [times for times in nodes.values() if times.size > 1]
    longest = max((times.size for times in complete), default=0)
    # Side branches acknowledge only some steps: their times do not add up with the others.
    chain = [times for times in complete if times.size > 0.9 * longest]
    if not chain:
        return {}
    shortest = min(times.size for times in chain)
    sums = np.sum([times[:shortest] for times in chain], axis=0) * 1e3
    return {
        "step_compute_time_median_ms": float(np.median(sums)),
        "step_compute_time_99_percent_ms": float(np.quantile(sums, 0.99)),
    }


def _summarise_ionosphere(history: RunHistory) -> Mapping[str, Any]:
    numbers: dict[str, Any] = {}
    vertical = _join_finite([c.values["vtec_tecu"] for c in history.slant_tec.values()])
    s4 = _join_finite([c.values["s4"] for c in history.scintillation.values()])
    if vertical.size:
        numbers["vertical_tec_mean_tecu"] = float(vertical.mean())
    if s4.size:
        numbers["s4_maximum"] = float(s4.max())
    return numbers


def _join_finite(columns: Sequence[Any]) -> Any:
    values = np.concatenate([np.empty(0), *columns])
    return values[np.isfinite(values)]
