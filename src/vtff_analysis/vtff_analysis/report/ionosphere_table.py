"""Table of the ionosphere of a run: the paper's, the measured and the true numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from vtff_analysis.paper_reference import paper_columns
from vtff_analysis.recordings.topics import key_part
from vtff_analysis.report.tables import number_text

__all__ = [
    "IONOSPHERE_HEADS",
    "ionosphere_columns",
    "ionosphere_prefixes",
    "ionosphere_remark",
    "ionosphere_rows",
    "print_ionosphere",
]

IONOSPHERE_HEADS = ("", "paper", "measured", "true")

_SINGLE = "density_error_single_satellite"

_ROWS = (
    ("chief, lower edge at, s", "chief_bottom_time_s", 1),
    ("chief, upper edge at, s", "chief_top_time_s", 1),
    ("deputy, lower edge at, s", "deputy_bottom_time_s", 1),
    ("deputy, upper edge at, s", "deputy_top_time_s", 1),
    ("chief, lower edge, m", "chief_bottom_altitude_m", 0),
    ("chief, upper edge, m", "chief_top_altitude_m", 0),
    ("deputy, lower edge, m", "deputy_bottom_altitude_m", 0),
    ("deputy, upper edge, m", "deputy_top_altitude_m", 0),
    ("vertical edges found, both passes", "vertical_edges", 0),
    ("vertical TEC inside, lower edge, TECU", "vtec_bottom_tecu", 2),
    ("vertical TEC inside, upper edge, TECU", "vtec_top_tecu", 2),
    ("separation from edges, rising, m", "separation_rising_m", 1),
    ("separation from edges, falling, m", "separation_falling_m", 1),
    ("lag of the deputy's fluctuations, s", "lag_s", 2),
    ("first event, latitude, deg", "first_event_latitude_deg", 1),
    ("first event, longitude, deg", "first_event_longitude_deg", 1),
    ("last event, latitude, deg", "last_event_latitude_deg", 1),
    ("last event, longitude, deg", "last_event_longitude_deg", 1),
    ("chief, satellite minutes with S4 > 0.2", "chief_scintillating_minutes", 0),
    ("deputy, satellite minutes with S4 > 0.2", "deputy_scintillating_minutes", 0),
    ("chief, crossing minutes found, %", "chief_scintillation_detected_percent", 1),
    ("deputy, crossing minutes found, %", "deputy_scintillation_detected_percent", 1),
    ("chief, false among the others, %", "chief_scintillation_false_percent", 2),
    ("deputy, false among the others, %", "deputy_scintillation_false_percent", 2),
    ("density of all satellites, mean error, cm-3", "density_error_per_cm3", 0),
    ("  at 480 to 520 km (bubble 1), cm-3", "density_error_bubble_1_per_cm3", 0),
    ("  at 395 to 435 km (bubble 2), cm-3", "density_error_bubble_2_per_cm3", 0),
    ("  at 340 to 380 km (bubble 3), cm-3", "density_error_bubble_3_per_cm3", 0),
    ("density of one satellite, mean error, cm-3", f"{_SINGLE}_per_cm3", 0),
    ("  at 480 to 520 km (bubble 1), cm-3", f"{_SINGLE}_bubble_1_per_cm3", 0),
    ("  at 395 to 435 km (bubble 2), cm-3", f"{_SINGLE}_bubble_2_per_cm3", 0),
    ("  at 340 to 380 km (bubble 3), cm-3", f"{_SINGLE}_bubble_3_per_cm3", 0),
    ("differential TEC error, 1 s, RMS, TECU", "differential_tec_rms_tecu", 4),
    ("chief, slant TEC error, RMS, TECU", "chief_slant_tec_error_rms_tecu", 2),
    ("deputy, slant TEC error, RMS, TECU", "deputy_slant_tec_error_rms_tecu", 2),
)

_REMARK = (
    "Edges: those of the rising pass. true: from the simulator; the paper's own separation was "
    "984.90 m. Density errors: 236 to 567 km, rising, against the truth averaged over the "
    "separation; of all satellites in 1 km bins, of one satellite (as the paper's) each second by "
    "itself. Crossing minutes: rays in a region for at least half of a window of the index."
)
"""Explanation of the numbers, for the line under the table."""


def ionosphere_rows(
    summary: Mapping[str, Any], prefix: str = ""
) -> list[tuple[str, str, str, str]]:
    """Return the texts of the table: label, paper, measured, true.

    Parameters
    ----------
    summary
        Summary of the run, keys of docs/summary.md.
    prefix
        What stands before the keys of one deputy of several.

    Returns
    -------
    list of tuple
        Empty where the run measured no ionosphere.
    """
    columns = paper_columns(summary.get("scenario"))
    printed = {key: value for column in columns for key, value in column.values.items()}
    rows = []
    for label, name, decimals in _ROWS:
        key = f"{prefix}ionosphere_{name}"
        if key in summary:
            printed_value = printed.get(f"ionosphere_{name}")
            true_value = summary.get(f"{prefix}ionosphere_true_{name}")
            values = (printed_value, summary[key], true_value)
            paper, measured, true = (
                "" if value is None else number_text(value, decimals) for value in values
            )
            rows.append((label, paper, measured, true))
    return rows


def ionosphere_columns(
    rows: Sequence[tuple[str, str, str, str]],
) -> tuple[list[str], list[list[str]]]:
    """Return heads and rows without columns that are empty in all rows."""
    kept = [c for c in range(len(IONOSPHERE_HEADS)) if c == 0 or any(row[c] for row in rows)]
    return [IONOSPHERE_HEADS[c] for c in kept], [[row[c] for c in kept] for row in rows]


def ionosphere_remark(summary: Mapping[str, Any]) -> str:
    """Return the line under the tables; empty where nothing in them needs it."""
    return _REMARK if any("ionosphere_true_" in key for key in summary) else ""


def print_ionosphere(
    console: Console, summary: Mapping[str, Any], run_name: str, deputies: Sequence[str]
) -> None:
    """Print a table for each deputy with an ionosphere, unless it is empty."""
    for deputy, prefix in ionosphere_prefixes(deputies):
        _print_rows(console, ionosphere_rows(summary, prefix), f"{run_name}{deputy}")
    if remark := ionosphere_remark(summary):
        console.print(remark, style="dim")


def ionosphere_prefixes(deputies: Sequence[str]) -> list[tuple[str, str]]:
    """Return for each deputy what a title says of it, and the prefix of its keys."""
    if len(deputies) < 2:
        return [("", "")]
    return [(f": {name}", f"{key_part(name)}_") for name in deputies]


def _print_rows(console: Console, rows: Sequence[tuple[str, str, str, str]], run_name: str) -> None:
    if not rows:
        return
    table = Table(
        title=escape(f"{run_name}: ionosphere"),
        title_justify="left",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
    )
    heads, texts = ionosphere_columns(rows)
    for column, head in enumerate(heads):
        table.add_column(head, justify="right" if column else "left", no_wrap=True)
    for row in texts:
        table.add_row(*row)
    console.print(table)
