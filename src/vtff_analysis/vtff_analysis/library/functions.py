"""A baseline, electron contents, a flight: one call each, with checked arguments."""

from __future__ import annotations

import dataclasses
import os
import pathlib
from collections.abc import Sequence

import numpy.typing as npt

from vtff_analysis.baseline.defaults import complete_options
from vtff_analysis.baseline.processing import BaselineRun, process_baseline
from vtff_analysis.baseline.sources import from_files
from vtff_analysis.closed_loop.simulation import ClosedLoopResult, simulate_closed_loop
from vtff_analysis.tec.processing import TecResult, process
from vtff_analysis.tec.sources import from_file
from vtff_control.tracking.controller import ControllerSetting
from vtff_control.tracking.sdre import DESIGNS, SdreDesign
from vtff_dynamics.checks import check_vector
from vtff_dynamics.vectors import norm
from vtff_gnss.files.navigation_files import open_navigation
from vtff_nav.relative.common.dynamics import DYNAMICS
from vtff_nav.relative.common.measurements import DEFAULT_BANDS
from vtff_node.plugins.groups import CONTROLLERS
from vtff_node.plugins.loading import load_plugin
from vtff_sim_bridge.truth.scenario import Scenario, load_scenario

__all__ = ["baseline", "fly", "tec"]

Paths = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]

_NEAREST_TO_CENTRE = 6.3e6  # m


def baseline(
    rover: str | os.PathLike[str],
    base: str | os.PathLike[str],
    nav: Paths = (),
    dynamics: str | None = None,
    position_base_itrf: npt.ArrayLike | None = None,
) -> BaselineRun:
    """Return the position of one recorded receiver relative to another, as `vtff baseline`.

    Parameters
    ----------
    rover, base
        Observation files: RINEX 2, 3 or 4 or NovAtel logs, compressed or not.
    nav
        Navigation files; none where the logs hold ephemerides.
    dynamics : {"static", "kinematic", "orbital"}, optional
        Motion of the rover; by default orbital where the base is higher than 100 km, else
        kinematic.
    position_base_itrf : array_like, shape (3,), optional
        Surveyed position of the base, m; by default that of its RINEX header, else estimated.

    Raises
    ------
    ValueError
        If an argument is wrong, or a file cannot give a baseline; the text names it.
    OSError
        If a file cannot be read.
    """
    if dynamics is not None and dynamics not in DYNAMICS:
        raise ValueError(f"dynamics: expected one of {', '.join(DYNAMICS)}; got {dynamics!r}")
    position = None
    if position_base_itrf is not None:
        checked = check_vector("position_base_itrf", position_base_itrf, 3, "m")
        if norm(checked) < _NEAREST_TO_CENTRE:
            hint = " (is it in km, or latitude and longitude?)"
            raise ValueError(
                f"position_base_itrf: expected {_NEAREST_TO_CENTRE:g} m or more from the centre "
                f"of the Earth; got {norm(checked):g} m{hint}"
            )
        x, y, z = checked.tolist()
        position = (x, y, z)
    sources = from_files(pathlib.Path(rover), pathlib.Path(base), _paths(nav))
    options = complete_options(
        sources, dynamics, "cdgps", dict(DEFAULT_BANDS), base_position=position
    )
    return process_baseline(sources, options)


def tec(observations: str | os.PathLike[str], nav: Paths = ()) -> TecResult:
    """Return the electron contents over a recorded receiver, as `vtff tec`.

    Parameters
    ----------
    observations
        Observation file of two frequencies.
    nav
        Navigation files, whose group delays are the biases of the satellites; none where the log
        holds ephemerides.

    Raises
    ------
    ValueError
        If a file cannot give contents; the text names it and the reason.
    OSError
        If a file cannot be read.
    """
    return process(from_file(pathlib.Path(observations)), open_navigation(_paths(nav)), "broadcast")


def fly(
    scenario: str | os.PathLike[str] | Scenario,
    design: str = "paper",
    duration: float | None = None,
    acceleration_cap: float = 1.0,
) -> ClosedLoopResult:
    """Fly a scenario in this process: truth, controller and thruster, without ROS.

    Parameters
    ----------
    scenario
        Scenario file (``config/scenario/*.yaml``), or what `load_scenario` returns.
    design : str
        Controller, with its defaults: paper, state_dependent, delay_aware, navigation_aware, or
        that of an installed plug-in (docs/plugins.md). `simulate_closed_loop` takes all parameters.
    duration : float, optional
        s; by default that of the scenario.
    acceleration_cap : float, optional
        Largest acceleration on each axis, m/s2. The default is that of the remote-sensing flight
        of paper 000; the systems of `vtff run` fly with the 1.4 m/s2 of its appendix A.

    Raises
    ------
    ValueError
        If the scenario, the design, the duration or the cap is wrong; the text names it.
    OSError
        If the scenario cannot be read.
    """
    flown = scenario if isinstance(scenario, Scenario) else load_scenario(pathlib.Path(scenario))
    if duration is not None:
        flown = dataclasses.replace(flown, duration=duration)
    if design in DESIGNS:
        chosen = SdreDesign(design, sample_time=flown.step, acceleration_cap=acceleration_cap)
        return simulate_closed_loop(flown, chosen)
    plugin = load_plugin(CONTROLLERS, design)
    table = plugin.parameter_table
    setting = ControllerSetting(sample_time=flown.step, acceleration_cap=acceleration_cap)
    return simulate_closed_loop(
        flown,
        SdreDesign(sample_time=flown.step, acceleration_cap=acceleration_cap),
        make_controller=lambda: plugin.make(setting, None if table is None else table()),
    )


def _paths(given: Paths) -> list[pathlib.Path]:
    if isinstance(given, (str, os.PathLike)):
        return [pathlib.Path(given)]
    return [pathlib.Path(path) for path in given]
