"""The verdict of a run: what it was about and how it went, beside the paper and the best possible.

It opens the report and closes the console's tables. Its figures are those of the subject of the
run, in the unit that fits them; everything else follows in the sections of the report.
"""

from __future__ import annotations

import dataclasses
import math
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

from vtff_analysis.cluster.cluster_flight import describe_cluster
from vtff_analysis.evaluation.formation_flight import SETTLED_AFTER
from vtff_analysis.evaluation.summary import SETTLED_WITHIN
from vtff_analysis.paper_reference import PaperColumn, formation_columns, paper_columns
from vtff_analysis.recordings.history import AXES
from vtff_analysis.recordings.topics import key_part

__all__ = [
    "Figure",
    "Verdict",
    "describe_conditions",
    "describe_receivers",
    "find_verdict",
    "length_text",
    "subject_of",
]

Summary = Mapping[str, Any]

#: Mean normalised squared errors between which a covariance is called honest.
HONEST_NEES = (0.5, 1.5)

#: Epochs of errors from which a mean normalised squared error is judged: errors correlate over tens
#: of seconds, and ten independent ones keep a mean of 1 within `HONEST_NEES`.
JUDGED_EPOCHS = 300

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

#: Measured figures of the ionosphere: label, end of the key, unit, decimals.
_IONOSPHERE = (
    ("vertical TEC inside, lower edge", "vtec_bottom_tecu", "TECU", 2),
    ("vertical TEC inside, upper edge", "vtec_top_tecu", "TECU", 2),
    ("separation in altitude from the edges, rising", "separation_rising_m", "m", 1),
    ("lag of the deputy's fluctuations", "lag_s", "s", 2),
)

#: Errors and rates of the ionosphere, which have no truth beside them.
_IONOSPHERE_ERRORS = (
    ("slant TEC of the chief, RMS error", "chief_slant_tec_error_rms_tecu", "TECU", 2),
    ("slant TEC of the deputy, RMS error", "deputy_slant_tec_error_rms_tecu", "TECU", 2),
    ("differential TEC of 1 s, RMS error", "differential_tec_rms_tecu", "TECU", 4),
    ("chief: minutes of crossings found", "chief_scintillation_detected_percent", "%", 0),
    ("chief: false among the other minutes", "chief_scintillation_false_percent", "%", 1),
)


#: Figures of a cluster: end of the key, label, unit, decimals, limit that its guidance must keep.
_CLUSTER = (
    ("equilibrium_m", "side of the equilibrium", "m", 1, None),
    ("settling_time_s", "settled within 2.5 %", "s", 0, None),
    ("settling_delta_v_m_per_s", "velocity change to settle, largest", "m/s", 1, 40.0),
    ("side_mean_error_percent", "last orbit: largest error of a mean side", "%", 2, 1.0),
    ("side_largest_error_percent", "last orbit: largest error of a side", "%", 2, 2.5),
    ("last_orbit_delta_v_m_per_s", "last orbit: velocity change, largest", "m/s", 1, 18.0),
    ("closest_m", "closest of any two", "m", 0, 500.0),
)


#: Ends of keys that only a run through a measured ionosphere has.
_ENDS_OF_IONOSPHERE = (
    "ionosphere_density_error_per_cm3",
    "ionosphere_chief_bottom_altitude_m",
    "ionosphere_chief_slant_tec_error_rms_tecu",
)


@dataclasses.dataclass(frozen=True)
class Figure:
    """One number of a verdict, as texts.

    Attributes
    ----------
    label
        What it is.
    measured, paper, bound
        Number with unit; empty where there is none. The bound is what the same run reaches at best
        (the controller fed with truth), or the true value.
    ratio
        Comparison with the paper in words; empty without one.
    """

    label: str
    measured: str
    paper: str = ""
    bound: str = ""
    ratio: str = ""


@dataclasses.dataclass(frozen=True)
class Verdict:
    """What a run was about, and how it went.

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
    numbers = [_numbers_of(summary, name, deputies) for name in deputies]
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
    sentences: list[str] = []
    figures: list[Figure] = []
    for name in deputies or ("",):
        numbers = _numbers_of(summary, name, deputies)
        label = f"{name}: " if len(deputies) > 1 else ""
        if subject == "formation" and "guidance_closest_m" in summary:
            told, shown = _navigation(numbers, name)
        elif subject == "formation":
            told, shown = _formation(numbers, name, formation_columns(summary.get("scenario")))
        elif subject == "navigation":
            told, shown = _navigation(numbers, name)
        elif subject == "ionosphere":
            told, shown = _ionosphere(numbers, paper_columns(summary.get("scenario")))
        else:
            break
        sentences += told
        figures += [dataclasses.replace(figure, label=label + figure.label) for figure in shown]
    if subject == "formation" and "guidance_closest_m" in summary:
        told, shown = _guidance(summary)
        sentences, figures = [*told, *sentences], [*shown, *figures]
    elif subject in ("log", "messages"):
        sentences, figures = _log(summary)
    elif subject == "attitude":
        sentences, figures = _attitude(summary)
    elif subject == "survey":
        sentences, figures = _survey(summary, deputies)
    elif subject == "cluster":
        sentences, figures = [describe_cluster(summary)], _cluster(summary)
    warnings = [*_warnings(summary, deputies), *_missed_bounds(summary, subject)]
    if subject == "log":
        warnings += [f"{name}: no observations." for name in _receivers(summary, silent=True)]
    return Verdict(
        subject,
        " ".join([*warnings, *sentences]),
        describe_conditions(summary),
        tuple(figures),
        _BOUNDS.get(subject, "fed with truth"),
        not warnings,
    )


def describe_receivers(summary: Summary) -> str:
    """Return which receivers a run had, and in which world; empty if that is not recorded."""
    receivers = summary.get("receivers")
    if receivers is None:
        return ""
    world = pathlib.PurePath(str(summary.get("argument_gnss", ""))).stem
    where = f" in the world {world!r}" if world and receivers != "real" else ""
    return f"{receivers} receivers{where}"


def _numbers_of(summary: Summary, name: str, deputies: Sequence[str]) -> dict[str, Any]:
    """Return the summary with the keys of one deputy of several without its name."""
    prefix = f"{key_part(name)}_" if len(deputies) > 1 else ""
    return {key.removeprefix(prefix): value for key, value in summary.items()}


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
        time = _numbers_of(summary, name, deputies).get("safety_taken_over_time_s")
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


def _missed_bounds(summary: Summary, subject: str) -> list[str]:
    """Return which bounds of a cluster its flight does not keep."""
    if subject != "cluster":
        return []
    missed = [
        f"{label} {summary[f'cluster_{key}']:.{decimals}f} {unit} for {limit:g} {unit}"
        for key, label, unit, decimals, limit in _CLUSTER
        if limit is not None and _misses(key, summary.get(f"cluster_{key}"), limit)
    ]
    return [f"A bound is missed: {'; '.join(missed)}."] if missed else []


def _misses(key: str, value: float | None, limit: float) -> bool:
    if value is None:
        return False
    return value < limit if key == "closest_m" else value > limit


def _cluster(summary: Summary) -> list[Figure]:
    """Return the figures of a cluster beside the paper, which prints a triangle without numbers."""
    figures = []
    for key, label, unit, decimals, limit in _CLUSTER:
        value = summary.get(f"cluster_{key}")
        if value is not None:
            bound = "" if limit is None else f"{limit:g} {unit}"
            figures.append(Figure(label, f"{value:.{decimals}f} {unit}", "", bound))
    return figures


def _guidance(summary: Summary) -> tuple[list[str], list[Figure]]:
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
    figures.append(Figure("velocity change of all", f"{_short(change)} mm/s"))
    return sentences, figures


def _attitude(summary: Summary) -> tuple[list[str], list[Figure]]:
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


def _survey(summary: Summary, deputies: Sequence[str]) -> tuple[list[str], list[Figure]]:
    """Return sentences and figures of a survey of irregular plasma."""
    walls, together = summary["survey_walls"], summary["survey_edges_two_spacecraft"]
    far = summary["survey_edges_1km"]
    plans, spent = summary["survey_plans"], _short(summary["survey_velocity_change_m_s"])
    changes = "one change" if plans == 1 else f"{plans} changes"
    sentence = (
        f"The survey crossed {walls} walls of bubbles and sampled {together} edges with two "
        f"spacecraft, {far} of them at altitudes at least 1 km apart, for {spent} m/s in {changes} "
        "of the formation."
    )
    if not walls:
        sentence = "The survey found no wall of a bubble."
    figures = [
        Figure("edges with two spacecraft", str(together)),
        Figure("at altitudes 1 km apart", str(far)),
        Figure("at altitudes 2 km apart", str(summary["survey_edges_2km"])),
        Figure("crossings left out as false", str(summary["survey_unsupported_crossings"])),
        Figure("velocity change", f"{spent} m/s"),
    ]
    drift, sigma = (summary.get(f"survey_drift{end}_m_s") for end in ("", "_sigma"))
    if walls and drift is not None and sigma is not None:
        true = summary.get("survey_true_drift_m_s")
        bound = "" if true is None else f"{true:.0f} m/s"
        figures.append(Figure("zonal drift, eastward", f"{drift:.0f} ± {sigma:.0f} m/s", "", bound))
    sentences = [sentence]
    for name in deputies:
        numbers = _numbers_of(summary, name, deputies)
        label = f"{name}: " if len(deputies) > 1 else ""
        told, shown = _navigation(numbers, name)
        closest = numbers.get("minimum_separation_m")
        if closest is not None:
            shown.append(_length_figure("closest to the chief", closest, None, None))
        sentences += told
        figures += [dataclasses.replace(figure, label=label + figure.label) for figure in shown]
    return sentences, figures


def _formation(
    numbers: Summary, name: str, columns: Sequence[PaperColumn]
) -> tuple[list[str], list[Figure]]:
    navigated = numbers.get("control_input") == "navigation"
    alike = next((c for c in columns if c.hardware_in_the_loop == navigated), None)
    printed = {} if alike is None else alike.values
    kept = _complete([numbers.get(f"settled_keeping_{axis}_rms_m") for axis in AXES])
    sentences, figures = [], []
    if kept:
        scale, unit = _length_unit(max(kept))
        shown = " / ".join(_short(value / scale) for value in kept)
        sentences.append(
            f"{name} kept its target to {shown} {unit} RMS (radial / in-track / cross-track, from "
            f"{SETTLED_AFTER:.0f} s on)."
        )
        for axis, value in zip(AXES, kept, strict=True):
            best = numbers.get(f"truth_fed_settled_keeping_{axis}_rms_m")
            figures.append(_length_figure(f"keeping, {axis.replace('_', '-')}", value, None, best))
    elif "settling_time_s" in numbers:
        sentences.append(_settling(numbers, name))
    if kept:  # else a few samples of the acquisition's tail would stand beside the paper's hour
        told, shown_figures = _keeping_as_the_paper(numbers, printed)
        sentences += told
        figures += shown_figures
    told, shown_figures = _navigation(numbers, name)
    sentences += told if navigated else []
    figures += shown_figures if navigated else []
    hourly = numbers.get("settled_keeping_delta_v_m_per_s_per_h")
    if hourly is not None:
        best = numbers.get("truth_fed_settled_keeping_delta_v_m_per_s_per_h")
        bound = "" if best is None else f"{_short(24e3 * best)} mm/s per day"
        figures.append(
            Figure("fuel for keeping", f"{_short(24e3 * hourly)} mm/s per day", "", bound)
        )
    closest = numbers.get("minimum_separation_m")
    if closest is not None:
        figures.append(_length_figure("closest to the chief", closest, None, None))
    return sentences, figures


def _settling(numbers: Summary, name: str) -> str:
    """Return how far a deputy came in a run that is too short for statistics of its keeping."""
    settled = numbers["settling_time_s"]
    if settled is not None:
        return f"{name} stays within {SETTLED_WITHIN:g} m of its target from {settled:.0f} s on."
    away = [
        _complete([numbers.get(f"{when}_{axis}_m") for axis in AXES])
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
    values = _complete([numbers.get(f"keeping_{axis}_rms_m") for axis in AXES])
    others = _complete([printed.get(f"keeping_{axis}_rms_m") for axis in AXES])
    start = numbers.get("keeping_start_time_s")
    if not values or not others or start is None:
        return [], []
    span = f"from {start:.0f} s on"
    figures = [
        _length_figure(f"{span}, {axis.replace('_', '-')}", value, other, None)
        for axis, value, other in zip(AXES, values, others, strict=True)
    ]
    value, other = math.hypot(*values), math.hypot(*others)
    receivers = numbers.get("receivers")
    own = "with emulated receivers" if receivers == "emulated" else "here"
    ratio = _times(other / value, "closer", "further off")
    sentence = (
        f"Over the span of the paper's statistics, {span}, the deviation is {length_text(value)} "
        f"{own} and {length_text(other)} with the paper's hardware ({ratio})."
    )
    return [sentence], figures


def _navigation(numbers: Summary, name: str) -> tuple[list[str], list[Figure]]:
    error = numbers.get("navigation_error_settled_3d_rms_m")
    nees = numbers.get("navigation_error_settled_nees")
    if error is None:
        return [], []
    figures = [_length_figure("navigation, 3-D RMS error after 60 s", error, None, None)]
    scale, unit = _length_unit(error)
    sentence = f"The navigation of {name} errs by {_short(error / scale)} {unit} (3-D RMS)"
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


def _ionosphere(numbers: Summary, columns: Sequence[PaperColumn]) -> tuple[list[str], list[Figure]]:
    printed = {key: value for column in columns for key, value in column.values.items()}
    figures = []
    edges = []
    for craft in ("chief", "deputy"):
        for edge, what in (("bottom", "lower"), ("top", "upper")):
            name = f"{craft}_{edge}_altitude_m"
            value = numbers.get(f"ionosphere_{name}")
            true = numbers.get(f"ionosphere_true_{name}")
            paper = printed.get(f"ionosphere_{name}")
            if value is None:
                continue
            texts = ["" if v is None else f"{v / 1e3:.3f} km" for v in (paper, true)]
            figures.append(Figure(f"{what} edge at the {craft}", f"{value / 1e3:.3f} km", *texts))
            if true is not None:
                edges.append(abs(value - true))
    for label, name, unit, decimals in _IONOSPHERE:
        values = [
            source.get(key)
            for source, key in (
                (numbers, f"ionosphere_{name}"),
                (printed, f"ionosphere_{name}"),
                (numbers, f"ionosphere_true_{name}"),
            )
        ]
        if values[0] is not None:
            texts = ["" if v is None else f"{v:.{decimals}f} {unit}" for v in values]
            figures.append(Figure(label, *texts))
    density = numbers.get("ionosphere_density_error_per_cm3")
    if density is not None:
        figures.append(Figure("density of all satellites, mean error", f"{_short(density)} cm⁻³"))
    # The paper's profile is that of one satellite.
    single = "ionosphere_density_error_single_satellite_per_cm3"
    if numbers.get(single) is not None:
        texts = [
            f"{_short(source[single])} cm⁻³" if single in source else ""
            for source in (numbers, printed)
        ]
        figures.append(Figure("density of one satellite, mean error", *texts))
    for label, name, unit, decimals in _IONOSPHERE_ERRORS:
        value = numbers.get(f"ionosphere_{name}")
        if value is not None:
            figures.append(Figure(label, f"{value:.{decimals}f} {unit}"))
    sentences = []
    if edges:
        largest = max(edges)
        scale, unit = _length_unit(largest)
        sentences.append(
            f"The edges of the irregularity lie within {_short(largest / scale)} {unit} of the "
            "true altitudes."
        )
    slant = numbers.get("ionosphere_chief_slant_tec_error_rms_tecu")
    if slant is not None:
        sentences.append(f"Absolute slant TEC errs by {slant:.2f} TECU (RMS).")
    found = numbers.get("ionosphere_chief_scintillation_detected_percent")
    false = numbers.get("ionosphere_chief_scintillation_false_percent")
    if found is not None and false is not None:
        sentences.append(
            f"{found:.0f} % of the minutes in which a ray crossed it were found, {false:.1f} % of "
            "the others were called scintillating."
        )
    if density is not None:
        sentences.append(f"The electron density errs by {_short(density)} cm⁻³ on average.")
    return sentences or ["No figure of the ionosphere has a true value beside it."], figures


def _log(summary: Summary) -> tuple[list[str], list[Figure]]:
    sentences, figures = [], []
    for craft in _receivers(summary, silent=False):
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


def _receivers(summary: Summary, *, silent: bool) -> list[str]:
    """Return the names of the receivers that observed nothing, or of the others."""
    end = "_gnss_epochs"
    return [
        key.removesuffix(end)
        for key, epochs in summary.items()
        if key.endswith(end) and (epochs == 0) == silent
    ]


def _length_figure(label: str, measured: float, paper: float | None, bound: float | None) -> Figure:
    ratio = "" if not paper or not measured else _times(paper / measured, "smaller", "larger")
    return Figure(label, length_text(measured), length_text(paper), length_text(bound), ratio)


def length_text(value: float | None) -> str:
    """Return a length in m as a text in mm or m, to three digits; empty for None."""
    if value is None:
        return ""
    scale, unit = _length_unit(abs(value))
    return f"{_short(value / scale)} {unit}"


def _length_unit(length: float) -> tuple[float, str]:
    """Return size (m) and name of the unit: mm for what is kept and navigated, m for flights."""
    return (1.0, "m") if length >= 1.0 else (1e-3, "mm")


def _times(ratio: float, less: str, more: str) -> str:
    factor, word = (ratio, less) if ratio >= 1.0 else (1.0 / ratio, more)
    return f"{_short(factor, 2)} times {word}"


def _short(value: float, digits: int = 3) -> str:
    """Return a number to some significant digits, without an exponent."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    rounded = round(value, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{rounded:.{decimals}f}"


def _has(summary: Summary, key: str) -> bool:
    return summary[key] is not None


def _complete(values: Sequence[Any]) -> list[float]:
    """Return values if all are numbers; empty where one is missing."""
    return [] if any(value is None for value in values) else [float(value) for value in values]
