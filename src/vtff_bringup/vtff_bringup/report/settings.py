"""Settings of a run from the files that the runner left beside the bag."""

from __future__ import annotations

import dataclasses
import pathlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml

from vtff_bringup.report.history import FloatArray

DEFAULT_DEPUTY = "deputy"  # default of the controller's parameter 'deputy'


@dataclass(frozen=True, eq=False)
class ControllerSettings:
    """Settings of the controller of one deputy; None where the run's parameters do not tell.

    Attributes
    ----------
    target_position_rtn
        Wanted position relative to the chief in m, shape (3,).
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
        Seed of the run's random streams; None where unknown.
    controllers
        By the name of the deputy.
    notes
        One line for each file that could not be read.
    """

    seed: int | None = None
    controllers: dict[str, ControllerSettings] = dataclasses.field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def controller(self, deputy: str) -> ControllerSettings:
        """Return the settings of a deputy's controller, empty ones if it has none."""
        return self.controllers.get(deputy, ControllerSettings())


def read_settings(run_directory: pathlib.Path) -> RunSettings:
    """Read the ROS parameter files in ``<run_directory>/parameters``.

    Parameters
    ----------
    run_directory
        Folder of the run; without parameter files the settings are empty.

    Returns
    -------
    RunSettings
    """
    notes: list[str] = []
    seed: int | None = None
    controllers: dict[str, ControllerSettings] = {}
    for path in sorted((run_directory / "parameters").glob("*.yaml")):
        for values in _node_parameters(_read_yaml(path, notes)):
            if "target_position_rtn" in values:
                deputy = str(values.get("deputy", DEFAULT_DEPUTY))
                controllers[deputy] = _controller(values, path, notes)
            if "scenario_file" in values:
                seed = _seed(values, notes)
    return RunSettings(seed, controllers, tuple(notes))


def _read_yaml(path: pathlib.Path, notes: list[str]) -> Any:
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        notes.append(f"{path}: cannot be read: {str(error).splitlines()[0]}")
        return None


def _node_parameters(content: Any) -> list[Mapping[str, Any]]:
    """Return the parameters of every node in a ROS parameter file."""
    nodes = content.values() if isinstance(content, Mapping) else ()
    found = [node.get("ros__parameters") for node in nodes if isinstance(node, Mapping)]
    return [parameters for parameters in found if isinstance(parameters, Mapping)]


def _controller(
    values: Mapping[str, Any], path: pathlib.Path, notes: list[str]
) -> ControllerSettings:
    target: FloatArray | None = None
    cap: float | None = None
    try:
        target = np.array(values["target_position_rtn"], dtype=float).reshape(3)
        cap = float(values["acceleration_cap"]) if "acceleration_cap" in values else None
    except (TypeError, ValueError):
        notes.append(f"{path}: target_position_rtn or acceleration_cap is not numeric")
    design = values.get("design")
    feedforward = values.get("feedforward")
    return ControllerSettings(
        target_position_rtn=target,
        acceleration_cap=cap,
        design=None if design is None else str(design),
        feedforward=None if feedforward is None else bool(feedforward),
    )


def _seed(values: Mapping[str, Any], notes: list[str]) -> int | None:
    """Return the seed of the run: of the parameters, else of the scenario file."""
    given = values.get("seed", -1)
    if not (isinstance(given, int) and given >= 0):
        scenario = _read_yaml(pathlib.Path(str(values["scenario_file"])), notes)
        given = scenario.get("seed") if isinstance(scenario, Mapping) else None
    return given if isinstance(given, int) else None
