"""The comparison of runs as one HTML file that holds its pictures and needs nothing else."""

from __future__ import annotations

import math
import pathlib
from collections.abc import Sequence

from vtff_analysis.compare.comparison import ComparedRun, comparable_summaries, comparison_table
from vtff_analysis.page.page import (
    Picture,
    escape,
    render_figures,
    render_page,
    render_table,
)
from vtff_analysis.recordings.history import AXES
from vtff_analysis.report.verdict import describe_conditions, length_text

__all__ = ["render_comparison"]

_REMARK = (
    "Flights are compared up to the end of the shortest. Errors of navigation are those of the "
    "epochs that all runs have: a filter without a solution in the hard epochs would look better "
    "over its own. Settled epochs are settled in every run. The difference is the second run less "
    "the first; a blank: the run has no such subject, or the paper no such number."
)

#: What two runs are told of over their common time, and the keys whose values make its length.
_RESULTS = (
    ("Navigation of {} errs by", ("navigation_common_settled_3d_rms_m",)),
    ("{} is kept from 125 s on to", tuple(f"keeping_{axis}_rms_m" for axis in AXES)),
)

#: Conditions of runs that a comparison of filters or controllers would keep.
_CONDITIONS = {
    "scenario": "scenario",
    "receivers": "receivers",
    "argument_gnss": "world",
    "run_seed": "seed",
}

_CAPTIONS = {
    "position": "Position relative to the chief, by axis",
    "deviation": "Deviation from the target while it is kept, by axis",
    "delta_v": "Velocity change spent so far, by axis",
    "navigation_error": "Navigated less true position, by axis",
}


def render_comparison(
    runs: Sequence[ComparedRun], pictures: Sequence[pathlib.Path], command: str = ""
) -> str:
    """Return the HTML text of a comparison.

    Parameters
    ----------
    runs
        The runs, in the order of the columns.
    pictures
        PNG files of the overlaid plots.
    command
        Command that makes the page again.
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
    head = _render_lead(runs) + remarks
    papers = ["000"] if len(heads) > len(runs) + (len(runs) == 2) else []
    return render_page(", ".join(run.name for run in runs), head, body, papers, command)


def _render_lead(runs: Sequence[ComparedRun]) -> str:
    """Return the block that opens the page: what was compared, and how it went where both flew."""
    sentences = _differences(runs)
    if len(runs) == 2:
        sentences += _results(runs)
    shown = "".join(
        f'<p class="small">{escape(run.name)}: {escape(describe_conditions(run.summary))}</p>'
        for run in runs
    )
    state = "bad" if _differences(runs) else "good"
    return (
        f'<div class="verdict {state}"><p class="sentence">{escape(" ".join(sentences))}</p>'
        f"{shown}</div>"
    )


def _differences(runs: Sequence[ComparedRun]) -> list[str]:
    """Return in what the runs differ beyond what is compared; empty where they are alike."""
    differ = [
        words
        for key, words in _CONDITIONS.items()
        if len({str(run.summary.get(key)) for run in runs}) > 1
    ]
    return [f"The runs differ in {', '.join(differ)}: so may their figures."] if differ else []


def _results(runs: Sequence[ComparedRun]) -> list[str]:
    """Return navigation and keeping of two runs over the time that both have."""
    first, second = comparable_summaries(runs)
    sentences = []
    for deputy in sorted(set(runs[0].flights) | set(runs[0].errors)):
        prefixes = [f"{deputy}_" if len(run.flights) > 1 else "" for run in runs]
        for told, keys in _RESULTS:
            pairs = [(first.get(prefixes[0] + key), second.get(prefixes[1] + key)) for key in keys]
            if any(value is None for pair in pairs for value in pair):
                continue
            sizes = [math.hypot(*values) for values in zip(*pairs, strict=True)]
            texts = [
                f"{length_text(size)} in {run.name}" for size, run in zip(sizes, runs, strict=True)
            ]
            sentences.append(f"{told.format(deputy)} {' and '.join(texts)} (3-D RMS).")
    return sentences


def _caption(name: str) -> str:
    """Return the caption of a picture of `plot_comparison` by the name of its file."""
    deputy, _, quantity = name.partition("compare_")
    subject = f" of {deputy.rstrip('_')}" if deputy else ""
    return f"{_CAPTIONS[quantity]}{subject}."
