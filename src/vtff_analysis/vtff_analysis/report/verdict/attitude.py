"""Verdict on spacecraft that turn."""

from __future__ import annotations

import math

from vtff_analysis.report.verdict.figure import Figure, Summary, short_text

__all__ = ["judge_attitude"]


def judge_attitude(summary: Summary) -> tuple[list[str], list[Figure]]:
    """Return sentences and figures of the spacecraft that turn."""
    sentences, figures = [], []
    ends = [key for key in summary if key.endswith("attitude_mode")]
    for key in ends:
        prefix = key.removesuffix("attitude_mode")
        numbers = {
            name.removeprefix(prefix): value
            for name, value in summary.items()
            if name.startswith(prefix)
        }
        craft = prefix.rstrip("_") or "the spacecraft"
        begin, error = numbers.get("attitude_point_time_s"), numbers.get("attitude_error_rms_deg")
        told = f"{craft} ended in mode {summary[key]}"
        first, last = (numbers.get(f"attitude_{when}_rate_deg_per_s") for when in ("first", "last"))
        if first is not None and last is not None and not (begin and math.isfinite(begin)):
            told += f" and turns at {short_text(last)} deg/s, at the start at {short_text(first)}"
            figures.append(Figure("rate at the start", f"{short_text(first)} deg/s"))
            figures.append(Figure("rate at the end", f"{short_text(last)} deg/s"))
        if begin is not None and math.isfinite(begin):
            told = f"{craft} points at the Earth from {begin:.0f} s on"
        if "attitude_roll_sigma_deg" in numbers:
            angles = [numbers[f"attitude_{name}_sigma_deg"] for name in ("roll", "pitch", "yaw")]
            told += f" (roll / pitch / yaw {' / '.join(f'{a:.2f}' for a in angles)} deg, one sigma)"
            for name, angle in zip(("roll", "pitch", "yaw"), angles, strict=True):
                figures.append(Figure(f"{name}, one sigma", f"{angle:.2f} deg"))
        sentences.append(f"{told[0].upper()}{told[1:]}.")
        if error is not None:
            figures.append(Figure("attitude error, RMS", f"{error:.2f} deg"))
            nees = f"{numbers['attitude_error_nees']:.2f}"
            figures.append(Figure("its normalised squared error, 1 is honest", nees))
            dipole = 1e3 * numbers["attitude_dipole_error_rms_a_m2"]
            figures.append(Figure("dipole error, RMS", f"{dipole:.2f} mA m2"))
    return sentences, figures
