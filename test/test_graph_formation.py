"""Formations of any number over the graph: each deputy has its topics, none disturbs another."""

from __future__ import annotations

import json

import numpy as np
import pytest
from graph_support import assert_equal_messages, topics

from vtff_bag.file.reader import BagReader
from vtff_msgs.msg import FormationSafety

SOFTWARE = "formation_software.yaml"


def of_deputy(name: str) -> set[str]:
    parts = ("relative_state_truth", "control/thrust_command", "propulsion/thrust_applied")
    return {f"/{name}/{part}" for part in (*parts, "truth/orbit")}


@pytest.fixture(scope="module")
def make_run(runs):
    """Return a function from a name and the number of deputies to the folder of a run."""
    return lambda name, count: runs.make(
        name, SOFTWARE, f"number_of_deputies:={count}", "--duration", 60, "--composed",
        "--no-report",
    )[0]  # fmt: skip


def test_every_deputy_has_its_topics(make_run):
    run = make_run("four", 4)
    deputies = [f"deputy_{number}" for number in range(1, 5)]
    for name in deputies:
        assert of_deputy(name) <= topics(run)
        states = [item.message for item in BagReader(run).messages(f"/{name}/relative_state_truth")]
        assert len(states) == 61
        assert {state.child_frame_id for state in states} == {name}
        assert {state.header.frame_id for state in states} == {"chief/rtn"}
    # Each flies to a place of its own.
    reader = BagReader(run)
    ends = [
        [item.message.position[1] for item in reader.messages(f"/{name}/relative_state_truth")][-1]
        for name in deputies
    ]
    assert np.all(np.diff(ends) > 100.0)


def test_equal_runs_are_equal_byte_for_byte(make_run):
    first, second = make_run("four", 4), make_run("four_again", 4)
    assert topics(first) == topics(second)
    assert assert_equal_messages(first, second, topics(first)) > 4 * 4 * 60


def test_a_deputy_more_does_not_change_the_others(make_run):
    four, two = make_run("four", 4), make_run("two", 2)
    shared = {"/chief/truth/orbit", *of_deputy("deputy_1"), *of_deputy("deputy_2")}
    assert shared <= topics(two)
    assert not of_deputy("deputy_3") & topics(two)
    assert_equal_messages(four, two, shared)


@pytest.mark.slow
def test_three_spacecraft_with_receivers_in_the_realistic_world(runs):
    run, _ = runs.make("three", "formation_three.yaml", "--duration", 600, "--composed")
    summary = json.loads((run / "report" / "summary.json").read_text(encoding="utf-8"))
    for name in ("bravo", "charlie"):
        assert summary[f"{name}_navigation_error_settled_3d_rms_m"] < 2.5e-3
    assert summary["pair_bravo_charlie_error_settled_3d_rms_m"] < 3.5e-3
    assert summary["pair_bravo_charlie_minimum_separation_m"] > 30.0


@pytest.mark.slow
def test_a_chief_that_thrusts_keeps_its_place(runs):
    """The safety monitor stands before the thrusters of all, and takes none over."""
    run, _ = runs.make("all_thrust", "formation_all_thrust.yaml", "--duration", 300, "--composed")
    judged = [item.message for item in BagReader(run).messages("/formation/safety")]
    assert len(judged) >= 300 and all(
        list(m.spacecraft) == ["bravo", "charlie", "alpha"] for m in judged
    )
    modes = {mode for message in judged for mode in message.mode}
    assert modes <= {FormationSafety.MODE_MONITOR, FormationSafety.MODE_WATCH}
    assert not any(axes for message in judged for axes in message.isolated_axes)
    pairs = {("alpha", "bravo"), ("alpha", "charlie"), ("bravo", "charlie")}
    assert set(zip(judged[-1].first, judged[-1].second, strict=True)) == pairs
    states = [item.message for item in BagReader(run).messages("/alpha/reference_state")]
    distances = [np.linalg.norm(state.position) for state in states if state.solution]
    assert len(distances) > 230 and max(distances) < 10.0
    thrust = [item.message.accel.linear for item in BagReader(run).messages(
        "/alpha/propulsion/thrust_applied"
    )]  # fmt: skip
    assert any(value.x or value.y or value.z for value in thrust)
    summary = json.loads((run / "report" / "summary.json").read_text(encoding="utf-8"))
    for name in ("bravo", "charlie"):
        assert summary[f"{name}_navigation_error_settled_3d_rms_m"] < 2.5e-3
