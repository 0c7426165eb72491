"""Reconfiguration of paper 002, section 4.4.1: from the triangle to the PCO or the helix."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from vtff_analysis.fflas.truth import ThrustFlight, fly_with_thrust
from vtff_analysis.studies.formation_designs import FFLAS_AXIS, fflas_formations
from vtff_control.guidance.reconfiguration import ReconfigurationPlanner
from vtff_control.guidance.reconfiguration_plan import ReconfigurationLimits, ReconfigurationPlan
from vtff_dynamics.constants import GM_EARTH
from vtff_dynamics.orbit.free_flight import free_flight
from vtff_dynamics.orbit.mean_elements import osculating_elements, state_from_elements
from vtff_dynamics.relative.linearised import linearise_motion
from vtff_dynamics.relative.relative_elements import relative_state_of_mean_elements
from vtff_dynamics.relative.separation import closest_on_path
from vtff_dynamics.relative.transition import propagate_mean_elements
from vtff_dynamics.vectors import FloatArray

__all__ = [
    "FFLAS_MASS",
    "FFLAS_PERIOD",
    "FFLAS_THRUST",
    "Reconfiguration",
    "chief_elements_mean",
    "fly_reconfiguration",
    "formation_states",
    "reconfiguration_planner",
    "triangle_states",
]

FFLAS_MASS = 1600.0  # kg, table 1
FFLAS_THRUST = 25e-3  # N on each axis, table 1
FFLAS_PERIOD = 2.0 * math.pi * math.sqrt(FFLAS_AXIS**3 / GM_EARTH)  # s
STEPS = 75
ORBITS = 0.75
_DRIFT_STEP = 10.0  # s


@dataclass(frozen=True, eq=False)
class Reconfiguration:
    """A plan and what became of it in the nonlinear motion under J2.

    Attributes
    ----------
    plan
        The plan.
    flight
        Flight of its thrust.
    closest_approach
        Smallest distance of two spacecraft in the flight, m.
    arrival_error
        Largest distance of a spacecraft from its final position, m.
    closest_drifts
        Smallest distance in one orbit of free drift from the start of every step and from the end,
        m, shape (n + 1,).
    """

    plan: ReconfigurationPlan
    flight: ThrustFlight
    closest_approach: float
    arrival_error: float
    closest_drifts: FloatArray


def chief_elements_mean() -> FloatArray:
    """Return the mean elements of the reference orbit of tables 2 and 4, m and rad."""
    return np.array([FFLAS_AXIS, 0.0, 0.0, 0.0, math.radians(98.51), math.radians(270.0)])


def triangle_states() -> FloatArray:
    """Return the relative states of A, B and C in the triangle of table 4, m and m/s, (3, 6)."""
    triangle = np.zeros((3, 6))
    triangle[:, 2] = -5.3997, 5.3997, 5.3997
    triangle[1:, 1] = 6.2350, -6.2350
    return triangle


def formation_states(formation: str, time: float) -> FloatArray:
    """Return the relative states of a formation, set up in mean elements, (3, 6).

    Parameters
    ----------
    formation
        Name, of `vtff_analysis.studies.formation_designs.fflas_formations`.
    time
        s after the chief's ascending node of table 4.
    """
    chief = propagate_mean_elements(chief_elements_mean(), time)
    designs = fflas_formations()[formation].values()
    return np.array([relative_state_of_mean_elements(chief, relative) for relative in designs])


def reconfiguration_planner(
    objective: str = "norms", axes: str = "RTN", drift_orbits: float = 0.0
) -> ReconfigurationPlanner:
    """Return the planner of paper 002's reconfiguration: 0.75 orbit in 75 steps.

    Parameters
    ----------
    objective, axes
        As in `ReconfigurationLimits`.
    drift_orbits
        Orbits of free drift that must be safe after a loss of thrust; 0 for none.
    """
    step = ORBITS * FFLAS_PERIOD / STEPS
    drift_steps = math.ceil(drift_orbits * FFLAS_PERIOD / step)
    state = state_from_elements(osculating_elements(chief_elements_mean()))
    motion = linearise_motion(state, step, STEPS + drift_steps)
    limits = ReconfigurationLimits(FFLAS_THRUST / FFLAS_MASS, 10.0, axes, objective)
    return ReconfigurationPlanner(motion, 3, limits, STEPS)


def fly_reconfiguration(plan: ReconfigurationPlan, final_states: FloatArray) -> Reconfiguration:
    """Fly a plan from the triangle in the nonlinear motion.

    Parameters
    ----------
    plan
        Plan of the planner that `reconfiguration_planner` makes.
    final_states
        Where the plan leads, m and m/s, shape (3, 6).
    """
    state = state_from_elements(osculating_elements(chief_elements_mean()))
    flight = fly_with_thrust(state, triangle_states(), plan.accelerations, plan.step)
    positions = flight.relative_states[:, :, :3]
    per_step = (len(flight.times) - 1) // plan.accelerations.shape[1]
    times = np.arange(0.0, FFLAS_PERIOD, _DRIFT_STEP)
    drifts = [
        _closest(free_flight(states[1:], times)[..., :3])
        for states in flight.states_gcrf[::per_step]
    ]
    return Reconfiguration(
        plan,
        flight,
        _closest(positions),
        float(np.linalg.norm(positions[-1] - final_states[:, :3], axis=1).max()),
        np.array(drifts),
    )


def _closest(positions: FloatArray) -> float:
    """Return the smallest distance of two spacecraft, m, from positions (k, m, 3)."""
    return min(
        closest_on_path(positions[:, second] - positions[:, first])
        for first, second in itertools.combinations(range(positions.shape[1]), 2)
    )
