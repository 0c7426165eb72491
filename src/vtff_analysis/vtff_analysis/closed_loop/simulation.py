"""Closed loop of truth, controller and thruster in one process, without ROS.

The fast twin of the node graph: the same modules called in the same order with the same numbers,
so that a run over the real topics must reproduce it. One hour takes a fraction of a second, which
makes parameter studies cheap (`vtff_analysis.studies`).

Timing, for a thruster delay of one step: the state at t[k] gives the command u[k], which acts
over [t[k+1], t[k+2]] in the RTN axes that the chief has at t[k+1].
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from vtff_analysis.closed_loop.drawn_navigation import DrawnNavigation, NavigationErrorModel
from vtff_control.thruster.thruster import Thruster
from vtff_control.tracking.controller import Controller, takes_covariance
from vtff_control.tracking.sdre import SdreController, SdreDesign
from vtff_dynamics.vectors import FloatArray
from vtff_sim_bridge.truth.formation_truth import FormationTruth
from vtff_sim_bridge.truth.scenario import Scenario


@dataclass(frozen=True, eq=False)
class DeputyHistory:
    """History of one deputy; n steps give n + 1 states.

    Attributes
    ----------
    state_relative_rtn
        Position (m) and rotating-frame velocity (m/s) in the chief's RTN frame, shape (n+1, 6).
    target_rtn
        Wanted relative state, shape (6,).
    command_rtn
        Command computed from the state at the start of each step in m/s2, shape (n, 3).
    applied_rtn
        Acceleration applied during each step in m/s2, shape (n, 3).
    """

    state_relative_rtn: FloatArray
    target_rtn: FloatArray
    command_rtn: FloatArray
    applied_rtn: FloatArray


@dataclass(frozen=True, eq=False)
class ClosedLoopResult:
    """History of a closed loop.

    Attributes
    ----------
    time
        Time since the epoch in s, shape (n+1,).
    state_chief_gcrf
        Position (m) and velocity (m/s) of the chief in GCRF, shape (n+1, 6).
    deputies
        History of every controlled deputy by name.
    """

    time: FloatArray
    state_chief_gcrf: FloatArray
    deputies: dict[str, DeputyHistory]

    @property
    def step(self) -> float:
        """Length of a step in s."""
        return float(self.time[1] - self.time[0])

    def deputy(self, name: str | None = None) -> DeputyHistory:
        """Return the history of a deputy, by default of the first."""
        return self.deputies[name] if name is not None else next(iter(self.deputies.values()))

    def total_delta_v(self, name: str | None = None) -> FloatArray:
        """Sum of ``|applied| dt`` over the run for each of R, T, N in m/s, shape (3,)."""
        return np.asarray(np.abs(self.deputy(name).applied_rtn).sum(axis=0) * self.step)

    def minimum_in_track(self, name: str | None = None) -> tuple[float, float]:
        """Return the smallest in-track position in m and its time in s."""
        in_track = self.deputy(name).state_relative_rtn[:, 1]
        index = int(np.argmin(in_track))
        return float(in_track[index]), float(self.time[index])

    def settling_time(self, tolerance: float = 1.0, name: str | None = None) -> float:
        """Return the time in s from which the target is kept to the end of the run.

        Parameters
        ----------
        tolerance
            Largest distance from the target in m.
        name
            Deputy, by default the first.

        Returns
        -------
        float
            Infinity if the last state is not within the tolerance.
        """
        history = self.deputy(name)
        deviation = history.state_relative_rtn[:, :3] - history.target_rtn[:3]
        outside = np.flatnonzero(np.linalg.norm(deviation, axis=1) > tolerance)
        if outside.size == 0:
            return float(self.time[0])
        if outside[-1] == len(self.time) - 1:
            return float("inf")
        return float(self.time[outside[-1] + 1])


def simulate_closed_loop(
    scenario: Scenario,
    design: SdreDesign,
    thruster_parameters: Mapping[str, object] | None = None,
    duration: float | None = None,
    navigation: NavigationErrorModel | None = None,
    make_controller: Callable[[], Controller] | None = None,
) -> ClosedLoopResult:
    """Fly a scenario with truth, or drawn navigation, fed to the controller.

    Parameters
    ----------
    scenario
        Initial states, forces and targets. Every deputy with a target is controlled.
    design
        Controller of each deputy.
    thruster_parameters
        Keyword arguments of `vtff_control.thruster.thruster.Thruster`; by default the cap and the
        delay of the design, and no quantum. The step is that of the scenario.
    duration
        Length of the run in s, by default that of the scenario.
    navigation
        Errors of the states that the controller gets with their covariance; truth if absent. The
        errors of each deputy are drawn from the seed and its number.
    make_controller
        Called for the controller of each deputy, such as one of a plug-in; by default that of the
        design, of which only sample time, delay and cap count otherwise.

    Returns
    -------
    ClosedLoopResult

    Raises
    ------
    ValueError
        If no deputy has a target, if the controller's sample time is not the scenario's step, or
        if the duration is shorter than a step.
    """
    targets = {
        deputy.name: deputy.target_rtn
        for deputy in scenario.deputies
        if deputy.target_rtn is not None
    }
    if not targets:
        raise ValueError(f"scenario {scenario.name}: no deputy has a target")
    if design.sample_time != scenario.step:
        raise ValueError(
            f"sample_time: {design.sample_time:g} s is not the scenario's step of "
            f"{scenario.step:g} s"
        )
    steps = round((scenario.duration if duration is None else duration) / scenario.step)
    if steps < 1:
        raise ValueError(f"duration: at least one step of {scenario.step:g} s expected")
    truth = scenario.formation_truth()
    loops = {
        name: _DeputyLoop(
            target,
            design,
            thruster_parameters,
            steps,
            _drawn_navigation(navigation, index, scenario),
            SdreController(design) if make_controller is None else make_controller(),
        )
        for index, (name, target) in enumerate(targets.items())
    }
    states_chief = np.empty((steps + 1, 6))
    for step in range(steps):
        states_chief[step] = truth.state_gcrf(truth.chief)
        truth.advance(
            {
                name: loop.react(step, truth, truth.relative_state_rtn(name), states_chief[step])
                for name, loop in loops.items()
            }
        )
    states_chief[steps] = truth.state_gcrf(truth.chief)
    for name, loop in loops.items():
        loop.states[steps] = truth.relative_state_rtn(name)
    return ClosedLoopResult(
        np.arange(steps + 1, dtype=np.float64) * scenario.step,
        states_chief,
        {name: loop.history() for name, loop in loops.items()},
    )


def _drawn_navigation(
    model: NavigationErrorModel | None, index: int, scenario: Scenario
) -> DrawnNavigation | None:
    """Return the navigation of a deputy; it knows the forces of the scenario, not its own."""
    if model is None:
        return None
    model = dataclasses.replace(model, seed=model.seed + index)
    return DrawnNavigation(model, scenario.force_model, scenario.step)


class _DeputyLoop:
    """Controller, thruster and history of one deputy."""

    def __init__(
        self,
        target_rtn: FloatArray,
        design: SdreDesign,
        thruster_parameters: Mapping[str, object] | None,
        steps: int,
        navigation: DrawnNavigation | None,
        controller: Controller,
    ) -> None:
        parameters: dict[str, object] = {
            "acceleration_cap": design.acceleration_cap,
            "delay_steps": design.delay_steps,
        }
        parameters.update(thruster_parameters or {})
        parameters["step"] = design.sample_time
        self._target = target_rtn
        self._navigation = navigation
        self._controller = controller
        self._takes_covariance = takes_covariance(controller)
        self._thruster = Thruster(**parameters)  # type: ignore[arg-type]
        self._scheduled: dict[int, FloatArray] = {}
        self.states = np.empty((steps + 1, 6))
        self._commands = np.empty((steps, 3))
        self._applied = np.empty((steps, 3))

    def react(
        self, step: int, truth: FormationTruth, relative_state: FloatArray, state_chief: FloatArray
    ) -> FloatArray:
        """Control one step and return the acceleration that acts in it."""
        stamp = truth.time.nanoseconds
        estimate, covariance = relative_state, None
        if self._navigation is not None:
            elapsed = step * self._thruster.step
            estimate, covariance = self._navigation.estimate(
                truth.time, elapsed, state_chief, relative_state
            )
        state = (estimate, state_chief, self._target, stamp)
        if self._takes_covariance:
            result = self._controller.control(*state, covariance)
        else:
            result = self._controller.control(*state)
        thrust = self._thruster.command(stamp, result.acceleration_rtn)
        self._scheduled[thrust.start_stamp] = thrust.acceleration_rtn
        applied = self._scheduled.pop(stamp, np.zeros(3))
        self.states[step] = relative_state
        self._commands[step] = result.acceleration_rtn
        self._applied[step] = applied
        if self._navigation is not None:
            self._navigation.add_thrust(applied)
        return applied

    def history(self) -> DeputyHistory:
        """Return what was recorded."""
        return DeputyHistory(self.states, self._target, self._commands, self._applied)
