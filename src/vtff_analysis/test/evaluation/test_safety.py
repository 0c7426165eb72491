"""Sentences of a report about the safety monitor."""

import math
from types import SimpleNamespace

from vtff_analysis.evaluation.safety import passing_sentences, safety_sentences, summarise_safety
from vtff_analysis.recordings.safety import SafetyCollector

START = 1_458_521_983


def message(second, mode, axes=0, reason="", separation=90.0, probability=0.0):
    return SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=START + second, nanosec=0)),
        hard_radius=30.0,
        spacecraft=["deputy"],
        mode=[mode],
        isolated_axes=[axes],
        reason=[reason],
        first=["chief"],
        second=["deputy"],
        separation=[separation],
        probability=[probability],
    )


def test_a_run_that_was_left_alone():
    collector = SafetyCollector()
    collector.add(message(0, 0))
    collector.add(message(1, 1, reason="chief-deputy: ...", separation=20.0, probability=1e-3))
    summary = summarise_safety(collector.history, START * 10**9)
    assert summary["safety_taken_over_deputies"] == 0
    assert summary["safety_watched_steps"] == 1
    assert summary["safety_taken_over_time_s"] == math.inf
    assert summary["safety_smallest_predicted_separation_m"] == 20.0
    assert summary["safety_largest_probability"] == 1e-3
    assert safety_sentences(collector.history, START * 10**9) == []
    (line,) = passing_sentences(collector.history)
    assert "formation_safety" in line and "every command" in line and "deputy" in line


def test_a_deputy_that_was_taken_over_and_isolated():
    collector = SafetyCollector()
    collector.add(message(0, 0))
    collector.add(message(17, 2, axes=2, reason="thruster stuck on along T"))
    collector.add(message(18, 3, axes=6, reason="thruster stuck on along T"))
    summary = summarise_safety(collector.history, START * 10**9)
    assert summary["safety_taken_over_time_s"] == 17.0
    assert summary["safety_isolated_axes"] == "NT"
    (line,) = safety_sentences(collector.history, START * 10**9)
    for part in ("formation_safety", "deputy", "17 s", "thruster stuck on along T", "N, T"):
        assert part in line


def test_a_run_without_a_monitor():
    assert summarise_safety(None, 0) == {}
    assert safety_sentences(None, 0) == [] == passing_sentences(None)
