"""A cluster whose chasers decide alone, in the graph: the same bytes twice, and a failed sensor."""

from __future__ import annotations

import numpy as np
import pytest
from graph_support import assert_equal_messages, run_vtff, topics

from vtff_bag.file.reader import BagReader


def fly(run, duration, *arguments):
    result = run_vtff(
        "run", "potential_field", "--duration", duration, "--out", run, *arguments, timeout=900.0
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def distance(run, chaser):
    return np.array(
        [
            np.linalg.norm(decoded.message.position)
            for decoded in BagReader(run).messages(f"/{chaser}/relative_state_truth")
        ]
    )


@pytest.mark.slow
def test_two_runs_are_equal_and_the_chasers_approach(tmp_path):
    runs = [tmp_path / "composed", tmp_path / "processes"]
    told = fly(runs[0], 900, "--composed")
    fly(runs[1], 900, "--distributed", "--no-report")
    assert assert_equal_messages(*runs, topics(runs[0])) > 900
    assert "The sides of the cluster" in told
    assert (runs[0] / "report" / "cluster_sides.png").exists()
    for chaser in ("chaser_1", "chaser_2"):
        flown = distance(runs[0], chaser)
        assert flown[-1] < flown[0] - 200.0
        assert flown.min() > 500.0


@pytest.mark.slow
def test_a_sensor_that_sees_nothing_leaves_its_chaser_without_neighbours(tmp_path):
    fly(tmp_path / "run", 300, "on_board_emulator.outage:=[0, 1000]", "--no-report")
    looks = [m.message for m in BagReader(tmp_path / "run").messages("/chaser_1/neighbours")]
    assert len(looks) == 31
    assert not any(look.poses for look in looks)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("setting", "reason"),
    [
        ("cluster_guidance.timeline:=['0 keep']", "gather, orbits, free_drift"),
        ("on_board_emulator.outage:=[10.0]", "two numbers"),
        ("on_board_emulator.dropout:=1.5", "dropout"),
    ],
)
def test_bad_settings_end_the_run_with_their_names(tmp_path, setting, reason):
    result = run_vtff("run", "potential_field", "--out", tmp_path / "run", setting)
    assert result.returncode == 2
    assert reason in result.stdout + result.stderr
