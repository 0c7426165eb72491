"""Verdict on measured ionospheres and on surveys of irregular plasma."""

from __future__ import annotations

from collections.abc import Sequence

from vtff_analysis.paper_reference import PaperColumn
from vtff_analysis.report.verdict.figure import (
    Figure,
    Summary,
    length_figure,
    length_unit,
    short_text,
)
from vtff_analysis.report.verdict.flight import judge_deputies, judge_navigation

__all__ = ["judge_ionosphere", "judge_survey"]

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


def judge_ionosphere(
    numbers: Summary, columns: Sequence[PaperColumn]
) -> tuple[list[str], list[Figure]]:
    """Return sentences and figures of an ionosphere that was flown through."""
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
        figures.append(
            Figure("density of all satellites, mean error", f"{short_text(density)} cm⁻³")
        )
    # The paper's profile is that of one satellite.
    single = "ionosphere_density_error_single_satellite_per_cm3"
    if numbers.get(single) is not None:
        texts = [
            f"{short_text(source[single])} cm⁻³" if single in source else ""
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
        scale, unit = length_unit(largest)
        sentences.append(
            f"The edges of the irregularity lie within {short_text(largest / scale)} {unit} of the "
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
        sentences.append(f"The electron density errs by {short_text(density)} cm⁻³ on average.")
    if not sentences:
        sentences.append(
            "No edge of an irregularity was met and no receiver bias known before the end: there "
            "is no figure of edges, nor of absolute TEC."
        )
    return sentences, figures


def judge_survey(summary: Summary, deputies: Sequence[str]) -> tuple[list[str], list[Figure]]:
    """Return sentences and figures of a survey of irregular plasma."""
    walls, together = summary["survey_walls"], summary["survey_edges_two_spacecraft"]
    far = summary["survey_edges_1km"]
    plans, spent = summary["survey_plans"], short_text(summary["survey_velocity_change_m_s"])
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
        *_survey_errors(summary),
        Figure("velocity change", f"{spent} m/s"),
    ]
    drift, sigma = (summary.get(f"survey_drift{end}_m_s") for end in ("", "_sigma"))
    if walls and drift is not None and sigma is not None:
        true = summary.get("survey_true_drift_m_s")
        bound = "" if true is None else f"{true:.0f} m/s"
        figures.append(Figure("zonal drift, eastward", f"{drift:.0f} ± {sigma:.0f} m/s", "", bound))
    told, shown = judge_deputies(summary, deputies, _judge_surveyor)
    return [sentence, *told], [*figures, *shown]


def _survey_errors(summary: Summary) -> list[Figure]:
    """Return how far a survey was from the emulated truth, where that is known."""
    figures = [
        Figure(label, str(summary[key]), "", "0")
        for label, key in (
            ("crossings told where there is none", "survey_false_crossings"),
            ("true crossings not told", "survey_missed_crossings"),
        )
        if summary.get(key) is not None
    ]
    for label, key in (
        ("time of a crossing, RMS error", "survey_crossing_error_rms_s"),
        ("next crossing, largest error", "survey_next_crossing_error_s"),
    ):
        if summary.get(key) is not None:
            figures.append(Figure(label, f"{summary[key]:.1f} s"))
    return figures


def _judge_surveyor(numbers: Summary, name: str) -> tuple[list[str], list[Figure]]:
    told, shown = judge_navigation(numbers, name)
    closest = numbers.get("minimum_separation_m")
    if closest is not None:
        shown.append(length_figure("closest to the chief", closest, None, None))
    return told, shown
