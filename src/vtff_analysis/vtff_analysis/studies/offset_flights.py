"""Flights of the radial-offset study: a scenario for each offset, and the folders of its runs."""

from __future__ import annotations

import pathlib

import numpy as np
import yaml

from vtff_analysis.recordings.topics import STATUS_TOPIC
from vtff_bag.file.errors import BagError
from vtff_bag.file.reader import BagReader
from vtff_bag.run.description import describe_run
from vtff_bag.run.folder import new_folder
from vtff_dynamics.frames.frames import deputy_state_gcrf
from vtff_msgs.msg import SimulatorStatus
from vtff_sim_bridge.truth.scenario import load_scenario
from vtff_sim_bridge.truth.scenario_fields import read_yaml

__all__ = ["SYSTEM", "complete_flight", "flight_folder", "write_offset_scenario"]

SYSTEM = "plumex"
"""System file that is flown."""


def write_offset_scenario(
    base: pathlib.Path, offset: float, seed: int, path: pathlib.Path
) -> pathlib.Path:
    """Write a scenario in which the deputy starts on its target, an offset below the chief.

    Parameters
    ----------
    base : Path
        Scenario with one deputy; its target gives the in-track position.
    offset : float
        Of the deputy below the chief, along the chief's radius, m.
    seed : int
        Of every random stream.
    path : Path
        File to write.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    ScenarioError
        If the base scenario is wrong.
    ValueError
        If it has not one deputy with a target.
    OSError
        If the file cannot be written.
    """
    scenario = load_scenario(base)
    if len(scenario.deputies) != 1 or scenario.deputies[0].target_rtn is None:
        raise ValueError(f"{base}: one deputy with a target is needed")
    target = scenario.deputies[0].target_rtn.copy()
    target[0] = -offset
    state = deputy_state_gcrf(scenario.chief.state_gcrf, target)
    content = read_yaml(base)
    content["description"] = (
        f"Deputy {offset:g} m below and {-target[1] / 1e3:g} km behind from the start, "
        "through a PLUMEX-like profile (synthetic)"
    )
    content["seed"] = seed
    deputy = content["spacecraft"][1]
    deputy["orbit"] = {
        "cartesian_gcrf": {"position": state[:3].tolist(), "velocity": state[3:].tolist()}
    }
    deputy["target"] = {
        "position_relative_rtn": target[:3].tolist(),
        "velocity_relative_rtn": target[3:].tolist(),
    }
    text = yaml.safe_dump(content, sort_keys=False)
    path.write_text(f"# Written by vtff study radial_offset from {base.name}.\n{text}", "utf-8")
    return path


def flight_folder(runs: pathlib.Path, offset: float) -> pathlib.Path:
    """Make and return a new folder for the run of an offset (m) below `runs`.

    Raises
    ------
    RunFolderError
        If it cannot be made.
    """
    return new_folder(runs / _folder_name(offset))


def complete_flight(runs: pathlib.Path, offset: float, seed: int) -> pathlib.Path | None:
    """Return the folder of a run of an offset (m) that came to its planned end, else None.

    A run counts if its bag can be read, its simulator says that it has ended, and the scenario
    in it has this offset and seed.
    """
    for folder in sorted(runs.glob(f"{_folder_name(offset)}*")):
        try:
            reader = BagReader(folder)
            if _is_complete(reader) and _is_flight_of(folder, reader, offset, seed):
                return folder
        except (BagError, OSError):
            continue
    return None


def _folder_name(offset: float) -> str:
    return f"offset_{offset:g}m"


def _is_complete(reader: BagReader) -> bool:
    if STATUS_TOPIC not in reader.topics:
        return False
    return any(
        item.message.state == SimulatorStatus.STATE_ENDED for item in reader.messages(STATUS_TOPIC)
    )


def _is_flight_of(folder: pathlib.Path, reader: BagReader, offset: float, seed: int) -> bool:
    try:
        content = yaml.safe_load(describe_run(folder, reader.custom_data).scenario_text)
        flown = content["spacecraft"][1]["target"]["position_relative_rtn"][0]
        return bool(np.isclose(flown, -offset, rtol=1e-9) and content["seed"] == seed)
    except (yaml.YAMLError, KeyError, IndexError, TypeError):
        return False
