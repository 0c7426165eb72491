"""Figures of a baseline as texts: the same on the console and on the page."""

from __future__ import annotations

import math

from vtff_analysis.baseline.processing import BaselineOptions, BaselineRun
from vtff_analysis.baseline.summary import BaselineSummary

__all__ = ["component_rows", "lead_sentence", "summary_rows"]


def lead_sentence(run: BaselineRun, summary: BaselineSummary) -> str:
    """Return the result in one sentence: epochs fixed, and error, scatter or sigma."""
    fixed = f"{100.0 * summary.fixed_fraction:.1f} % of {summary.epochs} epochs fixed"
    if summary.mean is None:
        return f"No solution in {summary.epochs} epochs."
    if summary.errors is not None:
        return f"{fixed}; error {1e3 * summary.errors.rms_3d:.2f} mm RMS (3-D)."
    lengths, what = summary.sigma, "sigma of the filter"
    if summary.is_at_rest:
        lengths, what = summary.scatter, "scatter"
    assert lengths is not None
    texts = " / ".join(f"{1e3 * length:.2f}" for length in lengths)
    return f"{fixed}; {what} {texts} mm ({' / '.join(run.axes)})."


def summary_rows(run: BaselineRun, summary: BaselineSummary) -> list[tuple[str, str]]:
    """Return the figures that belong to no axis: a name and a text with units."""
    unpaired = f", {run.unpaired[0]} + {run.unpaired[1]} without partner"
    shares = ", ".join(
        f"{100.0 * count / summary.epochs:.2f} % {name}"
        for name, count in reversed(summary.counts.items())
        if count
    )
    first = summary.time_to_first_fix
    rows = [
        (
            "epochs",
            f"{summary.epochs} in {summary.duration:.0f} s"
            + (unpaired if any(run.unpaired) else ""),
        ),
        ("solutions", shares),
        ("first fix", "never" if first is None else f"{first:g} s after the first epoch"),
    ]
    if summary.satellites is not None:
        rows.append(("satellites", "least {:.0f}, mean {:.1f}".format(*summary.satellites)))
    if summary.ratio is not None:
        rows.append(("ratio", "least {:.1f}, median {:.1f}".format(*summary.ratio)))
    if summary.longest is not None:
        rows.append(("length", f"{summary.shortest:.4f} to {summary.longest:.4f} m"))
    return rows


def component_rows(
    options: BaselineOptions, run: BaselineRun, summary: BaselineSummary
) -> tuple[list[str], list[list[str]]]:
    """Return heads and rows of the table of components: along the local axes, and their length."""
    rows: list[list[str]] = []
    if summary.mean is not None and summary.is_at_rest:
        rows.append(["mean, m", *(f"{x:.4f}" for x in summary.mean), ""])
        if options.dynamics == "static" and summary.last is not None:
            rows.append(["last, m", *(f"{x:.4f}" for x in summary.last), ""])
        rows.append(["scatter, mm", *_millimetres(summary.scatter)])
    rows.append(["sigma of the filter, mm", *_millimetres(summary.sigma)])
    for name, errors in (
        ("since the first fix", summary.errors),
        ("after 10 min", summary.errors_converged),
    ):
        if errors is not None:
            rows.append([f"error {name} ({errors.epochs} epochs)", "", "", "", ""])
            rows.append(["  mean, mm", *_millimetres(errors.mean)[:3], ""])
            rows.append(["  RMS, mm", *_millimetres(errors.rms)])
            rows.append(["  largest, mm", "", "", "", f"{1e3 * errors.largest_3d:.3f}"])
    return [f"{options.estimator}, {options.dynamics}", *run.axes, "3-D"], rows


def _millimetres(lengths: tuple[float, ...] | None) -> list[str]:
    """Return three lengths and their root sum square, blank where there are none."""
    if lengths is None:
        return [""] * 4
    return [f"{1e3 * length:.3f}" for length in (*lengths, math.hypot(*lengths))]
