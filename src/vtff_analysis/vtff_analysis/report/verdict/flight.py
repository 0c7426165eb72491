"""Verdict on formations: how well they were kept, guided and navigated."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

from vtff_analysis.evaluation.formation_flight import SETTLED_AFTER
from vtff_analysis.evaluation.summary import SETTLED_WITHIN
from vtff_analysis.paper_reference import PaperColumn
from vtff_analysis.recordings.history import AXES
from vtff_analysis.report.verdict.figure import (
    Figure,
    Summary,
    complete_numbers,
    length_figure,
    length_text,
    length_unit,
    numbers_of,
    short_text,
    times_text,
)

__all__ = ["judge_deputies", "judge_formation", "judge_guidance", "judge_navigation"]

#: Mean normalised squared errors between which a covariance is called honest.
HONEST_NEES = (0.5, 1.5)

#: Epochs of errors from which a mean normalised squared error is judged: errors correlate over tens
#: of seconds, and ten independent ones keep a mean of 1 within `HONEST_NEES`.
JUDGED_EPOCHS = 300


def judge_deputies(
    summary: Summary,
    deputies: Sequence[str],
    judge: Callable[[Summary, str], tuple[list[str], list[Figure]]],
) -> tuple[list[str], list[Figure]]:
    """Return sentences and figures of all deputies; where there are several, labels name them.

    Parameters
    ----------
    summary
        Summary of the run, keys of docs/summary.md.
    deputies
        Names.
    judge
        Returns sentences and figures of a deputy from its part of the summary and its name.
    """
    sentences: list[str] = []
    figures: list[Figure] = []
    for name in deputies:
        label = f"{name}: " if len(deputies) > 1 else ""
        told, shown = judge(numbers_of(summary, name, deputies), name)
        sentences += told
        figures += [dataclasses.replace(figure, label=label + figure.label) for figure in shown]
    return sentences, figures


def judge_formation(
    numbers: Summary, name: str, columns: Sequence[PaperColumn]
) -> tuple[list[str], list[Figure]]:
    """Return sentences and figures of a deputy that comes to a target and keeps it."""
    navigated = numbers.get("control_input") == "navigation"
    alike = next((c for c in columns if c.hardware_in_the_loop == navigated), None)
    printed = {} if alike is None else alike.values
    kept = complete_numbers([numbers.get(f"settled_keeping_{axis}_rms_m") for axis in AXES])
    sentences, figures = [], []
    if kept:
        scale, unit = length_unit(max(kept))
        shown = " / ".join(short_text(value / scale) for value in kept)
        sentences.append(
            f"{name} kept its target to {shown} {unit} RMS (radial / in-track / cross-track, from "
            f"{SETTLED_AFTER:.0f} s on)."
        )
        for axis, value in zip(AXES, kept, strict=True):
            best = numbers.get(f"truth_fed_settled_keeping_{axis}_rms_m")
            figures.append(length_figure(f"keeping, {axis.replace('_', '-')}", value, None, best))
    elif "settling_time_s" in numbers:
        sentences.append(_settling(numbers, name))
    if kept:  # else a few samples of the acquisition's tail would stand beside the paper's hour
        told, shown_figures = _keeping_as_the_paper(numbers, printed)
        sentences += told
        figures += shown_figures
    told, shown_figures = judge_navigation(numbers, name)
    sentences += told if navigated else []
    figures += shown_figures if navigated else []
    hourly = numbers.get("settled_keeping_delta_v_m_per_s_per_h")
    if hourly is not None:
        best = numbers.get("truth_fed_settled_keeping_delta_v_m_per_s_per_h")
        bound = "" if best is None else f"{short_text(24e3 * best)} mm/s per day"
        figures.append(
            Figure("fuel for keeping", f"{short_text(24e3 * hourly)} mm/s per day", "", bound)
        )
    closest = numbers.get("minimum_separation_m")
    if closest is not None:
        figures.append(length_figure("closest to the chief", closest, None, None))
    return sentences, figures


def _settling(numbers: Summary, name: str) -> str:
    """Return how far a deputy came in a run that is too short for statistics of its keeping."""
    settled = numbers["settling_time_s"]
    if settled is not None:
        return f"{name} stays within {SETTLED_WITHIN:g} m of its target from {settled:.0f} s on."
    away = [
        complete_numbers([numbers.get(f"{when}_{axis}_m") for axis in AXES])
        for when in ("initial", "final", "target")
    ]
    if not all(away):
        return f"{name} has not come to its target and stayed within {SETTLED_WITHIN:g} m of it."
    first, last, target = away
    start, end = math.dist(first, target), math.dist(last, target)
    seconds = numbers["run_duration_s"]
    acquires = seconds <= numbers.get("keeping_start_time_s", 0.0)
    when = "during the acquisition" if acquires else f"without staying within {SETTLED_WITHIN:g} m"
    return (
        f"The run ended after {seconds:.0f} s, {when}: {name} was {length_text(end)} from its "
        f"target then, {length_text(start)} at its start."
    )


def _keeping_as_the_paper(numbers: Summary, printed: Summary) -> tuple[list[str], list[Figure]]:
    """Return the keeping over the span of the paper's statistics, beside these.

    Its span begins with the tail of the acquisition, which dominates the figures of `vtff`.
    """
    values = complete_numbers([numbers.get(f"keeping_{axis}_rms_m") for axis in AXES])
    others = complete_numbers([printed.get(f"keeping_{axis}_rms_m") for axis in AXES])
    start = numbers.get("keeping_start_time_s")
    if not values or not others or start is None:
        return [], []
    span = f"from {start:.0f} s on"
    figures = [
        length_figure(f"{span}, {axis.replace('_', '-')}", value, other, None)
        for axis, value, other in zip(AXES, values, others, strict=True)
    ]
    value, other = math.hypot(*values), math.hypot(*others)
    receivers = numbers.get("receivers")
    own = "with emulated receivers" if receivers == "emulated" else "here"
    ratio = times_text(other / value, "closer", "further off")
    sentence = (
        f"Over the span of the paper's statistics, {span}, the deviation is {length_text(value)} "
        f"{own} and {length_text(other)} with the paper's hardware ({ratio})."
    )
    return [sentence], figures


def judge_navigation(
    numbers: Summary, name: str, printed: float | None = None
) -> tuple[list[str], list[Figure]]:
    """Return sentences and figures of the relative navigation of a deputy.

    `printed` is the 3-D RMS error of a paper, m.
    """
    error = numbers.get("navigation_error_settled_3d_rms_m")
    nees = numbers.get("navigation_error_settled_nees")
    if error is None:
        return [], []
    figures = [length_figure("navigation, 3-D RMS error after 60 s", error, printed, None)]
    paper = f"; the paper's, simulated, by {length_text(printed)}" if printed else ""
    sentence = f"The navigation of {name} errs by {length_text(error)} (3-D RMS{paper})"
    if nees is not None:
        figures.append(Figure("its normalised squared error, 1 is honest", f"{nees:.2f}"))
        epochs = numbers["navigation_error_settled_samples"]
        if epochs < JUDGED_EPOCHS:
            counted = "one epoch" if epochs == 1 else f"{epochs} epochs"
            sentence += f"; its stated covariance cannot be judged by {counted} after 60 s"
        else:
            low, high = HONEST_NEES
            size = "honest" if low <= nees <= high else "too large" if nees < low else "too small"
            sentence += f"; its stated covariance is {size} (NEES {nees:.2f})"
    return [f"{sentence}."], figures


def judge_guidance(summary: Summary) -> tuple[list[str], list[Figure]]:
    """Return sentences and figures of a formation that is guided from phase to phase."""
    phase, start = summary["guidance_last_phase"], summary["guidance_last_phase_start_time_s"]
    deviation, closest = (
        summary["guidance_last_phase_deviation_rms_m"],
        summary["guidance_closest_m"],
    )
    planned = summary["guidance_planned_closest_m"]
    change = 1e3 * summary["guidance_delta_v_m_per_s"]
    figures = []
    sentences = []
    if deviation is not None:
        sentences.append(
            f"In the last phase ({phase}, from {start:.0f} s on) the deputies were within "
            f"{length_text(deviation)} RMS of the wanted positions."
        )
        figures.append(Figure(f"{phase}: from the wanted position, RMS", length_text(deviation)))
    if closest is not None:
        plan = "" if planned is None else f" (planned: {length_text(planned)})"
        sentences.append(f"No two spacecraft came nearer than {length_text(closest)}{plan}.")
        figures.append(Figure("closest of any two", length_text(closest)))
    if planned is not None:
        figures.append(Figure("closest of any two, planned", length_text(planned)))
    figures.append(Figure("velocity change of all", f"{short_text(change)} mm/s"))
    return sentences, figures
