"""The comparison of runs as one HTML file that holds its pictures and needs nothing else."""

from __future__ import annotations

import pathlib
from collections.abc import Sequence

from vtff_analysis.compare.comparison import ComparedRun, comparison_table
from vtff_analysis.page.page import (
    Picture,
    escape,
    render_figures,
    render_page,
    render_table,
)

__all__ = ["render_comparison"]

_REMARK = (
    "Flights are compared up to the end of the shortest. Errors of navigation are those of the "
    "epochs that all runs have: a filter without a solution in the hard epochs would look better "
    "over its own. Settled epochs are settled in every run. The difference is the second run less "
    "the first; a blank: the run has no such subject, or the paper no such number."
)

_CAPTIONS = {
    "position": "Position relative to the chief, by axis",
    "deviation": "Deviation from the target while it is kept, by axis",
    "delta_v": "Velocity change spent so far, by axis",
    "navigation_error": "Navigated less true position, by axis",
}


def render_comparison(runs: Sequence[ComparedRun], pictures: Sequence[pathlib.Path]) -> str:
    """Return the HTML text of a comparison.

    Parameters
    ----------
    runs
        The runs, in the order of the columns.
    pictures
        PNG files of the overlaid plots.
    """
    heads, sections = comparison_table(runs)
    rows: list[Sequence[str] | str] = []
    for heading, section in sections:
        rows.append(heading)
        rows.extend([label, *texts] for label, texts in section)
    plots = [Picture(path, _caption(path.stem), "compare") for path in pictures]
    notes = [f"{run.name}: {note}" for run in runs for note in run.history.notes]
    remarks = "".join(f'<p class="note">{escape(note)}</p>' for note in notes)
    body = (
        f"<section>{render_table(['', *heads], rows)}"
        f'<p class="small">{escape(_REMARK)}</p></section>'
        f"<section>{render_figures(plots, 'compare')}</section>"
    )
    return render_page(", ".join(run.name for run in runs), remarks, body, ["000"])


def _caption(name: str) -> str:
    """Return the caption of a picture of `plot_comparison` by the name of its file."""
    deputy, _, quantity = name.partition("compare_")
    subject = f" of {deputy.rstrip('_')}" if deputy else ""
    return f"{_CAPTIONS[quantity]}{subject}."
