"""A survey of plasma bubbles in the graph: plans, arrives, drifts; the same bytes twice."""

from __future__ import annotations

import numpy as np
import pytest
from graph_support import assert_equal_messages, run_vtff, topics

from vtff_bag.file.reader import BagReader
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.relative.separation import closest_on_path
from vtff_msgs.msg import FormationGuidance


def messages(run, topic):
    return [decoded.message for decoded in BagReader(run).messages(topic)]


def fly(run, duration, *arguments, system="survey_software"):
    result = run_vtff(
        "run", system, "--duration", duration, "--out", run, *arguments, timeout=900.0
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return run


@pytest.mark.parametrize(
    ("system", "duration", "form", "fewest"),
    [
        ("survey_software", 700, "--composed", 1000),  # two walls are crossed
        # The first minutes: every message of receivers, navigation and ionosphere chain.
        pytest.param("survey", 120, "--distributed", 8000, marks=pytest.mark.slow),
    ],
)
def test_the_same_seed_gives_the_same_bytes(tmp_path, system, duration, form, fewest):
    runs = [
        fly(tmp_path / f"run{number}", duration, given, "--no-report", system=system)
        for number, given in enumerate(("--composed", form))
    ]
    assert assert_equal_messages(*runs, topics(runs[0])) > fewest


@pytest.mark.slow
def test_the_first_pass_and_the_plan_after_it_are_flown_the_same_way_twice(tmp_path):
    runs = [
        fly(tmp_path / f"run{number}", 2000, *form)
        for number, form in enumerate((("--composed",), ("--distributed", "--no-report")))
    ]
    assert assert_equal_messages(*runs, topics(runs[0])) > 2000
    assert messages(runs[0], "/formation/survey")[-1].plans == 1


@pytest.mark.slow
def test_plans_once_samples_the_next_pass_and_drifts_safely(tmp_path):
    first = fly(tmp_path / "run", 9000)
    decisions = messages(first, "/formation/survey")
    last = decisions[-1]
    assert last.phase == "survey"
    assert last.plans == 1
    assert list(last.wall_passes) == [2] * 6
    assert abs(last.drift - 101.0) < 10.0
    modes = {message.mode for message in messages(first, "/formation/guidance")[-50:]}
    assert modes == {FormationGuidance.MODE_FREE_DRIFT}
    # Truth: from any time on, two orbits without thrust.
    chief = np.array([[*m.position, *m.velocity] for m in messages(first, "/chief/truth/orbit")])
    deputy = np.array([[*m.position, *m.velocity] for m in messages(first, "/deputy/truth/orbit")])
    for index in range(0, len(chief), 20):
        flown = free_flight(np.stack((chief[index], deputy[index])), np.arange(0.0, 11200.0, 20.0))
        assert closest_on_path(flown[:, 1, :3] - flown[:, 0, :3]) > 100.0
