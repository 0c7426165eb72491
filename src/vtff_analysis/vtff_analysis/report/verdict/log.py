"""Verdict on recorded receivers."""

from __future__ import annotations

from vtff_analysis.report.verdict.figure import Figure, Summary

__all__ = ["judge_log", "receivers_of"]


def judge_log(summary: Summary) -> tuple[list[str], list[Figure]]:
    """Return sentences and figures of receivers that were recorded, or of other messages."""
    sentences, figures = [], []
    for craft in receivers_of(summary, silent=False):
        epochs, missing = (
            summary[f"{craft}_gnss_epochs"],
            summary.get(f"{craft}_gnss_missing_epochs", 0),
        )
        lost = "none missing" if not missing else f"{missing} missing"
        sentences.append(f"{craft}: {epochs} epochs of observations, {lost}.")
        for label, name, unit in (
            ("satellites", "gnss_satellites", ""),
            ("mean C/N0", "gnss_cn0_mean_dbhz", " dB-Hz"),
            ("possible cycle slips", "gnss_possible_cycle_slips", ""),
        ):
            value = summary.get(f"{craft}_{name}")
            if value is not None:
                text = f"{value:.1f}" if isinstance(value, float) else str(value)
                figures.append(Figure(f"{craft}: {label}", text + unit))
    if not any(key.endswith("_gnss_epochs") for key in summary):
        sentences.append(f"A recording of {summary['message_count']} messages.")
    return sentences, figures


def receivers_of(summary: Summary, *, silent: bool) -> list[str]:
    """Return the names of the receivers that observed nothing, or of the others."""
    end = "_gnss_epochs"
    return [
        key.removesuffix(end)
        for key, epochs in summary.items()
        if key.endswith(end) and (epochs == 0) == silent
    ]
