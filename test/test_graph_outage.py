"""All satellites are lost while the deputy approaches: the loop flies on by its prediction."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from graph_support import ROOT, run_vtff

from vtff_bag.file.reader import BagReader
from vtff_msgs.msg import RelativeState
from vtff_node.plain_yaml import format_yaml, parse_yaml

pytestmark = pytest.mark.slow

TARGET = (0.0, 100.0, 0.0)
THRUSTER_ERRORS = {"scale": 1.05, "misalignment_deg": 2.0, "noise": 0.01}


def changed(folder, name, change):
    """Write config/<name> with a change into a folder and return the path."""
    content = parse_yaml((ROOT / "config" / name).read_text(encoding="utf-8"))
    change(content)
    path = folder / name.replace("/", "_")
    path.write_text(format_yaml(content), encoding="utf-8")
    return path


def without_satellites(gnss):
    gnss["faults"] = [
        {"time": 15.0, "duration": 40.0, "receiver": receiver, "kind": "outage"}
        for receiver in ("chief", "deputy")
    ]


@pytest.mark.parametrize("errors", [None, THRUSTER_ERRORS], ids=["exact thrust", "thrust errors"])
def test_an_outage_in_the_approach_ends_at_the_target(tmp_path, errors):
    """A controller that cut the thrust by the age of its state passed the chief at 3.4 m."""

    def change_thruster(scenario):
        if errors is not None:
            scenario["spacecraft"][1]["thruster_errors"] = errors

    result = run_vtff(
        "run", "reference", "--composed", "--duration", 420, "--out", tmp_path / "run",
        f"gnss:={changed(tmp_path, 'gnss/reference.yaml', without_satellites)}",
        f"scenario:={changed(tmp_path, 'scenario/reference.yaml', change_thruster)}",
        timeout=400.0,
    )  # fmt: skip
    assert result.returncode == 0, result.stdout + result.stderr
    summary = json.loads((tmp_path / "run" / "report" / "summary.json").read_text())
    assert summary["minimum_separation_m"] >= 60.0
    totals = [value for key, value in summary.items() if key.startswith("delta_v_total_")]
    assert sum(totals) <= 75.0
    reader = BagReader(tmp_path / "run")
    truth = [item.message for item in reader.messages("/deputy/relative_state_truth")]
    assert max(math.dist(message.position, TARGET) for message in truth[-60:]) <= 1.0
    solutions = [item.message.solution for item in reader.messages("/deputy/relative_state")]
    assert solutions.count(RelativeState.SOLUTION_PREDICTED) >= 35
    thrust = [
        (item.message.accel.linear.x, item.message.accel.linear.y, item.message.accel.linear.z)
        for item in reader.messages("/deputy/control/thrust_command")
    ]
    # It brakes in the outage, not when the satellites are back.
    assert np.max(np.array(thrust)[30:55, 1]) > 0.5
