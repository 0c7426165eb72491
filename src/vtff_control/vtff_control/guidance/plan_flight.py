"""Flying a reconfiguration plan: the thrust of its steps, and the return to its path.

The plan is relative to a virtual reference orbit; only the states of the spacecraft relative to
each other are measured well. So the deviations from the plan are taken about their mean, and the
formation as a whole is left where it drifts.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicHermiteSpline

from vtff_control.guidance.reconfiguration_plan import ReconfigurationPlan
from vtff_dynamics.frames.rtn import relative_state_rtn, rotation_gcrf_to_rtn
from vtff_dynamics.orbit.free_flight import add_thrust, free_flight
from vtff_dynamics.relative.separation import closest_on_path
from vtff_dynamics.vectors import FloatArray

__all__ = ["PlanFlight"]

_DAMPING = 0.7


class PlanFlight:
    """One reconfiguration under way.

    Parameters
    ----------
    plan
        The plan.
    start
        Its beginning, s.
    formation
        Where it leads.
    bandwidth
        Natural frequency of the return to the path, rad/s.

    Attributes
    ----------
    unsafe_losses
        With passive safety: step of the plan and smallest distance (m) of each step in which a
        loss of thrust does not leave the closest approach.
    """

    def __init__(
        self, plan: ReconfigurationPlan, start: float, formation: str, bandwidth: float
    ) -> None:
        self.plan = plan
        self.start = start
        self.formation = formation
        self.closest_seen = math.inf
        self.unsafe_losses: list[tuple[int, float]] = []
        self._bandwidth = bandwidth
        times = start + plan.step * np.arange(plan.states.shape[1])
        self.end = float(times[-1])
        self._paths = [
            CubicHermiteSpline(times, states[:, :3], states[:, 3:]) for states in plan.states
        ]
        self._before: FloatArray | None = None

    def unsafe_losses_text(self) -> str:
        """Return a sentence on the steps in which a loss of thrust is not safe; empty if none."""
        spans = [
            f"{self.plan.step * step:.0f} to {self.plan.step * (step + 1):.0f} s ({closest:.1f} m)"
            for step, closest in self.unsafe_losses
        ]
        if not spans:
            return ""
        return f"thrust must not be lost in the plan's seconds {', '.join(spans)}"

    def planned_states(self, time: float) -> FloatArray:
        """Return the states relative to the reference at a time, m and m/s, shape (m, 6)."""
        moment = min(max(time, self.start), self.end)
        return np.array([[*path(moment), *path(moment, 1)] for path in self._paths])

    def planned_accelerations(self, time: float) -> FloatArray:
        """Return the thrust of the plan at a time, m/s2, shape (m, 3); zero outside of it."""
        # The slack keeps a time that is the start of a step.
        index = math.floor((time - self.start) / self.plan.step + 1e-6)
        if not 0 <= index < self.plan.accelerations.shape[1]:
            return np.zeros(self.plan.accelerations[:, 0].shape)
        accelerations: FloatArray = self.plan.accelerations[:, index]
        return accelerations

    def velocity_changes_left(self, time: float) -> FloatArray:
        """Return what the plan has from a time on, m/s, shape (m,)."""
        steps = self.plan.accelerations.shape[1]
        begins = self.start + self.plan.step * np.arange(steps)
        left = np.clip(begins + self.plan.step - time, 0.0, self.plan.step)
        changes: FloatArray = np.linalg.norm(self.plan.accelerations, axis=2) @ left
        return changes

    def correction(self, time: float, states: Sequence[FloatArray]) -> FloatArray:
        """Return the thrust that leads back to the path, m/s2, shape (m, 3).

        Parameters
        ----------
        time
            Time of the states, s.
        states
            States of all spacecraft relative to one of them, m and m/s, shape (m, 6).
        """
        deviations = np.array(states) - self.planned_states(time)
        deviations -= deviations.mean(axis=0)
        return (
            -(self._bandwidth**2) * deviations[:, :3]
            - 2.0 * _DAMPING * self._bandwidth * deviations[:, 3:]
        )

    def rehearse(
        self, states_gcrf: npt.ArrayLike, acceleration_cap: float, interval: float
    ) -> FloatArray:
        """Return the states to which the plan leads in nonlinear motion with J2.

        The plan is linear. Over kilometres the motion bends from it by metres, which the return to
        the path lessens, and a drift from there by far more.

        Parameters
        ----------
        states_gcrf
            States of all spacecraft at the start, m and m/s, shape (m, 6); thrust is along the axes
            of the first.
        acceleration_cap
            Largest thrust on an axis, m/s2.
        interval
            For which thrust is constant at most, s.

        Returns
        -------
        ndarray, shape (n + 1, m, 6)
            States in GCRF at the ends of the steps of the plan, m and m/s.
        """
        count = math.ceil(self.plan.step / interval)
        duration = self.plan.step / count
        states = np.array(states_gcrf, dtype=float)
        flown = [states]
        for index in range(count * self.plan.accelerations.shape[1]):
            time = self.start + index * duration
            relative = [relative_state_rtn(states[0], state) for state in states]
            thrust = self.planned_accelerations(time) + self.correction(time, relative)
            thrust = np.clip(thrust, -acceleration_cap, acceleration_cap)
            accelerations = thrust @ rotation_gcrf_to_rtn(states[0])
            states = free_flight(states, [0.0, duration])[-1]
            add_thrust(states, accelerations, duration)
            if (index + 1) % count == 0:
                flown.append(states)
        return np.array(flown)

    def watch(self, states: Sequence[FloatArray]) -> None:
        """Take the states of all spacecraft for `closest_seen`, m."""
        positions = np.array(states)[:, :3]
        before = positions if self._before is None else self._before
        for first, second in itertools.combinations(range(len(positions)), 2):
            path = np.array([before[second] - before[first], positions[second] - positions[first]])
            self.closest_seen = min(self.closest_seen, closest_on_path(path))
        self._before = positions
