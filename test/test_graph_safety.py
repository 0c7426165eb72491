"""The safety monitor in the graph: a thruster gets stuck on the approach, twice the same way."""

from __future__ import annotations

import hashlib
import json

import pytest
from graph_support import SYSTEMS, run_vtff

from vtff_bag.file.reader import BagReader
from vtff_msgs.msg import FormationSafety
from vtff_node.plain_yaml import format_yaml

pytestmark = pytest.mark.slow

STUCK_AFTER = 25.0
GUARDED = {
    "description": "Reference formation on truth, guarded, with a thruster that gets stuck",
    "extends": str(SYSTEMS / "reference_software.yaml"),
    "nodes": [
        {
            "package": "vtff_control",
            "executable": "sdre_controller",
            "namespace": "${deputy}",
            "parameters": {"design": "navigation_aware"},
        },
        {
            "package": "vtff_control",
            "executable": "thruster_model",
            "name": "thruster",
            "namespace": "${deputy}",
            "parameters": {"stuck_acceleration": [0.0, -1.4, 0.0], "stuck_after": STUCK_AFTER},
            "remaps": {"control/thrust_command": "control/thrust_command_checked"},
        },
        {
            "package": "vtff_control",
            "executable": "formation_safety",
            "parameter_files": [str(SYSTEMS.parent / "params" / "formation_safety.yaml")],
            "parameters": {
                "chief": "${chief}",
                "deputies": "${deputies}",
                "relative_state": "relative_state_truth",
                "hard_radius": "${scenario.hard_radius}",
                "step": "${scenario.step}",
            },
        },
    ],
}


def fly(folder, *arguments):
    system = folder / "guarded.yaml"
    system.write_text(format_yaml(GUARDED), encoding="utf-8")
    run = folder / arguments[0].strip("-")
    result = run_vtff("run", system, "--duration", 100, "--out", run, *arguments)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "formation_safety took deputy over" in result.stdout
    summary = json.loads((run / "report" / "summary.json").read_text())
    digests = {}
    for raw in BagReader(run).raw_messages(["/formation/safety", "/deputy/relative_state_truth"]):
        digests.setdefault(raw.topic, hashlib.sha256()).update(raw.serialized)
    return run, summary, {topic: digest.hexdigest() for topic, digest in digests.items()}


def test_a_stuck_thruster_is_isolated_and_30_m_are_kept(tmp_path):
    run, summary, digests = fly(tmp_path, "--distributed")
    assert summary["minimum_separation_m"] >= 30.0
    assert summary["safety_isolated_axes"] == "T"
    assert summary["safety_taken_over_time_s"] - STUCK_AFTER <= 2.0
    messages = [item.message for item in BagReader(run).messages("/formation/safety")]
    assert messages[0].mode[0] == FormationSafety.MODE_MONITOR
    assert "stuck on along T" in messages[-1].reason[0]
    # Composed in one process it is the same, byte for byte.
    assert fly(tmp_path, "--composed")[2] == digests
