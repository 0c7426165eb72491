"""Crossings told by a survey against the true walls of the emulated plasma; times: s from start."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from vtff_analysis.survey.recording import (
    SurveyCrossing,
    SurveyHistory,
    SurveyPrediction,
    SurveyWall,
)
from vtff_dynamics.angles import wrap_angle
from vtff_dynamics.time.timescales import GpsTime
from vtff_dynamics.vectors import FloatArray
from vtff_sim_bridge.atmosphere.walls import (
    WALL_RADIUS,
    TrueCrossing,
    WallKey,
    WallTruth,
    nearest_wall,
    next_crossing_error,
)

__all__ = ["summarise_survey_truth"]

_SAME_CROSSING = 30.0  # s within which a crossing that was told is the true one
_LATEST_TOLD = 600.0  # s until a crossing is told: by its rays and at the end of its pass


def summarise_survey_truth(history: SurveyHistory, truth: WallTruth) -> dict[str, Any]:
    """Return the keys ``survey_...`` of docs/summary.md that need the truth; empty without it.

    Parameters
    ----------
    history
        Beliefs and decisions of the survey.
    truth
        Emulated plasma and true crossings.
    """
    if not history.decisions or not truth.regions:
        return {}
    drifts = [r.drift_east for r in truth.regions if r.drift_east is not None]
    numbers: dict[str, Any] = (
        {"survey_true_drift_m_s": math.fsum(drifts) / len(drifts)} if drifts else {}
    )
    if not truth.crossings:
        return numbers
    told, false, missed = _match(history, truth)
    errors = np.array([crossing.time - true.time for crossing, true in told])
    sigmas = np.array([crossing.sigma for crossing, _ in told])
    places = np.array(
        [WALL_RADIUS * wrap_angle(crossing.longitude - true.longitude) for crossing, true in told]
    )
    drift = _drift_errors(history, truth)
    coming = _prediction_errors(history, truth)
    return {
        **numbers,
        "survey_false_crossings": false,
        "survey_missed_crossings": missed,
        "survey_crossing_error_rms_s": _rms(errors),
        "survey_crossing_error_rms_sigma": _rms(places / sigmas),
        "survey_drift_error_m_s": _largest(error for error, _ in drift),
        "survey_drift_error_sigma": _largest(error / sigma for error, sigma in drift),
        "survey_next_crossing_error_s": _largest(error for error, _ in coming),
        "survey_next_crossing_error_sigma": _largest(error / sigma for error, sigma in coming),
    }


@dataclass(frozen=True)
class _Told:
    """A crossing that was told: s after the start, rad, and sigma along the equator, m."""

    time: float
    longitude: float
    sigma: float
    spacecraft: str
    is_entry: bool


def _match(
    history: SurveyHistory, truth: WallTruth
) -> tuple[list[tuple[_Told, TrueCrossing]], int, int]:
    """Return what was told with its true crossing, and the numbers of false and missed ones."""
    left = list(truth.crossings)
    told, false = [], 0
    for crossing in (_told(crossing, truth) for crossing in history.crossings):
        own = [
            true
            for true in left
            if true.spacecraft == crossing.spacecraft
            and true.wall[1] == crossing.is_entry
            and abs(true.time - crossing.time) <= _SAME_CROSSING
        ]
        if not own:
            false += 1
            continue
        nearest = min(own, key=lambda true: abs(true.time - crossing.time))
        left.remove(nearest)
        told.append((crossing, nearest))
    last = GpsTime.from_unix_nanoseconds(history.decisions[-1].time) - truth.start - _LATEST_TOLD
    return told, false, sum(true.time <= last for true in left)


def _told(crossing: SurveyCrossing, truth: WallTruth) -> _Told:
    return _Told(
        GpsTime.from_unix_nanoseconds(crossing.time) - truth.start,
        math.radians(crossing.longitude_deg),
        crossing.sigma,
        crossing.spacecraft,
        crossing.is_entry,
    )


def _drift_errors(history: SurveyHistory, truth: WallTruth) -> list[tuple[float, float]]:
    """Return error and sigma of the drift of each wall that was crossed twice, m/s, at the end."""
    last = history.decisions[-1]
    elapsed = GpsTime.from_unix_nanoseconds(last.time) - truth.start
    errors = []
    for wall in last.walls:
        if wall.passes >= 2:
            region, _ = _true_wall(wall, elapsed, truth)
            errors.append(
                (wall.drift - (truth.regions[region].drift_east or 0.0), wall.drift_sigma)
            )
    return errors


def _prediction_errors(history: SurveyHistory, truth: WallTruth) -> list[tuple[float, float]]:
    """Return error and sigma of each next crossing of walls that were crossed twice before, s.

    Each wall and spacecraft counts at the first decision with predictions after a pass.
    """
    errors, judged = [], set()
    for decision in history.decisions:
        now = GpsTime.from_unix_nanoseconds(decision.time) - truth.start
        firsts: dict[tuple[int, str], SurveyPrediction] = {}
        for prediction in decision.predictions:
            firsts.setdefault((prediction.wall, prediction.spacecraft), prediction)
        for (number, spacecraft), prediction in firsts.items():
            wall = decision.walls[number]
            key = (number, spacecraft, wall.passes)
            if wall.passes < 2 or key in judged:
                continue
            judged.add(key)
            true = _true_wall(wall, now, truth)
            predicted = GpsTime.from_unix_nanoseconds(prediction.time) - truth.start
            error = next_crossing_error(truth, true, spacecraft, now, predicted)
            if error is not None:
                errors.append((error, prediction.sigma))
    return errors


def _true_wall(wall: SurveyWall, elapsed: float, truth: WallTruth) -> WallKey:
    return nearest_wall(truth, elapsed, math.radians(wall.longitude_deg), wall.is_entry)[0]


def _largest(values: Iterable[float]) -> float | None:
    """Return the largest amount; None of nothing."""
    return max((abs(value) for value in values), default=None)


def _rms(values: FloatArray) -> float | None:
    return float(np.sqrt(np.mean(values**2))) if len(values) else None
