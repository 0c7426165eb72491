"""Report of a campaign: one HTML page made of its table."""

from __future__ import annotations

import math
import pathlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from vtff_analysis.page.page import render_template
from vtff_analysis.studies.bounds import Bound, Verdict
from vtff_analysis.studies.campaign_charts import (
    Column,
    association,
    draw_distributions,
    draw_drivers,
    draw_scatter,
)
from vtff_analysis.studies.figures import describe_name, unit_of

__all__ = ["CampaignDescription", "render_campaign_report"]

_PERCENTILES = (0, 5, 25, 50, 75, 95, 100)
_WORST = 3  # cases shown of each figure
_MOST_FAILED = 50
_MOST_MEDIANS = 4  # in the sentence that opens the page
_LARGEST_POWER = 6  # of ten, of numbers that are written without an exponent
_TEMPLATE = "campaign_report.html.j2"


@dataclass(frozen=True)
class CampaignDescription:
    """Facts of a campaign that a report shows beside its table.

    Attributes
    ----------
    name, description
        Name and description of the campaign.
    inputs
        Unit by name of each variable, empty for none.
    figures
        Names of the figures.
    verdicts
        On its bounds.
    planned
        Number of its cases.
    repeat
        Returns the command that flies a case again, by its number.
    facts
        How it was flown: pairs of a label and a text.
    """

    name: str
    description: str
    inputs: Mapping[str, str]
    figures: Sequence[str]
    verdicts: Sequence[Verdict]
    planned: int
    repeat: Callable[[int], str]
    facts: Sequence[tuple[str, str]]


@dataclass(frozen=True)
class _WorstCase:
    figure: str
    why: str
    number: int
    value: str
    inputs: str
    command: str


def render_campaign_report(table: pa.Table, description: CampaignDescription) -> str:
    """Return the HTML text of a report.

    Parameters
    ----------
    table
        Table of the campaign, a row a case, with columns ``case``, ``status``, ``reason``,
        ``wall_time_s``, ``processor_time_s``, and those of inputs and figures.
    description
        Facts that the table does not hold.
    """
    status = table["status"].to_pylist()
    complete = table.filter(pa.array([state == "complete" for state in status]))
    figures = [_column(complete, name, unit_of(name)) for name in description.figures]
    drivers = [_column(complete, name, unit) for name, unit in description.inputs.items()]
    drivers = [column for column in drivers if len(np.unique(column.values)) > 1]
    filled = [figure for figure in figures if np.isfinite(figure.values).any()]
    rows = [_percentile_row(figure) for figure in figures]
    pairs = [pair for pair in (_strongest(drivers, figure) for figure in filled) if pair]
    return render_template(
        _TEMPLATE,
        pathlib.Path(__file__).resolve().parent,
        title=description.name,
        campaign=description,
        complete=complete.num_rows,
        failed=_failed(table, description),
        failed_count=table.num_rows - complete.num_rows,
        wall_time=_total(table, "wall_time_s"),
        processor_time=_total(table, "processor_time_s"),
        percentiles=_PERCENTILES,
        rows=rows,
        medians=[
            _median_text(row, figure)
            for row, figure in list(zip(rows, figures, strict=True))[:_MOST_MEDIANS]
            if row["count"] and not figure.categories
        ],
        distributions=draw_distributions(figures) if filled else "",
        drivers=draw_drivers(drivers, filled) if drivers and filled else "",
        chance=2.0 / np.sqrt(max(complete.num_rows, 1)),
        has_categories=any(column.categories for column in drivers),
        scatter=draw_scatter(pairs) if pairs else "",
        worst=_worst_cases(complete, figures, description),
    )


def _column(table: pa.Table, name: str, unit: str) -> Column:
    content = table[name]
    if pa.types.is_string(content.type):
        texts = content.to_pylist()
        categories = tuple(sorted(set(texts)))
        return Column(name, unit, np.array([categories.index(t) for t in texts], float), categories)
    values = [float("nan") if value is None else float(value) for value in content.to_pylist()]
    return Column(name, unit, np.array(values, dtype=float))


def _percentile_row(figure: Column) -> dict[str, Any]:
    values = figure.values[np.isfinite(figure.values)]
    numbers = [float("nan")] * (len(_PERCENTILES) + 2)
    if len(values):
        spread = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
        percentiles = np.percentile(values, _PERCENTILES)
        numbers = [*percentiles.tolist(), float(np.mean(values)), spread]
    return {
        "label": figure.label,
        "name": figure.name,
        "count": len(values),
        "numbers": _alike(numbers),
    }


def _alike(numbers: Sequence[float]) -> list[str]:
    """Return percentiles, mean and deviation of a figure to the same place; a dash for NaN.

    The place is that of three digits of the range, or of the size where all cases are equal.
    """
    smallest, *_, largest = numbers[: len(_PERCENTILES)]
    if not (math.isfinite(smallest) and math.isfinite(largest)):
        return ["—"] * len(numbers)
    size = (largest - smallest) or abs(largest)
    place = math.floor(math.log10(size)) if size else 0
    if not -_LARGEST_POWER < place < _LARGEST_POWER:
        return [f"{number:.4g}" for number in numbers]
    decimals = max(0, 2 - place)
    return [f"{number:.{decimals}f}" for number in numbers]


def _median_text(row: Mapping[str, Any], figure: Column) -> str:
    number = row["numbers"][_PERCENTILES.index(50)]
    return f"{describe_name(figure.name)} {number} {figure.unit}".rstrip()


def _strongest(drivers: Sequence[Column], figure: Column) -> tuple[Column, Column] | None:
    """Return the input that drives a figure most, with the figure."""
    strengths = [abs(association(driver, figure)) for driver in drivers]
    if not drivers or np.isnan(strengths).all():
        return None
    return drivers[int(np.nanargmax(strengths))], figure


def _worst_cases(
    table: pa.Table, figures: Sequence[Column], description: CampaignDescription
) -> list[_WorstCase]:
    """Return for each figure the cases nearest to or beyond its bound, else at its ends."""
    numbers = table["case"].to_pylist()
    bounds = {verdict.bound.figure: verdict.bound for verdict in description.verdicts}
    worst = []
    for figure in figures:
        bound = bounds.get(figure.name)
        for row, why in _worst_rows(figure, bound):
            value = figure.values[row]
            inputs = [
                f"{describe_name(name)} {_text(table[name][row].as_py())} {unit}".rstrip()
                for name, unit in description.inputs.items()
            ]
            worst.append(
                _WorstCase(
                    figure.label,
                    why,
                    numbers[row],
                    "none" if np.isnan(value) else f"{value:.6g}",
                    ", ".join(inputs),
                    description.repeat(numbers[row]),
                )
            )
    return worst


def _worst_rows(figure: Column, bound: Bound | None) -> list[tuple[int, str]]:
    if len(figure.values) == 0:
        return []
    if bound is not None:
        excess = np.array([bound.excess(float(value)) for value in figure.values])
        order = np.argsort(-excess, kind="stable")[:_WORST]
        return [(int(i), "breaks its bound" if excess[i] > 0.0 else "nearest") for i in order]
    finite = np.flatnonzero(np.isfinite(figure.values))
    order = finite[np.argsort(figure.values[finite], kind="stable")]
    if len(order) < 2:
        return [(int(i), "only") for i in order]
    return [(int(order[-1]), "largest"), (int(order[-2]), "second"), (int(order[0]), "smallest")]


def _failed(table: pa.Table, description: CampaignDescription) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    for row in table.select(["case", "status", "reason"]).to_pylist():
        if row["status"] != "complete" and len(rows) < _MOST_FAILED:
            rows.append({**row, "command": description.repeat(row["case"])})
    return rows


def _total(table: pa.Table, name: str) -> str:
    """Return the sum of a column of seconds as a text."""
    seconds = sum(value for value in table[name].to_pylist() if value is not None)
    if seconds < 120.0:
        return f"{seconds:.1f} s"
    return f"{seconds / 60.0:.1f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"


def _text(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
