"""Figures and sentences of a report about what the safety monitor did."""

from __future__ import annotations

import math
from typing import Any

from vtff_analysis.recordings.safety import SafetyHistory
from vtff_analysis.recordings.topics import key_part

__all__ = ["passing_sentences", "safety_sentences", "summarise_safety"]


def summarise_safety(history: SafetyHistory | None, start_time: int) -> dict[str, Any]:
    """Return the keys ``safety_...`` of docs/summary.md; empty without a monitor.

    Parameters
    ----------
    history
        What the monitor said.
    start_time
        Start of the run, ns since 1970.
    """
    if history is None:
        return {}
    summary: dict[str, Any] = {
        "safety_hard_radius_m": history.hard_radius,
        "safety_taken_over_deputies": len(history.taken_over),
        "safety_smallest_predicted_separation_m": history.separation,
        "safety_largest_probability": history.probability,
    }
    for name, deputy in history.deputies.items():
        prefix = f"{key_part(name)}_" if len(history.deputies) > 1 else ""
        time = math.inf
        if deputy.taken_over_time is not None:
            time = (deputy.taken_over_time - start_time) * 1e-9
        summary[f"{prefix}safety_watched_steps"] = deputy.watched
        summary[f"{prefix}safety_taken_over_time_s"] = time
        summary[f"{prefix}safety_reason"] = deputy.reason
        summary[f"{prefix}safety_isolated_axes"] = "".join(sorted(deputy.isolated))
    return summary


def passing_sentences(history: SafetyHistory | None) -> list[str]:
    """Return of whom the monitor passed on every command, in one line; empty if of nobody."""
    passed = [
        name
        for name, deputy in ({} if history is None else history.deputies).items()
        if deputy.taken_over_time is None
    ]
    if not passed:
        return []
    names = " and ".join(filter(None, (", ".join(passed[:-1]), passed[-1])))
    return [f"formation_safety passed on every command of {names}"]


def safety_sentences(history: SafetyHistory | None, start_time: int) -> list[str]:
    """Return why the monitor took deputies over, one line each; empty where it did not."""
    lines = []
    for name, deputy in ({} if history is None else history.deputies).items():
        if deputy.taken_over_time is None:
            continue
        time = (deputy.taken_over_time - start_time) * 1e-9
        axes = f"; isolated axes: {', '.join(sorted(deputy.isolated))}" if deputy.isolated else ""
        lines.append(f"formation_safety took {name} over at {time:.0f} s: {deputy.reason}{axes}")
    return lines
