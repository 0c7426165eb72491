"""The verdict of a run as a whole: what it was about, its sentence, figures and conditions."""

from __future__ import annotations

import dataclasses
import functools
import pathlib
from collections.abc import Sequence

from vtff_analysis.cluster.cluster_flight import describe_cluster
from vtff_analysis.paper_reference import formation_columns, paper_columns, paper_navigation_error
from vtff_analysis.report.verdict.attitude import judge_attitude
from vtff_analysis.report.verdict.cluster import cluster_figures, missed_bounds
from vtff_analysis.report.verdict.figure import Figure, Summary, numbers_of
from vtff_analysis.report.verdict.flight import (
    judge_deputies,
    judge_formation,
    judge_guidance,
    judge_navigation,
)
from vtff_analysis.report.verdict.ionosphere import judge_ionosphere, judge_survey
from vtff_analysis.report.verdict.log import judge_log, receivers_of

__all__ = [
    "SECTIONS",
    "Verdict",
    "describe_conditions",
    "describe_receivers",
    "find_verdict",
    "printed_navigation_error",
    "subject_of",
]

#: Late calls of an algorithm, %, that a loaded machine may cause and a verdict does not mention.
TOLERATED_LATE_CALLS = 5.0

#: Subjects of runs; the sections of the report in the order of their weight.
SECTIONS = {
    "formation": ("Formation", "Guidance", "Navigation", "Attitude", "Ionosphere", "GNSS"),
    "navigation": ("Navigation", "GNSS", "Formation", "Guidance", "Attitude", "Ionosphere"),
    "ionosphere": ("Ionosphere", "Navigation", "GNSS", "Formation", "Guidance", "Attitude"),
    "cluster": ("Formation", "Guidance", "Navigation", "Attitude", "Ionosphere", "GNSS"),
    "attitude": ("Attitude", "Formation", "Guidance", "Navigation", "GNSS", "Ionosphere"),
    "survey": ("Ionosphere", "Guidance", "Navigation", "GNSS", "Formation", "Attitude"),
    "log": ("GNSS", "Ionosphere", "Navigation", "Formation", "Guidance", "Attitude"),
    "messages": ("GNSS", "Navigation", "Formation", "Guidance", "Attitude", "Ionosphere"),
}

#: Headings of the column of bounds.
_BOUNDS = {"ionosphere": "true", "survey": "true", "cluster": "must"}

#: Ends of keys that only a run through a measured ionosphere has.
_ENDS_OF_IONOSPHERE = (
    "ionosphere_vertical_edges",
    "ionosphere_density_error_per_cm3",
    "ionosphere_chief_bottom_altitude_m",
    "ionosphere_chief_slant_tec_error_rms_tecu",
)


@dataclasses.dataclass(frozen=True)
class Verdict:
    """Subject of a run, and its result.

    Attributes
    ----------
    subject
        Key of `SECTIONS`.
    sentence
        Plain words for a reader who has one line of time.
    conditions
        Duration, receivers and world, scenario, seed.
    figures
        The numbers behind the sentence.
    bound
        Heading of the column of bounds.
    is_good
        False where the run was ended early, a deputy was taken over, a bound was missed or a
        receiver of a log observed nothing.
    """

    subject: str
    sentence: str
    conditions: str
    figures: tuple[Figure, ...]
    bound: str
    is_good: bool


def subject_of(summary: Summary, deputies: Sequence[str]) -> str:
    """Return what a run was about: a key of `SECTIONS`."""
    if "survey_walls" in summary:
        return "survey"
    if any(key.endswith(_ENDS_OF_IONOSPHERE) and _has(summary, key) for key in summary):
        return "ionosphere"
    if "cluster_closest_m" in summary:
        return "cluster"
    numbers = [numbers_of(summary, name, deputies) for name in deputies]
    if any("control_input" in values for values in numbers):
        return "formation"
    if any("navigation_error_samples" in values for values in numbers):
        return "navigation"
    if any(key.endswith("_gnss_epochs") for key in summary):
        return "log"
    if not deputies and any("attitude_" in key for key in summary):
        return "attitude"
    return "formation" if deputies else "messages"


def find_verdict(summary: Summary, deputies: Sequence[str]) -> Verdict:
    """Return the verdict of a run.

    Parameters
    ----------
    summary
        Summary of the run, keys of docs/summary.md.
    deputies
        Names of the deputies in the summary.
    """
    subject = subject_of(summary, deputies)
    sentences, figures = _judge(subject, summary, deputies)
    warnings = _warnings(summary, deputies)
    if subject == "cluster":
        warnings += missed_bounds(summary)
    if subject == "log":
        warnings += [f"{name}: no observations." for name in receivers_of(summary, silent=True)]
    return Verdict(
        subject,
        " ".join([*warnings, *sentences]),
        describe_conditions(summary),
        tuple(figures),
        _BOUNDS.get(subject, "fed with truth"),
        not warnings,
    )


def _judge(
    subject: str, summary: Summary, deputies: Sequence[str]
) -> tuple[list[str], list[Figure]]:
    """Return sentences and figures of a run that was about a subject."""
    scenario = summary.get("scenario")
    match subject:
        case "formation" if "guidance_closest_m" in summary:
            told, shown = judge_guidance(summary)
            more_told, more_shown = judge_deputies(summary, deputies, judge_navigation)
            return [*told, *more_told], [*shown, *more_shown]
        case "formation":
            judge = functools.partial(judge_formation, columns=formation_columns(scenario))
            return judge_deputies(summary, deputies, judge)
        case "navigation":
            judge = functools.partial(judge_navigation, printed=printed_navigation_error(summary))
            return judge_deputies(summary, deputies, judge)
        case "ionosphere":
            columns = paper_columns(scenario)
            return judge_deputies(
                summary, deputies or ("",), lambda numbers, _: judge_ionosphere(numbers, columns)
            )
        case "attitude":
            return judge_attitude(summary)
        case "survey":
            return judge_survey(summary, deputies)
        case "cluster":
            return [describe_cluster(summary)], cluster_figures(summary)
        case _:
            return judge_log(summary)


def printed_navigation_error(summary: Summary) -> float | None:
    """Return the 3-D RMS error of the relative position that a paper prints for a run, m."""
    has_laser = pathlib.PurePath(str(summary.get("system", ""))).stem == "laser"
    return paper_navigation_error(summary.get("scenario"), has_laser)


def describe_receivers(summary: Summary) -> str:
    """Return which receivers a run had, and in which world; empty if that is not recorded."""
    receivers = summary.get("receivers")
    if receivers is None:
        return ""
    world = pathlib.PurePath(str(summary.get("argument_gnss", ""))).stem
    where = f" in the world {world!r}" if world and receivers != "real" else ""
    return f"{receivers} receivers{where}"


def describe_conditions(summary: Summary) -> str:
    """Return duration, receivers and world, scenario and seed of a run, in words."""
    parts = [f"{summary['run_duration_s']:.0f} s"]
    receivers = describe_receivers(summary)
    if receivers:
        parts.append(receivers)
    elif summary.get("control_input") == "truth":
        parts.append("controller fed with truth, no receivers")
    elif "cluster_closest_m" in summary:
        parts.append("each chaser alone with its own fix and sensor, emulated")
    elif any(key.endswith("attitude_error_rms_deg") for key in summary):
        parts.append("emulated attitude sensors and actuators")
    if "scenario" in summary:
        parts.append(f"scenario '{summary['scenario']}'")
    if "run_seed" in summary:
        parts.append(f"seed {summary['run_seed']}")
    return ", ".join(parts)


def _warnings(summary: Summary, deputies: Sequence[str]) -> list[str]:
    """Return what makes the figures of a run those of another one than was planned."""
    warnings = []
    for name in deputies:
        time = numbers_of(summary, name, deputies).get("safety_taken_over_time_s")
        if time is not None:
            warnings.append(
                f"The safety monitor took {name} over after {time:.0f} s: from then on the "
                "formation was not kept."
            )
    if summary.get("late_calls_percent", 0.0) > TOLERATED_LATE_CALLS:
        warnings.append(
            f"In {summary['late_calls_percent']:.0f} % of its steps an algorithm took longer than "
            f"the time between samples (up to {summary['late_calls_longest_s']:.1f} s; Health "
            "names it): hardware would not wait for it."
        )
    if summary.get("run_complete") is False:
        warnings.append("The run was ended before its planned end.")
    return warnings


def _has(summary: Summary, key: str) -> bool:
    return summary[key] is not None
