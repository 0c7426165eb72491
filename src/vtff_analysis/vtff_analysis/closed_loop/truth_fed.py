"""How the controller of a recorded run keeps the formation when it is fed with the truth."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from vtff_analysis.closed_loop.simulation import simulate_closed_loop
from vtff_analysis.closed_loop.summary import summarise_closed_loop
from vtff_analysis.recordings.topics import DEPUTY
from vtff_bag.run.description import RunDescription, node_parameters
from vtff_control.tracking.sdre import DESIGNS, SdreDesign
from vtff_node.plain_yaml import parse_yaml
from vtff_sim_bridge.thruster.can_thruster_emulator import QUANTUM
from vtff_sim_bridge.truth.scenario import Scenario, read_scenario

__all__ = ["summarise_truth_fed"]

LONGEST = 1800.0
"""Longest time that a twin flies, s: a run of a day shall not wait for its twin."""


def summarise_truth_fed(
    described: RunDescription, deputy: str, seed: int | None, duration: float
) -> dict[str, Any]:
    """Return the figures ``truth_fed_settled_keeping_...`` of docs/summary.md.

    Parameters
    ----------
    described
        Scenario and parameters of the run.
    deputy
        Name of the deputy.
    seed
        Seed of the run; None takes that of the scenario.
    duration
        Length of the run, s.

    Returns
    -------
    dict
        Empty where scenario or controller are not recorded, are not shipped, or cannot be flown.
    """
    controller, thruster = _parameters(described, deputy)
    if controller is None or str(controller.get("design", SdreDesign.design)) not in DESIGNS:
        return {}
    try:
        fields = parse_yaml(described.scenario_text)
        scenario = _scenario_of(read_scenario(fields, "scenario", seed), deputy, controller)
        design = _design(controller, scenario.step)
        quantum = QUANTUM if "dbc_file" in thruster else float(thruster.get("quantum", 0.0))
        result = simulate_closed_loop(
            scenario, design, {"quantum": quantum}, duration=min(duration, LONGEST)
        )
    except (ValueError, TypeError, LookupError, OSError):
        return {}  # a damaged recording, or one of a version with other fields
    return {
        f"truth_fed_{key}": value
        for key, value in summarise_closed_loop(result).items()
        if key.startswith("settled_keeping_")
    }


def _parameters(
    described: RunDescription, deputy: str
) -> tuple[Mapping[str, Any] | None, Mapping[str, Any]]:
    """Return the parameters of the deputy's controller, None without one, and of its thruster."""
    controller: Mapping[str, Any] | None = None
    thruster: Mapping[str, Any] = {}
    for text in described.parameter_texts.values():
        for node, values in node_parameters(text).items():
            if "target_position_rtn" in values and values.get("deputy", DEPUTY) == deputy:
                controller = values
            if node == f"/{deputy}/thruster":
                thruster = values
    return controller, thruster


def _scenario_of(scenario: Scenario, deputy: str, controller: Mapping[str, Any]) -> Scenario:
    """Return the scenario with that deputy alone, and with the target of its controller."""
    (craft,) = (craft for craft in scenario.deputies if craft.name == deputy)
    target = [
        *controller["target_position_rtn"],
        *controller.get("target_velocity_rtn", (0.0, 0.0, 0.0)),
    ]
    craft = dataclasses.replace(craft, target_rtn=np.array(target, dtype=float))
    return dataclasses.replace(scenario, spacecraft=(scenario.chief, craft))


def _design(controller: Mapping[str, Any], sample_time: float) -> SdreDesign:
    """Return the design that the node made of its parameters."""
    names = {field.name for field in dataclasses.fields(SdreDesign)} - {"sample_time"}
    values = {name: value for name, value in controller.items() if name in names}
    return SdreDesign(**values, sample_time=sample_time)
