"""Figures and sentences of a report about a survey of irregular plasma."""

from __future__ import annotations

import math
import pathlib
from typing import Any

import numpy as np

from vtff_analysis.survey.recording import SurveyCrossing, SurveyHistory
from vtff_bag.run.description import RunDescription
from vtff_dynamics.constants import NANOSECONDS_PER_SECOND
from vtff_sim_bridge.atmosphere.irregularity import IrregularityRegion
from vtff_sim_bridge.gnss.configuration import load_gnss_configuration

__all__ = [
    "edge_differences",
    "simulated_regions",
    "summarise_survey",
    "survey_sentences",
]

_GNSS_ARGUMENT = "gnss"

_SAME_EDGE = 30.0  # s in which the spacecraft of a formation cross the same edge


def edge_differences(history: SurveyHistory) -> list[float]:
    """Return the altitude difference of the spacecraft at each edge that several told, m."""
    groups: list[list[SurveyCrossing]] = []
    for crossing in history.crossings:
        last = groups[-1][-1] if groups else None
        if (
            last is not None
            and crossing.is_entry == last.is_entry
            and crossing.time - last.time <= _SAME_EDGE * NANOSECONDS_PER_SECOND
        ):
            groups[-1].append(crossing)
        else:
            groups.append([crossing])
    altitudes = [[crossing.altitude for crossing in group] for group in groups]
    return [max(values) - min(values) for values in altitudes if len(values) > 1]


def summarise_survey(history: SurveyHistory | None) -> dict[str, Any]:
    """Return the keys ``survey_...`` of docs/summary.md; empty without a survey.

    Parameters
    ----------
    history
        Beliefs and decisions of the survey.
    """
    if history is None or not history.decisions:
        return {}
    last = history.decisions[-1]
    differences = np.array(edge_differences(history))
    return {
        "survey_walls": len(last.walls),
        "survey_crossings": len(history.crossings),
        "survey_unsupported_crossings": history.unsupported,
        "survey_edges_two_spacecraft": int(differences.size),
        "survey_edges_1km": int((differences >= 1000.0).sum()),
        "survey_edges_2km": int((differences >= 2000.0).sum()),
        "survey_drift_m_s": last.drift,
        "survey_drift_sigma_m_s": last.drift_sigma,
        "survey_plans": last.plans,
        "survey_velocity_change_m_s": last.velocity_change,
    }


def survey_sentences(history: SurveyHistory | None, start_time: int) -> list[str]:
    """Return what the survey decided and why, one line for each plan; empty without a survey."""
    if history is None or not history.decisions:
        return []
    last = history.decisions[-1]
    seconds = [(plan.time - start_time) / NANOSECONDS_PER_SECOND for plan in history.plans]
    lines = [
        f"survey_guidance at {second:.0f} s: {plan.reason}"
        for second, plan in zip(seconds, history.plans, strict=True)
    ]
    drift = ""
    if math.isfinite(last.drift) and max((wall.passes for wall in last.walls), default=0) > 1:
        drift = f"; drift {last.drift:.0f} +- {last.drift_sigma:.0f} m/s"
    lines.append(f"survey_guidance at the end: {last.phase}, {last.reason}{drift}")
    return lines


def simulated_regions(described: RunDescription) -> tuple[IrregularityRegion, ...]:
    """Return the irregularity regions that a run was given; empty where its file is not here.

    Parameters
    ----------
    described
        The run; its argument ``gnss`` names the file of the GNSS simulator.
    """
    named = described.arguments.get(_GNSS_ARGUMENT)
    path = pathlib.Path(str(named)) if named else None
    if path is None or not path.is_file():
        return ()
    try:
        return load_gnss_configuration(path).regions
    except ValueError:
        return ()
