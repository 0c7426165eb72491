"""A case flown without ROS: the closed loop of truth, controller and thruster in this process."""

from __future__ import annotations

import dataclasses
from typing import Any

from vtff_analysis.closed_loop.simulation import simulate_closed_loop
from vtff_analysis.closed_loop.summary import summarise_closed_loop
from vtff_bringup.campaign.cases import Case
from vtff_bringup.campaign.plan import FlightPlan, case_files
from vtff_control.tracking.sdre import SdreDesign
from vtff_sim_bridge.truth.scenario import read_scenario

__all__ = ["CONTROLLER_PARAMETERS", "THRUSTER_PARAMETERS", "fly_library_case"]

CONTROLLER_PARAMETERS = tuple(
    field.name
    for field in dataclasses.fields(SdreDesign)
    if field.name not in ("sample_time", "mean_motion", "disturbance_observer")
)
"""Parameters of sdre_controller that the closed loop uses."""

THRUSTER_PARAMETERS = ("acceleration_cap", "quantum", "delay_steps")
"""Parameters of thruster_model that the closed loop uses."""


def fly_library_case(plan: FlightPlan, case: Case) -> dict[str, Any]:
    """Fly a case and return its figures by name, as docs/summary.md describes them.

    Raises
    ------
    ValueError
        If the scenario or a parameter is refused.
    """
    files = case_files(plan, case)
    source = files["scenario"]
    scenario = read_scenario(source.fields, source.name, case.seed)
    if plan.duration is not None:
        scenario = dataclasses.replace(scenario, duration=plan.duration)
    controller = _parameters(plan.controller, CONTROLLER_PARAMETERS, plan.controller_name, case)
    result = simulate_closed_loop(
        scenario,
        SdreDesign(sample_time=scenario.step, **controller),
        _parameters(plan.thruster, THRUSTER_PARAMETERS, plan.thruster_name, case),
    )
    return summarise_closed_loop(result)


def _parameters(parameters: Any, names: tuple[str, ...], node: str, case: Case) -> dict[str, Any]:
    """Return parameters of a node with those that the case sets."""
    values = {name: parameters[name] for name in names}
    for key, value in case.settings.items():
        owner, _, name = key.partition(".")
        if owner.rpartition("/")[2] == node and name in values:
            values[name] = value
    return values
