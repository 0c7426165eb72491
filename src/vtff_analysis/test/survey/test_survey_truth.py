"""Figures of a survey against the truth: crossings found, false and missed ones, predictions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vtff_analysis.survey.recording import (
    SurveyCrossing,
    SurveyDecision,
    SurveyHistory,
    SurveyPrediction,
    SurveyWall,
)
from vtff_analysis.survey.truth import summarise_survey_truth
from vtff_dynamics.frames.geodetic import itrf_from_geodetic
from vtff_dynamics.time.timescales import parse_epoch
from vtff_sim_bridge.atmosphere.irregularity import IrregularityRegion
from vtff_sim_bridge.atmosphere.walls import (
    WALL_RADIUS,
    WallTruth,
    edges_by_difference,
    find_true_crossings,
    find_wall_truth,
    nearest_wall,
    next_crossing_error,
    side_longitudes,
)

START = parse_epoch("2016-03-21T01:00:00 GPS")
EPOCH = START.to_unix_nanoseconds()
RATE = 2.0 * math.pi / 5900.0  # rad/s over the Earth
TIMES = np.arange(0.0, 12000.0, 10.0)


def region(hour, drift=100.0):
    limits = (math.radians(-20.0), math.radians(20.0), hour, hour + 0.4, 250e3, 600e3)
    return IrregularityRegion("bubble", *limits, 0.5, 0.5, drift_east=drift)


REGIONS = (region(20.4, 90.0), region(22.0, 110.0))


def positions(altitude, ahead=0.0):
    """Return positions over the equator that begin at the longitude 0.5 rad at 0 s."""
    longitude = 0.5 + ahead + RATE * TIMES
    geodetic = np.stack((0.0 * TIMES, longitude, np.full_like(TIMES, altitude)), axis=1)
    return itrf_from_geodetic(geodetic)


TRACKS = {"chief": (TIMES, positions(410e3)), "deputy": (TIMES, positions(408e3, -3e-4))}
TRUTH = find_wall_truth(REGIONS, START, TRACKS)


def told(true, late=0.0, sigma=7e3):
    moved = late * RATE
    longitude = math.degrees(math.remainder(true.longitude + moved, 2.0 * math.pi))
    time = EPOCH + round((true.time + late) * 1e9)
    return SurveyCrossing(time, true.spacecraft, true.wall[1], longitude, 0.0, true.altitude, sigma)


def decision(time, walls=(), predictions=()):
    stamp = EPOCH + round(time * 1e9)
    return SurveyDecision(
        stamp, "survey", "", 100.0, 2.0, 1, 3e3, 2.0, tuple(walls), tuple(predictions)
    )


def test_every_wall_is_crossed_where_it_has_drifted_to():
    chief = [crossing for crossing in TRUTH.crossings if crossing.spacecraft == "chief"]
    assert [crossing.number for crossing in chief] == [0] * 4 + [1] * 4
    for crossing in chief:
        index, is_entry = crossing.wall
        west, east = side_longitudes(REGIONS[index], START, crossing.time)
        side = float(west if is_entry else east)
        assert math.remainder(crossing.longitude - side, 2.0 * math.pi) == pytest.approx(
            0.0, abs=1e-6
        )
        assert crossing.longitude == pytest.approx(0.5 + RATE * crossing.time, abs=1e-6)
    # Eastward drift makes the next pass later than a turn.
    assert chief[4].time - chief[0].time > 5900.0 + 60.0
    assert edges_by_difference(TRUTH.crossings) == pytest.approx([2e3] * 8, abs=1.0)


def test_what_flies_above_the_plasma_crosses_nothing():
    assert find_true_crossings(REGIONS, START, "chief", TIMES, positions(700e3)) == []


def test_the_nearest_wall_is_of_the_same_kind():
    west, _ = side_longitudes(REGIONS[1], START, 3000.0)
    wall, distance = nearest_wall(TRUTH, 3000.0, float(west) + 1e-3, True)
    assert wall == (1, True)
    assert distance == pytest.approx(1e-3 * WALL_RADIUS)
    exit_wall, farther = nearest_wall(TRUTH, 3000.0, float(west) + 1e-3, False)
    assert not exit_wall[1]
    assert abs(farther) > 100e3


def test_crossings_that_were_told_missed_and_false():
    crossings = [told(true, 2.0) for true in TRUTH.crossings[:7]]
    crossings.append(told(TRUTH.crossings[8], 40.0))
    history = SurveyHistory([decision(TRUTH.crossings[-1].time + 700.0)], crossings)
    summary = summarise_survey_truth(history, TRUTH)
    assert summary["survey_false_crossings"] == 1
    assert summary["survey_missed_crossings"] == len(TRUTH.crossings) - 7
    assert summary["survey_crossing_error_rms_s"] == pytest.approx(2.0, abs=1e-3)
    place = WALL_RADIUS * 2.0 * RATE
    assert summary["survey_crossing_error_rms_sigma"] == pytest.approx(place / 7e3, rel=1e-3)
    assert summary["survey_true_drift_m_s"] == pytest.approx(100.0)
    # What was crossed a minute before the last decision cannot be known yet.
    early = SurveyHistory([decision(TRUTH.crossings[6].time + 60.0)], crossings[:7])
    assert summarise_survey_truth(early, TRUTH)["survey_missed_crossings"] == 0


def test_predictions_count_after_two_passes_and_by_their_wall():
    now = 9000.0
    first = next(c for c in TRUTH.crossings if c.wall == (1, False) and c.time > 5000.0)
    at = first.time - 200.0
    _, east = side_longitudes(REGIONS[1], START, at)
    wall = SurveyWall(False, 2, math.degrees(float(east)), 113.0, 1.5)
    prediction = SurveyPrediction(0, "chief", EPOCH + round((first.time + 6.0) * 1e9), 3.0)
    history = SurveyHistory([decision(at, [wall], [prediction])])
    summary = summarise_survey_truth(history, TRUTH)
    assert summary["survey_next_crossing_error_s"] == pytest.approx(6.0, abs=0.1)
    assert summary["survey_next_crossing_error_sigma"] == pytest.approx(2.0, abs=0.1)
    assert summary["survey_drift_error_m_s"] == pytest.approx(3.0)
    assert summary["survey_drift_error_sigma"] == pytest.approx(2.0)
    once = SurveyWall(False, 1, wall.longitude_deg, 113.0, 1.5)
    nothing = summarise_survey_truth(SurveyHistory([decision(at, [once], [prediction])]), TRUTH)
    assert nothing["survey_next_crossing_error_s"] is None
    assert nothing["survey_drift_error_m_s"] is None
    last = TRUTH.crossings[-1]
    assert next_crossing_error(TRUTH, last.wall, last.spacecraft, last.time, now) is None


def test_without_regions_there_is_nothing_to_compare():
    assert summarise_survey_truth(SurveyHistory([decision(0.0)]), WallTruth(START, (), ())) == {}
