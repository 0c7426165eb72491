"""Settings of a run from the parameters of its nodes."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vtff_analysis.recordings.topics import DEPUTY
from vtff_bag.run.description import SCENARIO_PARAMETER, RunDescription, node_parameters
from vtff_control.tracking.sdre import DEFAULT_OPTIONS, SdreDesign
from vtff_dynamics.vectors import FloatArray
from vtff_node.plain_yaml import PlainYamlError, parse_yaml

# Emulators open their serial ports in this folder of the run (system files, `simgen_emulator`).
_EMULATED_PORTS = "/ports/"


@dataclass(frozen=True, eq=False)
class ControllerSettings:
    """Settings of the controller of one deputy; None where the run has none.

    A run names only the parameters that differ from the defaults of the controller.

    Attributes
    ----------
    target_position_rtn
        Target position relative to the chief in m, shape (3,).
    acceleration_cap
        Largest acceleration of each axis in m/s2.
    design
        Control design.
    feedforward
        Whether the holding acceleration is added.
    """

    target_position_rtn: FloatArray | None = None
    acceleration_cap: float | None = None
    design: str | None = None
    feedforward: bool | None = None


@dataclass(frozen=True, eq=False)
class RunSettings:
    """Settings of a run.

    Attributes
    ----------
    seed
        Seed of the run's random streams; None where it is not recorded.
    controllers
        Settings of the controllers by the name of the deputy.
    notes
        One line for each file that could not be read.
    receivers
        ``emulated`` or ``real``: what stands behind the ports of the receiver drivers;
        ``emulated and real`` if both do, None if the run has no driver.
    """

    seed: int | None = None
    controllers: dict[str, ControllerSettings] = dataclasses.field(default_factory=dict)
    notes: tuple[str, ...] = ()
    receivers: str | None = None

    def controller(self, deputy: str) -> ControllerSettings:
        """Return the settings of a deputy's controller, empty ones if it has none."""
        return self.controllers.get(deputy, ControllerSettings())


def read_settings(described: RunDescription) -> RunSettings:
    """Take the settings from the parameters of the nodes.

    Parameters
    ----------
    described
        The run; without parameters the settings are empty.

    Returns
    -------
    RunSettings
    """
    notes: list[str] = []
    seed: int | None = None
    controllers: dict[str, ControllerSettings] = {}
    kinds: set[str] = set()
    for name, text in sorted(described.parameter_texts.items()):
        nodes = node_parameters(text)
        if not nodes:
            notes.append(f"parameters/{name}.yaml: not a ROS parameter file")
        for node, values in nodes.items():
            if node.endswith("/receiver_driver") and "port" in values:
                kinds.add("emulated" if _EMULATED_PORTS in str(values["port"]) else "real")
            if "target_position_rtn" in values:
                deputy = str(values.get("deputy", DEPUTY))
                controllers[deputy] = _controller_settings(values, name, notes)
            if SCENARIO_PARAMETER in values:
                seed = _seed(values, described.scenario_text)
    return RunSettings(seed, controllers, tuple(notes), " and ".join(sorted(kinds)) or None)


def _controller_settings(
    values: Mapping[str, Any], name: str, notes: list[str]
) -> ControllerSettings:
    target: FloatArray | None = None
    cap: float | None = None
    try:
        target = np.array(values["target_position_rtn"], dtype=float).reshape(3)
        cap = float(values.get("acceleration_cap", SdreDesign.acceleration_cap))
    except (TypeError, ValueError):
        notes.append(
            f"parameters/{name}.yaml: target_position_rtn or acceleration_cap is not numeric"
        )
    design = str(values.get("design", SdreDesign.design))
    feedforward = bool(values.get("feedforward", SdreDesign.feedforward))
    if design in DEFAULT_OPTIONS:
        feedforward = feedforward or DEFAULT_OPTIONS[design].feedforward
    return ControllerSettings(
        target_position_rtn=target,
        acceleration_cap=cap,
        design=design,
        feedforward=feedforward,
    )


def _seed(values: Mapping[str, Any], scenario_text: str) -> int | None:
    """Return the seed of the run: that of the parameters, else that of the scenario file."""
    seed = values.get("seed", -1)
    if not (isinstance(seed, int) and seed >= 0):
        try:
            scenario = parse_yaml(scenario_text)
        except PlainYamlError:
            return None
        seed = scenario.get("seed") if isinstance(scenario, Mapping) else None
    return seed if isinstance(seed, int) else None
