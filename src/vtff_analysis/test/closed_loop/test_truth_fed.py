"""The truth-fed twin of a recorded run."""

from pathlib import Path

import pytest

from vtff_analysis.closed_loop.truth_fed import summarise_truth_fed
from vtff_bag.run.description import RunDescription
from vtff_node.plain_yaml import format_yaml

CONFIG = Path(__file__).resolve().parents[4] / "config"
SCENARIO = (CONFIG / "scenario" / "reference.yaml").read_text(encoding="utf-8")
CAN_THRUSTER = {"dbc_file": "config/can/vtff_thruster.dbc"}


def described(
    controller: dict[str, object], thruster: dict[str, object], scenario: str = SCENARIO
) -> RunDescription:
    controller = {"deputy": "deputy", "target_position_rtn": [0.0, 100.0, 0.0], **controller}
    nodes = {"/sdre_controller": controller, "/deputy/thruster": thruster}
    texts = {
        name: format_yaml({name: {"ros__parameters": values}}) for name, values in nodes.items()
    }
    return RunDescription(parameter_texts=texts, scenario_text=scenario)


def test_the_twin_flies_controller_and_thruster_of_the_run() -> None:
    """Without feedforward J2 shows along N, and the quantum of the CAN thruster on R."""
    design = {"design": "delay_aware", "acceleration_cap": 1.4}
    linear = summarise_truth_fed(described(design, CAN_THRUSTER), "deputy", 1, 900.0)
    assert linear["truth_fed_settled_keeping_cross_track_rms_m"] > 1e-3
    assert linear["truth_fed_settled_keeping_radial_rms_m"] > 1e-4
    design["design"] = "navigation_aware"
    shipped = summarise_truth_fed(described(design, CAN_THRUSTER), "deputy", 1, 900.0)
    assert max(shipped[f"truth_fed_settled_keeping_{axis}_rms_m"] for axis in AXES) < 2e-4
    assert set(shipped) == set(linear)


AXES = ("radial", "in_track", "cross_track")


@pytest.mark.parametrize(
    "run",
    [
        RunDescription(),
        described({}, {}, ""),
        described({"design": "mylab_controller"}, {}),
        described({"acceleration_cap": "much"}, {}),
        described({"deputy": "another"}, {}),
        described({}, {}, "name: [\n"),
    ],
)
def test_what_cannot_be_flown_has_no_twin(run: RunDescription) -> None:
    assert summarise_truth_fed(run, "deputy", None, 900.0) == {}


def test_a_run_without_settled_keeping_has_no_figures() -> None:
    assert summarise_truth_fed(described({}, {}), "deputy", 1, 300.0) == {}
